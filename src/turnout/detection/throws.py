"""Throws of the reference case with and without an object, of the same states.

Three sweeps in one folder, each resumable: sound throws of the whole population; gaps after a sound
closing of the first states, at a few instants; the same first states with an object, at each place
in growing sizes.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from turnout.core.errors import StudyError
from turnout.core.files import make_folder
from turnout.core.progress import Pace
from turnout.core.workers import Workers
from turnout.detection.conditions import FORCE
from turnout.detection.drive_quantities import read_signals, signals_of
from turnout.detection.floor import touch_floor
from turnout.detection.reference import (
    FIELD_MEAN,
    FRICTION,
    NOMINAL_FRICTION,
    TEMPERATURE,
    reference_study,
    switch_inputs,
)
from turnout.detection.signal_discrepancy import Signal, SignalErrors
from turnout.detection.signal_errors import signal_errors
from turnout.law.object_kind import kind_faults
from turnout.panel.load import LoadedPanel
from turnout.study.design import Axis
from turnout.study.random_inputs import TemperatureLaw
from turnout.study.scenario import Output
from turnout.study.study import Study
from turnout.study.sweep.read import last_values, open_batches
from turnout.study.sweep.run import running, throw_studies
from turnout.study.variable import Variable, value_kind

Floats = NDArray[np.float64]

SOUND, FLOOR, OBJECTS = "sound", "floor", "objects"
OBJECT_INPUTS, KIND_INPUT = ("object.at", "object.size"), "object.kind"
ELASTIC = "spring"
"""Kind of objects that stay as they are: stiff and elastic."""
STEPS = (0.7e-3, 2.0e-3, 4.5e-3, 10.0e-3)
"""Sizes thrown at a place beyond its touch floor [m]; between them signatures are interpolated."""
QUICK_STEPS, QUICK_SOUND = (2.0e-3, 4.5e-3), 400
"""The same for a quick estimate [m], and its sound throws."""


def steps_of(*, quick: bool) -> tuple[float, ...]:
    """Return the sizes thrown at a place beyond its touch floor [m]."""
    return QUICK_STEPS if quick else STEPS


RESOLUTION = 0.1e-3
"""Thrown sizes are whole multiples of this [m]."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Throws:
    """Inputs of the bound.

    Attributes
    ----------
    sound : ndarray, shape (n_sound, n_signals, n_times)
        Signals of sound throws: drive forces [N], currents [A], powers [W].
    time : ndarray, shape (n_times,)
        [s]
    switch : ndarray, shape (n_sound, n_inputs)
        What is fixed for a switch, in SI.
    level : ndarray, shape (n_sound,)
        Mean friction coefficient of the chairs in each throw [-].
    states : ndarray of int, shape (n_states,)
        Rows of `sound` that were also thrown with objects.
    change : ndarray, shape (n_states, n_places, n_sizes, n_signals, n_times)
        Signal with an object less that without; NaN where the object found no room.
    force_peak : ndarray, shape (n_states, n_places, n_sizes)
        Largest force on the object [N].
    gap : ndarray, shape (n_states, n_places)
        After a sound closing [m].
    places : tuple of str
    x : ndarray, shape (n_places,)
        [m]
    sizes : ndarray, shape (n_places, n_sizes)
        Thrown at each place [m].
    errors : SignalErrors
        How the discrepancy shows in each signal.
    signals : tuple of Signal
        What was recorded of the drives.
    kind : str
        Of the objects.
    panel, panel_hash : str
        Name and hash of the panel.
    """

    sound: Floats
    time: Floats
    switch: Floats
    level: Floats
    states: NDArray[np.intp]
    change: Floats
    force_peak: Floats
    gap: Floats
    places: tuple[str, ...]
    x: Floats
    sizes: Floats
    errors: SignalErrors
    signals: tuple[Signal, ...]
    kind: str = ELASTIC
    panel: str = ""
    panel_hash: str = ""

    @property
    def amplitude(self) -> Floats:
        """Peak of each signal in the nominal sound throw [N], [A] or [W]."""
        return self.errors.amplitude


def places_of(panel: LoadedPanel) -> dict[str, float]:
    """Return where objects are tried, from the toe on: every sleeper and every drive [m].

    Examples
    --------
    >>> from turnout.panel.load import load_panel
    >>> list(places_of(load_panel("uic60-760-1-15")))[:2]
    ['drive 1', 'sleeper 1']
    """
    found = {f"drive {name}": drive.x for name, drive in panel.drive.items()}
    found |= {f"sleeper {name}": sleeper.x for name, sleeper in panel.sleeper.items()}
    return dict(sorted(found.items(), key=lambda item: item[1]))


def closing_time(panel: LoadedPanel | None = None) -> float:
    """Return when the last movement of the panel's schedule begins [s].

    Examples
    --------
    >>> closing_time()
    4.4
    """
    loaded = reference_study(panel, count=1).panel
    return max(float(item.start) for item in loaded.movement.values())


def nominal_amplitude(study: Study, *, friction: float, quantity: str = FORCE) -> Floats:
    """Return the peak of a quantity of each drive in a sound throw of the panel itself.

    Of forces absolute [N], of currents [A] and powers [W] after the inrush.
    """
    panel = study.panel.with_overrides({FRICTION: friction})
    errors = signal_errors(
        panel, signals_of(panel, quantity), time=np.zeros(1), scheme=study.scheme
    )
    return errors.amplitude


def floor_study(study: Study) -> Study:
    """Return a study that keeps gaps along the rails, at few instants, the last after closing."""
    return few_instants(study, "gap", title="gaps")


def few_instants(study: Study, *channels: str, title: str) -> Study:
    """Return a study that keeps some channels at few instants, the last after closing."""
    end = float(study.panel.schedule.end)
    rate = 2.0 if (2.0 * end).is_integer() else 1.0
    kept = Output(rate=rate, channels=channels)
    return replace(study, name=f"{study.name}, {title}", output=kept)


def objects_study(
    study: Study, sizes: Mapping[str, Sequence[float]], *, kind: str = ELASTIC
) -> Study:
    """Return a study that throws each state with objects, at each place in rising sizes.

    Parameters
    ----------
    study : Study
        Without an object.
    sizes : mapping of str to sequence of float
        At each place [m].
    kind : str
        Of the objects, with the default parameters of that kind.
    """
    check_kind(kind)
    own = () if kind == ELASTIC else (kind,)
    names = OBJECT_INPUTS + ((KIND_INPUT,) if own else ())
    rows = tuple((place, size, *own) for place, given in sizes.items() for size in given)
    added = {
        name: Variable(name=name, key=name, kind=value_kind(study.panel, name)) for name in names
    }
    return replace(
        study,
        name=f"{study.name}, objects",
        design=replace(study.design, axes=(Axis(names=names, rows=rows),)),
        variables=added | dict(study.variables),
    )


def check_kind(kind: str) -> None:
    """Refuse a kind of object that there is not."""
    faults = [f"--kind{text}" for _, text in kind_faults(kind, {})]
    if faults:
        raise StudyError(faults, source="limit")


def of_kind(folder: str, kind: str) -> str:
    """Return the name of a folder for throws with objects of a kind.

    Examples
    --------
    >>> of_kind("objects", "ice"), of_kind("objects", "spring")
    ('objects-ice', 'objects')
    """
    return folder if kind == ELASTIC else f"{folder}-{kind}"


def sizes_beyond(floor: Floats, steps: Sequence[float] = STEPS) -> Floats:
    """Return the sizes to throw at places with some touch floors, shape (n_places, n_sizes) [m]."""
    sizes = np.asarray(floor)[:, np.newaxis] + np.array(steps)
    return np.asarray(np.round(sizes / RESOLUTION) * RESOLUTION)


def throw_all(
    panel: LoadedPanel | None,
    folder: Path,
    *,
    sound: int,
    states: int,
    channels: str = FORCE,
    steps: Sequence[float] = STEPS,
    over_travel: float | None = None,
    kind: str = ELASTIC,
    workers: int | Workers = 1,
    pace: Pace | None = None,
) -> Throws:
    """Throw what is missing of the three sweeps in a folder, and read them.

    Parameters
    ----------
    panel : LoadedPanel or None
        None for the panel of the reference case.
    folder : Path
        Made if it is not there.
    sound, states : int
        Sound throws, and how many of their states are thrown with objects.
    channels : str
        What is evaluated: "force", "current", "power" or "all"; throws keep all there is.
    steps : sequence of float
        Sizes thrown at a place beyond its touch floor [m].
    over_travel : float, optional
        As `reference_study` takes it [m].
    kind : str
        Of the objects; those of another kind lie beside them in the folder.
    workers : int or Workers
        Processes.
    pace : Pace, optional
        Counts the throws.
    """
    whole = reference_study(panel, count=sound, over_travel=over_travel)
    first = reference_study(panel, count=states, over_travel=over_travel)
    signals = signals_of(whole.panel, channels)
    make_folder(folder)

    where, pace, own = places_of(whole.panel), pace or Pace(), of_kind(OBJECTS, kind)
    counts = throw_counts(panel, sound=sound, states=states, steps=steps, kind=kind)
    for name, count in counts.items():
        pace.plan(name, count)
    with running(workers) as processes:

        def run(studies: Mapping[str, Study]) -> list[xr.Dataset]:
            kept = {folder / name: study for name, study in studies.items()}
            throw_studies(kept, workers=processes, pace=pace)
            return [checked_throws(open_batches(path), panel=whole.panel.name) for path in kept]

        x = np.array(list(where.values()))
        (floor,) = run({FLOOR: floor_study(first)})
        gaps = gaps_at(floor, x, rail=whole.panel.object_defaults.rail)
        refuse_open_end(whole.panel, where, gaps)
        sizes = sizes_beyond(touch_floor(gaps), steps)
        rows = {place: tuple(map(float, sizes[i])) for i, place in enumerate(where)}
        with_objects = objects_study(first, rows, kind=kind)
        sound_set, object_set = run({SOUND: whole, own: with_objects})
    found = throws_from(
        whole, sound_set, object_set, gap=gaps, where=where, sizes=sizes, signals=signals
    )
    return replace(found, kind=kind)


def throw_counts(
    panel: LoadedPanel | None, *, sound: int, states: int, steps: Sequence[float], kind: str
) -> dict[str, int]:
    """Return the throws of each of the sweeps of `throw_all`, by folder."""
    each = len(places_of(reference_study(panel, count=1).panel)) * len(steps)
    return {FLOOR: states, SOUND: sound, of_kind(OBJECTS, kind): states * each}


def checked_throws(
    dataset: xr.Dataset, *, panel: str, of: str = "the population", source: str = "limit"
) -> xr.Dataset:
    """Return a sweep, refused if most of its throws cannot be made."""
    outcome = dataset["outcome"].astype(str).to_numpy()
    lost = outcome != "complete"
    if lost.mean() > MOST_LOST:
        reasons = dataset["reason"].astype(str).to_numpy()[lost] if "reason" in dataset else [""]
        first = reasons[0] or outcome[lost][0]
        message = (
            f"{int(lost.sum())} of {lost.size} throws of {of} of panel {panel} did not "
            f"end; check the panel (turnout panel check). The first: {first}"
        )
        raise StudyError([message], source=source)
    return dataset


MOST_LOST = 0.5
"""Share of throws that may fail, such as objects that find no room [-]."""
OPEN = 30e-3
"""Touch floor at a drive from which the rail counts as open [m]."""


def refuse_open_end(panel: LoadedPanel, where: Mapping[str, float], gaps: Floats) -> None:
    """Refuse a panel whose last movement does not close the rail that objects lie at."""
    floor = dict(zip(where, touch_floor(gaps).tolist(), strict=True))
    open_at = [f"drive {name}" for name in panel.drive if not floor[f"drive {name}"] < OPEN]
    if len(open_at) == len(panel.drive):
        message = (
            f"the last movement of panel {panel.name} leaves rail {panel.object_defaults.rail} "
            f"open ({1e3 * floor[open_at[0]]:.0f} mm at {open_at[0]} in one of ten states): let it "
            "close that rail, or set object_defaults.rail to the other"
        )
        raise StudyError([message], source="limit")


def stored_throws(
    panel: LoadedPanel | None, folder: Path, *, channels: str = FORCE, kind: str = ELASTIC
) -> Throws:
    """Read the three sweeps of a folder as they are, whichever version of turnout made them.

    Parameters
    ----------
    panel : LoadedPanel or None
        As they were thrown with.
    folder : Path
        That of `throw_all`.
    channels : str
        What is evaluated.
    kind : str
        Of the objects.
    """
    names = (SOUND, FLOOR, of_kind(OBJECTS, kind))
    sound, floor, objects = (open_batches(folder / name) for name in names)
    study = reference_study(panel, count=sound.sizes["scenario"])
    where = places_of(study.panel)
    gaps = gaps_at(floor, np.array(list(where.values())), rail=study.panel.object_defaults.rail)
    # every state has the same sizes, so those of the first one are the sizes of all
    thrown = objects["object.size"].to_numpy()[: objects.sizes["scenario"] // len(gaps)]
    found = throws_from(
        study, sound, objects, gap=gaps, where=where, sizes=thrown.reshape(len(where), -1),
        signals=signals_of(study.panel, channels),
    )  # fmt: skip
    return replace(found, kind=kind)


def gaps_at(dataset: xr.Dataset, x: Floats, *, rail: str) -> Floats:
    """Return gaps at the end of each throw at some places, shape (n_states, n_places) [m]."""
    last = last_values(dataset["gap"].sel(rail=rail))
    along = dataset["x"].to_numpy()
    there = np.isfinite(last).any(axis=0)
    return np.array([np.interp(x, along[there], row[there]) for row in last])


def throws_from(
    study: Study,
    sound: xr.Dataset,
    objects: xr.Dataset,
    *,
    gap: Floats,
    where: Mapping[str, float],
    sizes: Floats,
    signals: Sequence[Signal],
) -> Throws:
    """Put sweeps together; states without a complete sound throw are left out."""
    until = slice(None, float(study.panel.schedule.end) + 1e-9)  # some waited for machines
    sound, objects = sound.sel(time=until), objects.sel(time=until)
    force = read_signals(sound, signals)
    complete = (sound["outcome"].astype(str) == "complete").to_numpy()
    law = study.law or TemperatureLaw()
    warmth = np.array([law.factor(t) for t in sound[TEMPERATURE].to_numpy().astype(float)])
    level = sound[FRICTION].to_numpy() * sound[FIELD_MEAN].to_numpy() * warmth
    fixed = np.stack([sound[name].to_numpy() for name in switch_inputs(study)], axis=1)
    count = gap.shape[0]
    shape = (count, len(where), sizes.shape[1])
    with_object = read_signals(objects, signals).reshape(*shape, *force.shape[1:])
    peak = objects["object_force_peak"].to_numpy().reshape(shape)
    used = complete[:count]
    rows = np.cumsum(complete)[:count][used] - 1
    return Throws(
        sound=force[complete],
        time=sound["time"].to_numpy(),
        switch=fixed[complete],
        level=level[complete],
        states=rows.astype(np.intp),
        change=(with_object - force[:count, np.newaxis, np.newaxis])[used],
        force_peak=peak[used],
        gap=gap[used],
        places=tuple(where),
        x=np.array(list(where.values())),
        sizes=sizes,
        errors=signal_errors(
            study.panel.with_overrides({FRICTION: NOMINAL_FRICTION}),
            signals,
            time=sound["time"].to_numpy(),
            scheme=study.scheme,
        ),
        signals=tuple(signals),
        panel=study.panel.name,
        panel_hash=study.panel.hash,
    )
