"""From simulated throws to a trained detector: sound model, signatures, thresholds."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.linalg import solve_triangular

from turnout.core.errors import StudyError
from turnout.detection.conditions import FORCE
from turnout.detection.detector.allowances import Allowances, gain_times
from turnout.detection.detector.judging import SPEED, UNUSUAL
from turnout.detection.detector.knowledge import Knowledge, Setting
from turnout.detection.detector.object_kinds import RIGID, KindSignatures
from turnout.detection.detector.sound_model import SoundModel, fit_sound_model
from turnout.detection.detector.switch_history import ThrowErrors, error_at
from turnout.detection.detector.throw_layout import (
    CLOSING,
    OPENING,
    Layout,
    layout_of,
    stretched,
    throw_features,
)
from turnout.detection.detector.throw_set import ThrowSet
from turnout.detection.detector.training_plan import (
    HISTORY,
    OBJECT,
    OBJECT_AT,
    OBJECT_SIZE,
    SOUND,
    Plan,
)
from turnout.detection.detector.training_sets import learned_kinds
from turnout.detection.drive_quantities import CHANNELS, signals_of
from turnout.detection.floor import TOUCH_FORCE
from turnout.detection.likelihood import Signatures
from turnout.detection.reference import FRICTION, NOMINAL_FRICTION
from turnout.detection.signal_errors import signal_errors
from turnout.detection.throws import of_kind, places_of
from turnout.panel.load import LoadedPanel
from turnout.study.defects import ALL_DRIVES, DEFECTS, trained_changes
from turnout.study.sweep.read import last_values

Floats = NDArray[np.float64]

SENSOR = "force sensor"
"""A cause without throws: gain or zero of one force sensor is wrong."""
SENSOR_GAIN, SENSOR_ZERO = (0.08, 0.5), (150.0, 1500.0)
"""Faults of a force sensor: changes of its gain [-] and of its zero [N], either way."""
USUAL_FORCE = 4e3
"""Amplitude of a force that these zeros are of; those of other quantities are in proportion [N]."""
SENSOR_FAULTS = 300
SPEED_CHANGE, SPEEDS = (0.004, 0.08), 500
"""By which share drives move at another speed, either way [-], and how many samples of that."""
SHIFT = 4e-3
"""By which onsets are moved to see what timing does [s]."""
GAP_SCALE = 0.3e-3
"""Change of an end gap that counts as much as the discrepancy of a feature [m]."""
LEAST_SOUND = 300
"""Sound throws that a detector needs."""


def layout_of_panel(panel: LoadedPanel, quantity: str = FORCE) -> Layout:
    """Return the layout of a panel's schedule, for the drives that have a quantity.

    Examples
    --------
    >>> from turnout.panel.load import load_panel
    >>> [part.name for part in layout_of_panel(load_panel("uic60-760-1-15")).parts]
    ['opening', 'closing']
    """
    ordered = sorted(panel.movement.values(), key=lambda item: float(item.start))
    names = [OPENING if item.to == "open" else CLOSING for item in ordered]
    if names not in ([OPENING, CLOSING], [CLOSING]):
        message = (
            f"panel {panel.name}: its schedule is {', '.join(names) or 'empty'}; a detector needs "
            "one closing, or an opening and then a closing"
        )
        raise StudyError([message])
    movements = [
        (
            name,
            float(item.start),
            float(item.duration) + LATER + max([0.0, *map(float, item.extra_time.values())]),
        )
        for name, item in zip(names, ordered, strict=True)
    ]
    drives = [item.drive for item in signals_of(panel, quantity)]
    return layout_of(movements, end=float(panel.schedule.end), drives=drives)


LATER = 0.1
"""By which a drive of the population may take longer than that of the panel [s]."""


def read_set(plan: Plan, dataset: xr.Dataset, layout: Layout, quantity: str = FORCE) -> ThrowSet:
    """Take features, gaps and labels of the throws of a plan."""
    complete = (dataset["outcome"].astype(str) == "complete").to_numpy()
    at = np.flatnonzero(complete)
    row = dataset["scenario"].to_numpy()[at]  # some may not be thrown yet
    recorded = dataset[CHANNELS[quantity]].sel(drive=list(layout.drives))
    force = recorded.to_numpy()[at].astype(np.float64)
    time = dataset["time"].to_numpy().astype(np.float64)
    onsets = np.tile([part.start for part in layout.parts], (len(row), 1))
    onsets[:, -1] = plan.start[row]

    def shifted(shift: float) -> Floats:
        return throw_features(time, force, layout=layout, onsets=onsets + shift)

    # a constant onset rather late shows a throw that is rather early
    rates = (shifted(-SHIFT) - shifted(SHIFT)) / (2.0 * SHIFT)
    sensors = last_values(dataset["sensor_gap"])[at]
    drives = dataset["end_gap"].to_numpy()[at]
    return ThrowSet(
        features=shifted(0.0),
        rates=rates,
        gaps=np.hstack([sensors, drives]).astype(np.float64),
        level=plan.level[row],
        inputs=plan.inputs[row],
        switch=plan.switch[row],
        partner=plan.partner[row],
        row=row,
        size=dataset[OBJECT_SIZE].to_numpy()[at],
        x=dataset[OBJECT_AT].to_numpy()[at],
        force=dataset["object_force_peak"].to_numpy()[at].astype(np.float64),
    )


def setting_of(
    panel: LoadedPanel, *, amplitude: Floats, allowances: Allowances, quantity: str = FORCE
) -> Setting:
    """Return what a detector of a panel is made for."""
    sensors = {f"sensor {name}": float(item.limit) for name, item in panel.sensor.items()}
    drives = {
        f"drive {name}": float(item.gap_limit or panel.lock.gap_limit)
        for name, item in panel.drive.items()
    }
    limits = sensors | drives
    layout = layout_of_panel(panel, quantity)
    machines = None
    if quantity != FORCE:
        nominal = panel.with_overrides({FRICTION: NOMINAL_FRICTION})
        machines = signal_errors(nominal, signals_of(panel, quantity), time=gain_times(layout))
    return Setting(
        layout=layout,
        places=places_of(panel),
        amplitude=amplitude,
        gaps=tuple(limits),
        limits=tuple(limits.values()),
        allowances=allowances,
        quantity=quantity,
        machines=machines,
    )


def teach(sets: Mapping[str, ThrowSet], setting: Setting, *, seed: int = 0) -> Knowledge:
    """Make a detector of throws; its thresholds are still to be calibrated.

    Parameters
    ----------
    sets : mapping of str to ThrowSet
        "sound", "object" and defects; "history" adds to the sound throws.
    setting : Setting
        What for.
    seed : int
        Of faults of force sensors.
    """
    sound = [sets[name] for name in (SOUND, HISTORY) if name in sets]
    level = np.concatenate([item.level for item in sound])
    if len(level) < LEAST_SOUND:
        message = f"{len(level)} sound throws ended; a detector needs {LEAST_SOUND} at least"
        raise StudyError([message])
    values = np.concatenate([item.values for item in sound])
    errors = setting.errors(values[:, : setting.layout.size].mean(axis=0))
    deviation = np.sqrt(np.diag(errors.fixed + errors.changing))
    model, residual = fit_sound_model(
        values,
        level=level,
        inputs=np.concatenate([item.inputs for item in sound]),
        rates=np.concatenate([item.rates for item in sound]),
        part=setting.layout.part,
        scale=np.concatenate([deviation, np.full(len(setting.gaps), GAP_SCALE)]),
    )
    thrown = [name for name in trained_changes() if name in sets and competes(name, setting)]
    causes = (*thrown, SENSOR, SPEED, UNUSUAL)
    x = np.array(list(setting.places.values()))
    samples = [_objects(sets[OBJECT], sets[SOUND], x)]
    for number, name in enumerate(causes[:-3], len(x)):
        samples.append(_defects(sets[name], sets[SOUND], number))
    last = len(x) + len(causes) - 1
    samples.append(_sensor_faults(sets[SOUND], setting, last - 2, seed))
    samples.append(_other_speeds(sets[SOUND], setting.layout, last - 1, seed))
    samples.append(_unusual(residual, level, last, model=model, errors=errors))
    return Knowledge(
        setting=setting,
        model=model,
        signatures=compress(samples, model=model, errors=errors),
        causes=causes,
        object_kinds=_kinds(sets, x, model=model, errors=errors),
    )


def competes(cause: str, setting: Setting) -> bool:
    """Return whether a cause shows at all in what is judged, and otherwise than another one.

    A weak supply slows all drives, a fault within a drive that one alone: of a single drive the
    force shows the same of both, and the latter stands for both.
    """
    alone = setting.quantity == FORCE and len(setting.layout.drives) == 1
    return not alone or DEFECTS[cause].slows < ALL_DRIVES


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Samples:
    """Signatures in all features, before they are compressed; attributes as of `Signatures`."""

    change: Floats
    gap: Floats
    level: Floats
    kind: NDArray[np.intp]
    size: Floats
    x: Floats


def paired(throws: ThrowSet, sound: ThrowSet) -> tuple[ThrowSet, ThrowSet]:
    """Return throws whose paired sound throw ended too, and those sound throws."""
    at = {int(row): number for number, row in enumerate(sound.row)}
    kept = np.array([int(row) in at for row in throws.partner], dtype=bool)
    own = throws.of(kept)
    return own, sound.of(np.array([at[int(row)] for row in own.partner], dtype=np.intp))


def _objects(throws: ThrowSet, sound: ThrowSet, x: Floats) -> Samples:
    """Return signatures of objects that were touched, by the nearest place."""
    own, other = paired(throws.of(throws.force > TOUCH_FORCE), sound)
    return Samples(
        change=own.features - other.features,
        gap=own.gaps - other.gaps,
        level=own.level,
        kind=np.abs(own.x[:, np.newaxis] - x).argmin(axis=1),
        size=own.size,
        x=own.x,
    )


def _kinds(
    sets: Mapping[str, ThrowSet], x: Floats, *, model: SoundModel, errors: ThrowErrors
) -> KindSignatures | None:
    """Return signatures of the same objects of each kind; None where none were thrown."""
    named = {kind: of_kind(OBJECT, kind) for kind in learned_kinds()}
    thrown = {kind: sets[name] for kind, name in named.items() if name in sets}
    if not thrown:
        return None
    last = max(int(item.row.max(initial=-1)) for item in thrown.values())
    thrown = {RIGID: sets[OBJECT].of(sets[OBJECT].row <= last)} | thrown
    samples = []
    for number, item in enumerate(thrown.values()):
        own = _objects(item, sets[SOUND], x)
        samples.append(replace(own, kind=np.full(len(own.level), number, dtype=np.intp)))
    return KindSignatures(
        names=tuple(thrown), signatures=compress(samples, model=model, errors=errors)
    )


def _defects(throws: ThrowSet, sound: ThrowSet, kind: int) -> Samples:
    own, other = paired(throws, sound)
    nothing = np.full(len(own.level), np.nan)
    return Samples(
        change=own.features - other.features,
        gap=own.gaps - other.gaps,
        level=own.level,
        kind=np.full(len(own.level), kind, dtype=np.intp),
        size=nothing,
        x=nothing,
    )


def _sensor_faults(sound: ThrowSet, setting: Setting, kind: int, seed: int) -> Samples:
    """Return what wrong gains and zeros of one sensor make of sound throws."""
    layout = setting.layout
    rng = np.random.default_rng([seed, 3])
    count = min(SENSOR_FAULTS, len(sound.level))
    rows = rng.choice(len(sound.level), count, replace=False)
    own = sound.of(rows)
    drive = rng.integers(0, len(layout.drives), count)
    sign = rng.choice([-1.0, 1.0], count)
    gain = np.where(rng.random(count) < 0.5, rng.uniform(*SENSOR_GAIN, count), 0.0) * sign
    unit = 1.0 if setting.quantity == FORCE else setting.amplitude[drive] / USUAL_FORCE
    zero = np.where(gain == 0.0, rng.uniform(*SENSOR_ZERO, count), 0.0) * sign * unit
    where = layout.drive == drive[:, np.newaxis]
    nothing = np.full(count, np.nan)
    return Samples(
        change=np.where(where, gain[:, np.newaxis] * own.features + zero[:, np.newaxis], 0.0),
        gap=np.zeros_like(own.gaps),
        level=own.level,
        kind=np.full(count, kind, dtype=np.intp),
        size=nothing,
        x=nothing,
    )


def _other_speeds(sound: ThrowSet, layout: Layout, kind: int, seed: int) -> Samples:
    """Return what another speed of all drives makes of sound throws."""
    rng = np.random.default_rng([seed, 4])
    count = min(SPEEDS, len(sound.level))
    own = sound.of(rng.choice(len(sound.level), count, replace=False))
    least, most = np.log(SPEED_CHANGE)
    share = np.exp(rng.uniform(least, most, count)) * rng.choice([-1.0, 1.0], count)
    nothing = np.full(count, np.nan)
    return Samples(
        change=stretched(own.features, layout, share) - own.features,
        gap=np.zeros_like(own.gaps),
        level=own.level,
        kind=np.full(count, kind, dtype=np.intp),
        size=nothing,
        x=nothing,
    )


def _unusual(
    residual: Floats, level: Floats, kind: int, *, model: SoundModel, errors: ThrowErrors
) -> Samples:
    """Return what the fit leaves of those sound throws that it fits worst.

    A normal distribution of residuals is a bad one where a drive seats at another instant than
    polynomials say, at the corners of what varies: low friction, Drive 2 hardly later than Drive 1
    and far adjusted. Such throws are sound, and compete with objects as samples of themselves.
    """
    size = len(errors.fixed)
    nearest = np.abs(level[:, np.newaxis] - model.level).argmin(axis=1)
    square = np.empty(len(level))
    for number in np.unique(nearest):
        own = nearest == number
        lower = np.linalg.cholesky(error_at(model, errors, int(number), level=0.0)[:size, :size])
        white = solve_triangular(lower, residual[own, :size].T, lower=True)
        square[own] = np.einsum("ij,ij->j", white, white)
    worst = np.argsort(square)[-max(1, round(UNUSUAL_SHARE * len(level))) :]
    worst = worst[square[worst] > UNUSUAL_LEAST]
    nothing = np.full(len(worst), np.nan)
    return Samples(
        change=residual[worst, :size],
        gap=residual[worst, size:],
        level=level[worst],
        kind=np.full(len(worst), kind, dtype=np.intp),
        size=nothing,
        x=nothing,
    )


UNUSUAL_SHARE, UNUSUAL_LEAST = 0.1, 1.0
"""Of sound throws, those that are fitted worst, and their least squared length, whitened [-]."""


def compress(samples: Sequence[Samples], *, model: SoundModel, errors: ThrowErrors) -> Signatures:
    """Put signatures in a basis in which small ones keep what a detector sees of them.

    Parameters
    ----------
    samples : sequence of Samples
        In all features.
    model : SoundModel
        Of sound throws.
    errors : ThrowErrors
        Beside it.
    """
    joined = {
        name: np.concatenate([getattr(item, name) for item in samples])
        for name in Samples.__slots__
    }
    size = len(errors.fixed)
    # as after a long history, when most is seen
    noise = error_at(model, errors, len(model.level) // 2, level=0.0)[:size, :size]
    lower = np.linalg.cholesky(noise)
    white = solve_triangular(lower, joined["change"].T, lower=True).T
    length = np.sqrt(np.einsum("ij,ij->i", white, white))
    even = white / np.maximum(length, CLEAR)[:, np.newaxis]
    _, sizes, directions = np.linalg.svd(even, full_matrices=False)
    explained = np.cumsum(sizes**2) / np.sum(sizes**2)
    kept = directions[: int(np.searchsorted(explained, EXPLAINED)) + 1]
    basis, mixing = np.linalg.qr(lower @ kept.T)
    change = (white @ kept.T) @ mixing.T
    return Signatures(basis=basis, **(joined | {"change": change})).by_level()


CLEAR = 5.0
"""Whitened length from which on a signature is clear, and counts by its shape alone [-]."""
EXPLAINED = 0.9995
"""Share of signatures that the basis keeps [-]."""
