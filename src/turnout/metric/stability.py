"""Flutter of the rails of a panel by friction while they are thrown.

Steady sliding is evaluated where the markers stand at several shares of each movement; every foot
that carries slides the way of the movement. See `turnout.metric.sliding` for the equations.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from turnout.core.errors import ResponseError
from turnout.core.threads import one_blas_thread
from turnout.mechanism.build import build_mechanism
from turnout.mechanism.mechanism import Mechanism
from turnout.metric.sliding import Floats, Sliding, complex_modes, steady_sliding
from turnout.panel.markers import (
    marker_level,
    marker_offsets,
    movement_time,
    ordered_movements,
    start_level,
)
from turnout.panel.model import Panel
from turnout.solver.condense import condense
from turnout.solver.modal import ModalModel

FACTORS = (1.0, 1.25)
"""Of the friction, at which a panel should not flutter [-]."""
SHARES = (0.1, 0.3, 0.5, 0.7, 0.9)
SENSE = {"closed": 1.0, "open": -1.0}
Worst = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class SlidingCase:
    """The least stable mode at one place of one movement.

    Attributes
    ----------
    movement : str
        Name of the movement.
    to : str
        "open" or "closed", of the instrumented rail.
    share : float
        Share of the markers' travel [-].
    settled : bool
        Whether steady sliding was found; if not, the numbers are NaN.
    frequency : float
        Damped frequency [Hz]; 0 for a motion that does not swing.
    damping_ratio : float
        Share of critical damping [-]; negative where the mode grows.
    growth_rate : float
        Of its amplitude, negative where it decays [1/s].
    """

    movement: str
    to: str
    share: float
    settled: bool
    frequency: float
    damping_ratio: float
    growth_rate: float


@dataclass(frozen=True, slots=True)
class FrictionStability:
    """Effect of friction on the vibrations of a panel in motion.

    Attributes
    ----------
    friction_factor : float
        The friction coefficients were multiplied by it [-].
    cases : tuple of SlidingCase
        Every place that was evaluated.
    superelement_cutoff : float
        Nothing is said about vibration near or above this frequency [Hz].
    """

    friction_factor: float
    cases: tuple[SlidingCase, ...]
    superelement_cutoff: float

    @property
    def worst(self) -> SlidingCase:
        """The case whose amplitude grows fastest or decays slowest."""
        settled = [case for case in self.cases if case.settled]
        return max(settled or self.cases, key=lambda case: case.growth_rate)

    @property
    def stable(self) -> bool:
        """True if steady sliding was found in every case and every vibration decays."""
        return all(map(_decays, self.cases))

    @property
    def fault(self) -> tuple[str, str, str] | None:
        """Words for what does not decay, where and how fast; None where all does."""
        if self.stable:
            return None
        case, lost = self.worst, [case for case in self.cases if not case.settled]
        if case.growth_rate >= 0.0:
            what = "the section can flutter" if case.frequency else "a rail can run away"
            number = (
                f"{case.frequency:.1f} Hz, damping {100 * case.damping_ratio:.2f} % of critical, "
                f"grows with {case.growth_rate:.2g} 1/s"
            )
        else:
            case, what = lost[0], "flutter is not known"
            number = f"no steady sliding was found in {len(lost)} of {len(self.cases)} places"
        times = "" if self.friction_factor == 1.0 else f"{self.friction_factor:g} times "
        where = f"at {times}the panel's friction, {100 * case.share:.0f} % of movement "
        return what, f"{where}'{case.movement}'", number

    def __str__(self) -> str:
        """Return the result in one sentence."""
        decay = f"at {self.friction_factor:g} times the friction all vibrations decay"
        return ": ".join(self.fault or (f"{decay} while the rails slide",))


def friction_stability(
    panel: Panel,
    *,
    friction_factor: float = 1.0,
    cutoff_frequency: float = float("inf"),
    follow_speed: bool = False,
) -> FrictionStability:
    """Look for flutter of a panel in motion by complex modes.

    Parameters
    ----------
    panel : Panel
        With movements; foreign objects are left out.
    friction_factor : float
        Multiplies the friction coefficient of every chair: 1.25 shows how near flutter is [-].
    cutoff_frequency : float
        Places where no mode grows without those above it are not evaluated with all modes, which
        takes six times as long; all modes by default. With a cut-off growth rates of slow modes
        come out too large, since the damping of what is left out is missing [Hz].
    follow_speed : bool
        Whether friction follows its curve over speed, at the mean speed of the movement: where it
        falls it feeds vibration. Default its level in motion alone, so flutter.

    Returns
    -------
    FrictionStability

    Raises
    ------
    ResponseError
        When the factor is not positive or the panel never moves.

    Examples
    --------
    >>> from turnout.panel.load import load_panel
    >>> found = friction_stability(load_panel("sb1"))
    >>> found.stable, len(found.cases)
    (True, 10)
    """
    if not 0.0 < friction_factor < float("inf"):
        message = f"friction_factor = {friction_factor:g}: must be more than 0"
        raise ResponseError(message)
    if not panel.movement:
        message = "friction_stability: the panel has no movement; add one to its schedule"
        raise ResponseError(message)
    with one_blas_thread():
        mechanism = build_mechanism(panel)
        places = list(sliding_places(panel))
        quick = condense(mechanism, cutoff_frequency=cutoff_frequency)
        known: dict[bytes, Worst] = {}
        way = _Way(friction_factor, follow_speed)
        cases = [_case(mechanism, quick, place, way, known) for place in places]
        if np.isfinite(cutoff_frequency) and not all(map(_decays, cases)):
            whole, known = condense(mechanism, cutoff_frequency=float("inf")), {}
            for number, place in enumerate(places):
                if not _decays(cases[number]):
                    cases[number] = _case(mechanism, whole, place, way, known)
    cutoff = panel.discretisation.superelement_cutoff
    return FrictionStability(friction_factor, tuple(cases), cutoff)


def _decays(case: SlidingCase) -> bool:
    return case.settled and case.growth_rate < 0.0


@dataclass(frozen=True, slots=True, eq=False)
class SlidingPlace:
    """Positions and mean speeds of the markers, and the direction in which the rails slide."""

    movement: str
    to: str
    share: float
    inputs: Floats
    sense: float
    rate: Floats


@dataclass(frozen=True, slots=True)
class _Way:
    """Factor on friction, and whether it follows speed."""

    friction_factor: float
    follow_speed: bool


def sliding_places(panel: Panel, *, shares: tuple[float, ...] = SHARES) -> Iterator[SlidingPlace]:
    """Yield the marker positions at shares of the travel of every movement."""
    drives = panel.drive.values()
    level = np.array([start_level(panel, drive) for drive in drives])
    for name, movement in ordered_movements(panel):
        target = np.array(
            [marker_level(drive, movement.to, starts=panel.schedule.starts) for drive in drives]
        )
        times = np.array([movement_time(movement, drive) for drive in panel.drive])
        for share in shares:
            inputs = level + share * (target - level) + marker_offsets(panel)
            rate = (target - level) / times
            yield SlidingPlace(name, movement.to, share, inputs, SENSE[movement.to], rate)
        level = target


def _case(
    mechanism: Mechanism,
    model: ModalModel,
    place: SlidingPlace,
    way: _Way,
    known: dict[bytes, Worst],
) -> SlidingCase:
    """Return the least stable mode at a place; places with the same contacts share it."""
    state = steady_sliding(
        mechanism,
        model,
        inputs=place.inputs,
        sense=place.sense,
        friction_factor=way.friction_factor,
        rate=place.rate if way.follow_speed else None,
    )
    worst: Worst = (float("nan"), float("nan"), float("nan"))
    if state.settled:
        key = state.coupling.tobytes() + state.damping.tobytes()
        if key not in known:
            known[key] = _worst(model, state)
        worst = known[key]
    return SlidingCase(place.movement, place.to, place.share, state.settled, *worst)


def _worst(model: ModalModel, state: Sliding) -> Worst:
    """Return frequency [Hz], damping ratio and growth rate [1/s] of the least stable mode."""
    modes = complex_modes(model, state.coupling, damping=state.damping, with_shapes=False)
    at = int(np.argmax(modes.growth_rate))
    return (
        float(modes.frequencies[at]),
        float(modes.damping_ratio[at]),
        float(modes.growth_rate[at]),
    )
