"""Which law is chosen for movements that were made up, without any simulation."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from tests.unit.calibrations import calibration, fitted

from turnout.calibration.comparison import Comparison
from turnout.calibration.drive_law.candidates import PLAIN, SOFT, WORN, drive_laws, lagged
from turnout.calibration.drive_law.compare import LawComparison, fitted_laws, law_results
from turnout.calibration.drive_law.fit_law import _movement_levels
from turnout.calibration.evaluate import CELL, Evaluator, Response, ThrowInputs
from turnout.calibration.fit import fit
from turnout.calibration.measured_movements import BIN, MeasuredMovement, Signal
from turnout.calibration.misfit import Misfit
from turnout.calibration.noise import measured_noise
from turnout.calibration.parameter import Parameter
from turnout.calibration.predict import predicted
from turnout.panel.load import load_panel

FRICTION, STIFFNESS, LEVEL = (
    "chair.friction_coefficient",
    "drive.2.stiffness",
    "drive.2.saturation_force",
)
TRUE = {FRICTION: 0.31, STIFFNESS: 800e3, LEVEL: 5e3}
START = {FRICTION: 0.33, STIFFNESS: 760e3, LEVEL: 5.2e3}
ONSET, CONTACT = 1.0, 1.6
SIZES = (0.0, 0.012, 0.011, 0.010, 0.009, 0.004)
PANEL = load_panel("sb1")


class MadeUp(Evaluator):
    """Answers at once, by a formula: a drive that is stretched by an object."""

    def responses(self, throws: Sequence[ThrowInputs]) -> list[Response]:
        self.made += len(throws)
        return [response(throw) for throw in throws]


def response(throw: ThrowInputs) -> Response:
    time = CELL * (np.arange(800) + 0.5)
    values = {key: value for key, value in throw.overrides.items() if isinstance(value, float)}
    stretched = throw.size * np.clip((time - CONTACT) / 0.6, 0.0, 1.0)
    if "drive.2.extension" in throw.overrides:
        table = [np.array(throw.overrides[f"drive.2.{key}"]) for key in ("extension", "force")]
        pushed = np.interp(stretched, *table)
    else:
        pushed = np.minimum(values[STIFFNESS] * stretched, values[LEVEL])
    # Twice the friction is more than twice the force, so that a scatter of it is not linear.
    rubbing = 3e3 * values[FRICTION] / (1.0 - values[FRICTION])
    moving = rubbing * (1.0 - np.exp(-np.maximum(time - ONSET, 0.0) / 0.2))
    return Response(
        time=time,
        drive_force={"1": moving, "2": pushed},
        marker={"1": 0.0 * time, "2": 0.0 * time},
        object_force=pushed,
        onsets={"closing": ONSET},
        contact_time=CONTACT if throw.size > 0 else float("nan"),
    )


def movement(
    number: int,
    values: dict[str, float],
    rng: np.random.Generator,
    lag: float,
    *,
    size: float | None = None,
) -> MeasuredMovement:
    """Make a measured movement, with noise."""
    size = SIZES[number] if size is None else size
    time = BIN * (np.arange(-50, 90) + 0.5)
    clean = lagged(response(ThrowInputs(overrides=values, size=size)), "2", lag=lag)
    keys = [("drive_force", "1"), ("drive_force", "2"), *([("object_force", "")] if size else [])]
    empty = MeasuredMovement(
        name=f"m{number}",
        direction="closing",
        place="drive 2" if size else "none",
        size=size,
        x=1.0,
        signals=tuple(
            Signal(channel=channel, drive=drive, time=time, values=0.0 * time)
            for channel, drive in keys
        ),
        length=1.6,
        clocked=True,
    )
    bins = np.arange(time.size)
    signals = [
        replace(s, values=predicted(clean, empty, s, bins) + 3.0 * rng.standard_normal(bins.size))
        for s in empty.signals
    ]
    return replace(empty, signals=tuple(signals))


def compared(
    *, seed: int, level_scatter: float = 0.0, lag: float = 0.0, excess: float = 0.0
) -> LawComparison:
    """Fit all laws to six movements whose friction scatters by 3 %."""
    rng = np.random.default_rng(seed)
    measured = []
    for number in range(len(SIZES)):
        own = {
            FRICTION: TRUE[FRICTION] * (1.0 + 0.03 * rng.standard_normal()),
            LEVEL: TRUE[LEVEL] * (1.0 + excess) * (1.0 + level_scatter * rng.standard_normal()),
        }
        measured.append(movement(number, TRUE | own, rng, lag))
    units = {FRICTION: "1", STIFFNESS: "N/m", LEVEL: "N"}
    known = replace(
        calibration(),
        parameters=tuple(fitted(key, START[key], unit=unit) for key, unit in units.items()),
    )
    with MadeUp(PANEL) as evaluator:
        fits = fitted_laws(tuple(measured), PANEL, known, drive="2", evaluator=evaluator)
    results, samples = law_results(fits)
    return LawComparison(
        drive="2", nominal=6e3, movements=(), samples=samples, results=tuple(results)
    )


def test_the_plain_law_is_kept_where_only_friction_scatters() -> None:
    found = compared(seed=2)
    assert found.best.name == PLAIN
    for key in (STIFFNESS, LEVEL):
        assert found.best.values[key] == pytest.approx(TRUE[key], rel=5e-3)


def test_a_slip_level_that_scatters_is_reported() -> None:
    found = compared(seed=2, level_scatter=0.08, excess=0.15)
    assert found.best.name == WORN
    assert found.plain in found.rejected
    assert 0.03 < found.best.scatter[LEVEL] < 0.14


def test_a_build_up_that_lags_is_reported() -> None:
    found = compared(seed=2, lag=0.2)
    assert found.best.name == SOFT
    assert found.best.values["lag"] == pytest.approx(0.2, rel=0.03)


def test_a_drive_that_slipped_below_the_common_level_is_found_from_no_slope_at_all() -> None:
    rng = np.random.default_rng(4)
    # The second object asks for 6.4 kN, less than the common level but more than its own one; the
    # last for 3.2 kN, with which nothing slips.
    levels = [7e3, 7e3, 5.6e3, 7e3, 7e3, 7e3]
    sizes = (0.0, 0.012, 0.008, 0.012, 0.012, 0.004)
    measured = tuple(
        movement(n, TRUE | {LEVEL: level}, rng, 0.0, size=size)
        for n, (level, size) in enumerate(zip(levels, sizes, strict=True))
    )
    parameters = tuple(
        Parameter(name=key, keys=(key,), start=value, lower=0.1 * value, upper=10.0 * value)
        for key, value in TRUE.items()
    )
    law = drive_laws(PANEL, "2")[1]
    with MadeUp(PANEL) as evaluator:
        misfit = Misfit(
            evaluator=evaluator,
            parameters=parameters,
            base={**TRUE, LEVEL: 7e3},
            movements=measured,
            comparison=Comparison(noise=measured_noise(measured), scatter=law.scatter),
        )
        plain = fit(misfit, parameters[1:2], misfit.base)
        shares = _movement_levels(law, misfit, plain, "2")
    assert shares[2] == pytest.approx(5.6 / 7.0 - 1.0, abs=0.01)
    assert np.abs(np.delete(shares, 2)).max() < 0.01
