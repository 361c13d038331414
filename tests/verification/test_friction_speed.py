"""Friction that falls with speed: stick-slip, onset, coupled masses, order, lubrication.

References: (a) a block on a belt with a level at rest and one in motion, in closed form: the slip
is a half swing about ``mu_k N / k`` of amplitude ``sqrt(((mu_s - mu_k) N / k)^2 + (v / omega)^2)``,
the time of a cycle ``2 (pi - atan(d)) / omega + 2 (mu_s - mu_k) N / (k v)`` with
``d = (mu_s - mu_k) N omega / (k v)``; (b) steady sliding at a speed v loses or gains by
``exp(s t)``, ``s = -(c + N mu'(v)) / 2 m``, so vibration begins where the slope of the curve
exceeds the damper; two masses that are coupled by a spring and a damper have two such modes; (c)
SciPy's ``solve_ivp`` on the same law, with its events found to 1e-12 s. On the default panel
vibration grows with the level at rest and is gone with grease, as is reported of slide chairs.
Tolerance: (a) 2 %, as the closed form is for a curve that falls at once and one that falls within
0.1 mm/s is meant; (b) 3 % of the rate; (c) order 1 within 0.15.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from tests.verification.hand_made import energy_residual, hand_made, linear_spring, run

from turnout.core.errors import PanelError, SolverError
from turnout.law.friction import curve_arrays, no_courses
from turnout.law.friction_state import FRICTION_STATES, FrictionCurve
from turnout.law.table import LawTableBuilder
from turnout.mechanism.mechanism import Mechanism
from turnout.metric.features import features
from turnout.metric.sliding import complex_modes, steady_sliding
from turnout.metric.stability import friction_stability
from turnout.panel.load import load_panel
from turnout.solver.condense import condense
from turnout.solver.integration import History
from turnout.throw.simulate import simulate

MASS, SPRING, NORMAL, KINETIC, STICK = 2.0, 8e3, 100.0, 0.3, 1e10
OMEGA = float(np.sqrt(SPRING / MASS))
PERIOD = 2 * np.pi / OMEGA


def with_curve(mechanism: Mechanism, curve: FrictionCurve) -> Mechanism:
    """Give all frictions of a mechanism a curve over speed."""
    excess, fall, rise = curve_arrays([curve] * mechanism.laws.friction_row.size)
    return replace(mechanism, courses=no_courses()._replace(excess=excess, fall=fall, rise=rise))


def blocks(curve: FrictionCurve, *, count: int = 1, damping: float = 0.0, coupling: float = 0.0,
           coupling_damping: float = 0.0) -> Mechanism:  # fmt: skip
    """Return masses on springs to a marker each, coupled to each other, on a floor."""
    laws, n = LawTableBuilder(), count + 1
    normal = laws.add_contact(count, stiffness=1e7, clearance=0.0, base_closed=True)
    for row in range(count):
        linear_spring(laws, row, SPRING, input_index=row)
        laws.add_friction(row, normal=normal, friction_coefficient=KINETIC, stick_stiffness=STICK)
    pair = np.zeros((n, n))
    if count == 2:
        pair[:2, :2] = [[1.0, -1.0], [-1.0, 1.0]]
    own = np.diag([*[damping] * count, 0.0])
    mechanism = hand_made(
        laws, mass=[*[MASS] * count, MASS], load=[*[0.0] * count, NORMAL],
        stiffness=coupling * pair, damping=own + coupling_damping * pair,
    )  # fmt: skip
    return with_curve(mechanism, curve)


def dragged(
    mechanism: Mechanism, speed: float, *, end: float, step: float, radius: float = 0.9
) -> History:
    """Pull the springs at one speed from rest."""
    markers = [lambda t: speed * t] * mechanism.laws.friction_row.size
    return run(mechanism, *markers, end=end, step=step, spectral_radius=radius)


def stretch(history: History, row: int = 0) -> np.ndarray:
    """Return how far a spring is stretched over time [m]."""
    return history.inputs[:, 0] - history.g[:, row]


def rising_zeros(time: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return the times of upward zeros, linear between instants."""
    up = np.flatnonzero((values[:-1] < 0) & (values[1:] >= 0))
    return time[up] - values[up] * np.diff(time)[up] / np.diff(values)[up]


@pytest.mark.parametrize(("ratio", "speed"), [(1.2, 0.02), (1.5, 0.05), (1.2, 0.1)])
@pytest.mark.parametrize("count", [1, 2])
def test_stick_slip_has_the_amplitude_and_period_of_the_closed_form(
    ratio: float, speed: float, count: int
) -> None:
    curve = FrictionCurve(1.0, static_ratio=ratio, stribeck_speed=1e-4)
    mechanism = blocks(curve, count=count, coupling=3e3 * (count - 1))
    drop = (ratio - 1.0) * KINETIC * NORMAL / SPRING
    cycle = 2 * (np.pi - np.arctan(drop * OMEGA / speed)) / OMEGA + 2 * drop / speed
    first = ratio * KINETIC * NORMAL / SPRING / speed
    history = dragged(mechanism, speed, end=first + 5 * cycle, step=PERIOD / 4000, radius=0.0)
    late = history.time > first
    for row in range(count):
        found = stretch(history, row)[late] - KINETIC * NORMAL / SPRING
        amplitude = np.hypot(drop, speed / OMEGA)
        assert np.ptp(found) / 2 == pytest.approx(amplitude, rel=0.02)
        found_cycles = np.diff(rising_zeros(history.time[late], found))
        np.testing.assert_allclose(found_cycles, cycle, rtol=0.02)
    assert energy_residual(history) < 1e-6


SOFT = FrictionCurve(1.0, static_ratio=1.1, stribeck_speed=0.05)
DAMPING, COUPLING, COUPLING_DAMPING = 20.0, 3e3, 2.0


def slope(speed: float, curve: FrictionCurve = SOFT) -> float:
    """Return the slope of the coefficient over speed [s/m]."""
    share = (speed / curve.stribeck_speed) ** 2
    falls = (curve.static_ratio - 1.0) * 2.0 * share / speed / (1.0 + share) ** 2
    return KINETIC * (curve.rise - falls)


ONSET = float(brentq(lambda v: DAMPING + NORMAL * slope(v), 0.03, 0.3))
"""Speed below which steady sliding vibrates, down to one where the curve is flat again [m/s]."""


def found_rate(speed: float, *, against: bool) -> float:
    """Return the rate at which a small swing about steady sliding grows [1/s].

    Two masses slide at a speed; after a push in, or against each other, their mode swings alone.
    """
    mechanism = blocks(
        SOFT, count=2, damping=DAMPING, coupling=COUPLING, coupling_damping=COUPLING_DAMPING
    )
    omega = np.sqrt((SPRING + 2 * COUPLING * against) / MASS)
    slows, calm, end, push = 2.5, 4.02, 4.3, 3e-5
    fast = 0.5  # where friction hardly falls, so that all is calm before the push

    def marker(sign: float) -> Callable[[np.ndarray], np.ndarray]:
        def position(t: np.ndarray) -> np.ndarray:
            s = np.clip((t - slows) / 1.5, 0.0, 1.0)
            lost = 1.5 * (s**3 - 0.5 * s**4) + np.maximum(t - slows - 1.5, 0.0)
            return fast * t + (speed - fast) * lost + sign * push * (t > calm)

        return position

    pair = marker(1.0), marker(-1.0 if against else 1.0)
    history = run(mechanism, *pair, end=end, step=PERIOD / 4000, spectral_radius=1.0)
    assert energy_residual(history) < 1e-6
    swing = history.inputs[:, 0] - history.g[:, 0]
    swing += (history.inputs[:, 1] - history.g[:, 1]) * (-1.0 if against else 1.0)
    own = history.time > calm + 0.01
    time, values = history.time[own], swing[own]
    rate_of_swing = np.gradient(values, time)
    middle = 2 * push * (1.0 - SPRING / (MASS * omega**2))
    if not against:
        middle = 2 * (KINETIC * NORMAL * level(speed) + DAMPING * speed) / SPRING
    envelope = np.hypot(values - middle, rate_of_swing / omega)
    return float(np.polyfit(time, np.log(envelope), 1)[0])


def level(speed: float, curve: FrictionCurve = SOFT) -> float:
    """Return the coefficient over that in motion [-]."""
    fallen = (curve.static_ratio - 1.0) / (1.0 + (speed / curve.stribeck_speed) ** 2)
    return 1.0 + fallen + curve.rise * speed


@pytest.mark.parametrize("against", [False, True])
@pytest.mark.parametrize("share", [0.5, 0.8, 1.25, 2.0])
def test_a_swing_about_sliding_grows_below_the_onset_speed_alone(
    share: float, against: bool
) -> None:
    speed = share * ONSET
    damping = DAMPING + 2 * COUPLING_DAMPING * against
    expected = -(damping + NORMAL * slope(speed)) / (2 * MASS)
    assert against or (expected > 0.0) == (share < 1.0)
    assert found_rate(speed, against=against) == pytest.approx(expected, rel=0.03, abs=0.05)


@pytest.mark.parametrize("count", [1, 2])
@pytest.mark.parametrize("share", [0.3, 0.8, 1.25, 2.0])
def test_complex_modes_follow_the_slope_of_the_curve(share: float, count: int) -> None:
    """A mass on a belt, and two coupled ones in and against phase."""
    speed = share * ONSET
    pair = {"coupling": COUPLING, "coupling_damping": COUPLING_DAMPING} if count == 2 else {}
    mechanism = blocks(SOFT, count=count, damping=DAMPING, **pair)
    model = condense(mechanism, cutoff_frequency=float("inf"))
    markers = np.zeros(count), np.full(count, speed)
    state = steady_sliding(mechanism, model, inputs=markers[0], sense=1.0, rate=markers[1])
    assert state.settled
    falling = (DAMPING + NORMAL * slope(speed)) / MASS
    expected = [(falling, SPRING / MASS)]
    if count == 2:
        expected += [(falling + 2 * COUPLING_DAMPING / MASS, (SPRING + 2 * COUPLING) / MASS)]
    found = complex_modes(model, state.coupling, damping=state.damping).eigenvalues
    for rate, square in expected:
        root = complex(-rate / 2, np.sqrt(square - rate**2 / 4))
        assert np.abs(found - root).min() < 1e-6 * abs(root)
    plain = steady_sliding(mechanism, model, inputs=markers[0], sense=1.0)
    calm = complex_modes(model, plain.coupling, damping=plain.damping).growth_rate
    assert calm.max() <= 0.0  # of the level in motion alone; nothing damps the vertical mode


FOOT, DRAG, PULL = 2e5, 6.0, 0.03


def reference_path(time: np.ndarray, curve: FrictionCurve) -> np.ndarray:
    """Return the path of a block whose foot is elastic while it sticks, by SciPy [m]."""

    def limit(v: float) -> float:
        return KINETIC * NORMAL * level(v, curve)

    def acceleration(t: float, x: float, v: float, friction: float) -> float:
        return (SPRING * (PULL * t - x) - DRAG * v - friction) / MASS

    anchor, start, state = 0.0, 0.0, np.zeros(2)
    sticks, found = True, np.zeros(time.size)
    while start < time[-1]:
        if sticks:

            def rates(t: float, y: np.ndarray, a: float = anchor) -> list[float]:
                return [y[1], acceleration(t, y[0], y[1], FOOT * (y[0] - a))]

            def event(t: float, y: np.ndarray, a: float = anchor) -> float:
                return FOOT * (y[0] - a) - limit(abs(y[1]))

        else:

            def rates(t: float, y: np.ndarray) -> list[float]:
                return [y[1], acceleration(t, y[0], y[1], limit(abs(y[1])))]

            def event(t: float, y: np.ndarray) -> float:
                # the foot itself stops where block and stick spring move alike
                steep = KINETIC * NORMAL * slope(max(abs(y[1]), 1e-12), curve)
                rate = steep * acceleration(t, y[0], y[1], limit(abs(y[1])))
                return -(y[1] - rate / FOOT)

        event.terminal, event.direction = True, 1.0  # type: ignore[attr-defined]
        path = solve_ivp(
            rates, (start, time[-1]), state, events=event, dense_output=True,
            rtol=1e-10, atol=1e-13, max_step=PERIOD / 50,
        )  # fmt: skip
        own = (time >= start) & (time <= path.t[-1])
        if own.any():
            found[own] = path.sol(time[own])[0]
        if path.status == 0:
            return found
        start, state = path.t[-1] + 1e-12, path.y[:, -1]
        if not sticks:
            anchor = state[0] - limit(abs(state[1])) / FOOT
        sticks = not sticks
    return found


@pytest.mark.parametrize(
    "curve",
    [
        FrictionCurve(1.0, static_ratio=1.2, stribeck_speed=0.02),  # sticks and slips
        FrictionCurve(1.0, static_ratio=1.1, stribeck_speed=0.05, rise=1.0),
        FrictionCurve(1.0, rise=1.0),
    ],
)
def test_the_path_converges_with_the_step_at_order_one(curve: FrictionCurve) -> None:
    errors = []
    for steps in (800, 1600, 3200, 6400):
        laws = LawTableBuilder()
        linear_spring(laws, 0, SPRING, input_index=0)
        normal = laws.add_contact(1, stiffness=1e7, clearance=0.0, base_closed=True)
        laws.add_friction(0, normal=normal, friction_coefficient=KINETIC, stick_stiffness=FOOT)
        mechanism = hand_made(
            laws, mass=[MASS, MASS], load=[0.0, NORMAL], damping=np.diag([DRAG, 0.0])
        )
        history = dragged(with_curve(mechanism, curve), PULL, end=5 * PERIOD, step=PERIOD / steps)
        difference = history.g[:, 0] - reference_path(history.time, curve)
        errors.append(float(np.sqrt(np.mean(difference**2))))
        assert energy_residual(history) < 1e-6
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert np.all(np.abs(orders - 1.0) < 0.15), (errors, orders)


PANEL = load_panel("uic60-760-1-15")


def thrown(**chair: object):
    changed = PANEL.with_overrides({f"chair.{key}": value for key, value in chair.items()})
    return simulate(changed, mode="quick")


def vibration(dataset) -> float:
    """Return that of Drive 1 on the way of the return [N]."""
    return float(features(dataset)["vibration"].sel(drive="1", direction="closing"))


def test_vibration_grows_as_chairs_run_dry_and_lubrication_removes_it() -> None:
    weeks = [vibration(thrown(static_ratio=ratio)) for ratio in (1.0, 1.1, 1.2, 1.3, 1.4)]
    assert np.all(np.diff(weeks) > 0.0), weeks
    assert weeks[-1] > 2.0 * weeks[0]
    assert vibration(thrown(friction_state="greased")) < 1.02 * weeks[0]


def test_a_curve_that_is_flat_changes_no_bit() -> None:
    flat, plain = thrown(static_ratio=1.0, friction_rise=0.0), thrown()
    assert np.array_equal(flat["drive_force"], plain["drive_force"])
    level = FRICTION_STATES["rust"].factor * PANEL.chair["1"].friction_coefficient
    named = thrown(friction_state="rust", static_ratio=1.0)
    assert np.array_equal(named["drive_force"], thrown(friction_coefficient=level)["drive_force"])


def test_a_dry_spot_in_grease_is_felt_where_it_lies() -> None:
    grease, spots = PANEL.with_overrides({"chair.friction_state": "greased"}), {}
    for name in ("1", "2", "3"):
        spots[f"chair.{name}.friction_opening"] = [0.0, 0.02, 0.04]
        spots[f"chair.{name}.friction_state"] = ["greased", "rust", "greased"]
    greased, spot = (
        simulate(item, mode="quick") for item in (grease, grease.with_overrides(spots))
    )
    assert float((spot["energy_friction"] - greased["energy_friction"])[-1]) > 5.0
    felt = abs(spot["drive_force"] - greased["drive_force"]).sel(drive="1")
    gap, closing = spot["drive_gap"].sel(drive="1"), spot["time"] > 4.5
    there, elsewhere = (
        float(felt.where(closing & (gap > low) & (gap < high)).mean())
        for low, high in ((0.022, 0.038), (0.05, 0.065))
    )
    assert there > 4.0 * elsewhere


@pytest.mark.parametrize("state", FRICTION_STATES)
def test_states_lie_in_their_ranges_and_run(state: str) -> None:
    item = FRICTION_STATES[state]
    assert item.least <= item.curve.level <= item.most
    assert item.origin.startswith(("level", "assumption"))
    found = thrown(friction_state=state)
    assert found.attrs["outcome"] == "complete"
    scale = float(found["energy_friction"].max())
    assert abs(found["energy_residual"]).max() < 1e-6 * scale


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"static_ratio": 0.8}, "static_ratio = 0.8: must be 1 to 5, as friction in motion is not"),
        ({"friction_rise": 40.0}, r"friction_rise = 40 s/m: rises to 41 times .* give 19 s/m or"),
        ({"friction_rise": -1.0}, "friction_rise"),
        ({"stribeck_speed": -0.01}, "stribeck_speed"),
        ({"friction_state": "gresed"}, "friction_state.*did you mean 'greased'|greased"),
        ({"friction_state": ["dry", "rust"]}, "2 states: needs friction_opening with as many"),
        (
            {"friction_state": "dry", "friction_opening": [0.0, 0.05]},
            "friction_opening: needs friction_factor, or states in friction_state, with as many",
        ),
        ({"friction_state": []}, "names no state"),
    ],
)
def test_impossible_curves_are_refused(given: dict, said: str) -> None:
    with pytest.raises(PanelError, match=said) as caught:
        PANEL.with_overrides({f"chair.1.{key}": value for key, value in given.items()})
    assert len(caught.value.problems) == 1


@pytest.mark.parametrize(
    ("chairs", "key", "value", "needed", "remedy"),
    [
        ("chair", "stribeck_speed", 0.01, "static_ratio or friction_state", {"static_ratio": 1.2}),
        ("chair.2", "stribeck_speed", 0.01, "static_ratio or", {"friction_state": "dry"}),
        ("chair", "roller_friction", 0.05, "roller_lift", {"roller_lift": 2e-3}),
        ("chair.2", "roller_stiffness", 1e6, "roller_lift", {"roller_lift": 2e-3}),
    ],
)
def test_values_without_effect_are_refused(
    chairs: str, key: str, value: float, needed: str, remedy: dict
) -> None:
    """Named once; what a single chair needs may stand in the values of all chairs."""
    with pytest.raises(PanelError) as caught:
        PANEL.with_overrides({f"{chairs}.{key}": value})
    (problem,) = caught.value.problems
    assert problem.startswith(f"{chairs}.{key}: without effect, as no chair has {needed}")
    first = {f"chair.1.{name}": given for name, given in remedy.items()}
    assert PANEL.with_overrides({f"{chairs}.{key}": value, **first})


def test_quasi_static_mode_knows_no_speed() -> None:
    dry = PANEL.with_overrides({"chair.friction_state": "dry"})
    with pytest.raises(SolverError, match=r"no speed for friction that follows it; take"):
        simulate(dry, mode="quasi-static")


def test_a_curve_that_falls_feeds_vibration_of_a_panel_and_grease_takes_it() -> None:
    """Without the slope every one of these states is as calm as a constant coefficient."""
    rates = []
    for name in ("greased", "dry"):
        panel = PANEL.with_overrides({"chair.friction_state": name})
        found = friction_stability(panel, cutoff_frequency=50.0, follow_speed=True)
        rates.append(found.worst.growth_rate)
    assert 0.0 < rates[0] < 0.2  # a swing grows by a quarter in a movement at most
    assert rates[1] > 30.0  # and by e in a thirtieth of a second
    assert friction_stability(panel, cutoff_frequency=50.0).stable
    constant = load_panel("sb1")
    found = friction_stability(constant, cutoff_frequency=50.0, follow_speed=True)
    assert found.cases == friction_stability(constant, cutoff_frequency=50.0).cases
