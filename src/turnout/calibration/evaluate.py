"""Throws for a fit: in worker processes, each kept on disk by the content of what made it."""

import gc
from collections import OrderedDict
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import Any, Self, cast

import numpy as np
from numpy.typing import NDArray

from turnout.core.errors import FileError, TurnoutError
from turnout.core.files import make_folder
from turnout.core.kept_results import read_arrays, write_arrays
from turnout.core.provenance import content_hash, version
from turnout.core.scheme import Scheme
from turnout.core.threads import one_blas_thread
from turnout.core.workers import Workers
from turnout.panel.foreign_object import ForeignObject
from turnout.panel.load import LoadedPanel
from turnout.solver.outcome import Code
from turnout.throw.route import throws
from turnout.throw.simulate import Solved, solve

Floats = NDArray[np.float64]
# Means over cells of this length are kept [s]: an impact keeps its impulse.
CELL = 4e-3
# Raised when old ones can no longer be read.
STORED_VERSION = 5
# Throws that are kept in memory, of some 20 kB each.
MOST_IN_MEMORY = 4000
LATE = "a machine had not arrived when the next movement was to begin: let that begin later"
# Step of a fine throw, as a share of the one of the scheme: after an impact steps of 1 ms bias
# stiffnesses by 0.1 to 0.2 %, as do modes to 300 Hz on the default panel. So many times as high
# they go. Elements of half the length cost nothing once their matrices are made.
FINE, FINE_MODES, FINE_MESH = 0.5, 4.0, 0.5
# Quick throws stand in for plain ones near by, so they dissipate as much at high frequencies.
QUICK = Scheme.of("quick", spectral_radius=Scheme().spectral_radius)
# Kinds of throws, and what each takes of processor time, in quick throws: by the quick scheme; with
# the steps of the scheme but the modes of the quick one, where forces are off by a constant and
# differences between throws are not; as the scheme says; with half its step and elements half as
# long; and with modes to four times the frequency as well, where a fit ends.
WORK = {"quick": 1.0, "lean": 2.0, "plain": 3.5, "halved": 10.0, "fine": 18.0}
WITH_HALF_ELEMENTS = ("halved", "fine")


@dataclass(frozen=True, slots=True, kw_only=True)
class ThrowInputs:
    """One simulation that a fit needs.

    Attributes
    ----------
    overrides : mapping of str to float
        Changes of the panel, in SI.
    place, size : str, float
        Of the object; "none" and 0 without one [m].
    kind : str
        Of `WORK`.
    """

    overrides: Mapping[str, object]
    place: str = "none"
    size: float = 0.0
    kind: str = "plain"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Response:
    """Kept values of a simulation.

    Attributes
    ----------
    time : ndarray, shape (n,)
        Middle of each cell on the panel's schedule [s].
    drive_force : mapping of drive to ndarray, shape (n,)
        Means over cells: force on the rail [N], positive closing.
    object_force : ndarray, shape (n,)
        Means over cells, in compression [N].
    onsets : mapping of direction to float
        Start of the last movement in that direction [s].
    contact_time : float
        First touch of the object, NaN where there is none [s].
    failure : str
        Why the simulation ended early; empty where it did not.
    """

    time: Floats
    drive_force: Mapping[str, Floats]
    object_force: Floats
    onsets: Mapping[str, float]
    contact_time: float = float("nan")
    failure: str = ""


@dataclass(slots=True, eq=False)
class Evaluator:
    """Worker processes and what they have simulated so far; use as a context manager.

    Attributes
    ----------
    panel : LoadedPanel
        What throws change.
    folder : Path or None
        Where throws are kept, so that a run that was stopped goes on; None keeps nothing.
    workers : int or Workers
        Processes; with one, all is done in this one. Or those of `throw_processes`.
    scheme, quick : Scheme
        Numerical choices, and those for throws that may be quick.
    on_throw : callable or None
        Called after each throw.
    on_step : callable or None
        Called with the root mean square of the residuals after each step of a fit.
    made, reused : int
        Throws simulated, and taken from the folder.
    work : float
        Processor time of all these, in quick throws.
    spared : float
        The part of it that throws from the folder would have taken.
    """

    panel: LoadedPanel
    folder: Path | None = None
    workers: int | Workers = 1
    scheme: Scheme = field(default_factory=Scheme)
    quick: Scheme = field(default_factory=lambda: QUICK)
    on_throw: Callable[[], None] | None = None
    on_step: Callable[[float], None] | None = None
    made: int = 0
    reused: int = 0
    work: float = 0.0
    spared: float = 0.0
    _known: "OrderedDict[str, Response]" = field(default_factory=OrderedDict)
    _running: ExitStack = field(default_factory=ExitStack)
    _processes: Workers = field(default_factory=lambda: Workers(0))
    _shared: dict[str, str] = field(default_factory=dict)

    def __enter__(self) -> Self:
        """Make the folder; processes start when there is something to do."""
        if self.folder is not None:
            make_folder(self.folder)
        self._processes = self._running.enter_context(_workers_of(self.panel, self.workers))
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """End the processes, at once after Ctrl-C."""
        self._running.__exit__(kind, error, trace)

    def responses(self, throws: Sequence[ThrowInputs]) -> list[Response]:
        """Return the response of each throw; equal ones are made once.

        Raises
        ------
        KeyboardInterrupt
            On Ctrl-C; what was simulated by then is kept.
        """
        keys = [self._key(throw) for throw in throws]
        missing: dict[str, ThrowInputs] = {}
        for key, throw in zip(keys, throws, strict=True):
            if key in self._known or key in missing:
                continue
            stored = self._read(key)
            if stored is None:
                missing[key] = throw
            else:
                self._known[key] = stored
                self.reused += 1
                self.work += WORK[throw.kind]
                self.spared += WORK[throw.kind]
        for key, response in self._made(missing):
            self._write(key, response)
            self._known[key] = response
            self.made += 1
            self.work += WORK[missing[key].kind]
            if self.on_throw is not None:
                self.on_throw()
        found = [self._known[key] for key in keys]
        while len(self._known) > MOST_IN_MEMORY:
            self._known.popitem(last=False)
        return found

    def step_made(self, rms: float) -> None:
        """Report a step of a fit, with the root mean square of its residuals."""
        if self.on_step is not None:
            self.on_step(rms)

    def _made(self, missing: Mapping[str, ThrowInputs]) -> Iterator[tuple[str, Response]]:
        jobs = [(key, throw, self._scheme_of(throw.kind)) for key, throw in missing.items()]
        processes = self._processes
        if processes.count < 1 or (len(jobs) <= 1 and processes.idle):
            for key, throw, scheme in jobs:
                yield key, simulate_throw(self.panel, throw, scheme)
            return
        messages = [partial(_simulate_in_worker, some) for some in _messages(jobs)]
        for _, found in processes.run(messages):
            yield from found

    def _scheme_of(self, kind: str) -> Scheme:
        if kind == "quick":
            return self.quick
        cutoff = self.quick.cutoff_frequency if kind == "lean" else self.scheme.cutoff_frequency
        return replace(
            self.scheme,
            step=self.scheme.step * (FINE if kind in WITH_HALF_ELEMENTS else 1.0),
            cutoff_frequency=cutoff * (FINE_MODES if kind == "fine" else 1.0),
        )

    def _key(self, throw: ThrowInputs) -> str:
        return content_hash(
            {
                "by": self._by(throw.kind),
                "overrides": {  # as plain data, whose text is unique to its value
                    key: value if isinstance(value, str | int | float | bool) else repr(value)
                    for key, value in throw.overrides.items()
                },
                "object": [throw.place, throw.size],
            }
        )

    def _by(self, kind: str) -> str:
        """Return a hash of what throws of a kind share."""
        if kind not in self._shared:
            self._shared[kind] = content_hash(
                {
                    "panel": self.panel.hash,
                    "scheme": asdict(self._scheme_of(kind)),
                    "mesh": FINE_MESH if kind in WITH_HALF_ELEMENTS else 1.0,
                    "version": f"{version()} {STORED_VERSION}",
                }
            )
        return self._shared[kind]

    def _read(self, key: str) -> Response | None:
        if self.folder is None:
            return None
        return read_arrays(self.folder / f"{key[:40]}.npz", key, unpacked)

    def _write(self, key: str, response: Response) -> None:
        # A folder that may not be written to costs time after a stop, never a result.
        if self.folder is not None:
            with suppress(FileError):
                # A throw that a power cut tears is simulated again; waiting for the disk is slower.
                path = self.folder / f"{key[:40]}.npz"
                write_arrays(path, key, packed(response), durable=False)


def throws_done(evaluator: Evaluator) -> int:
    """Return how many throws were made, or taken from those kept, so far."""
    return evaluator.made + evaluator.reused


Job = tuple[str, ThrowInputs, Scheme]


def _messages(jobs: Sequence[Job]) -> list[list[Job]]:
    """Return jobs as they are sent to processes.

    Those of a place whose elements are halved go together, as the process that made their matrices
    has them; first, as they take longest, and single throws then keep all processes busy.
    """
    places, single = dict[str, list[Job]](), list[list[Job]]()
    for job in jobs:
        if job[1].kind in WITH_HALF_ELEMENTS:
            places.setdefault(job[1].place, []).append(job)
        else:
            single.append([job])
    return [*places.values(), *single]


@contextmanager
def throw_processes(panel: LoadedPanel, workers: int, folder: Path) -> Iterator[Workers]:
    """Start processes for an `Evaluator` at once, so that they load while this one still reads.

    Where throws are kept already, perhaps none is missing, and they start when one is.

    Parameters
    ----------
    panel, workers, folder
        As of the `Evaluator`.
    """
    with _workers_of(panel, workers) as processes:
        if not (folder.is_dir() and any(folder.iterdir())):
            processes.start(_throw_once)
        yield processes


@contextmanager
def _workers_of(panel: LoadedPanel, workers: int | Workers) -> Iterator[Workers]:
    """Give the workers that run already, or so many for this block; one works in this process."""
    if isinstance(workers, Workers):
        yield workers
        return
    with Workers(workers if workers > 1 else 0, panel, prepare=_begin_worker) as found:
        yield found


# What a worker process throws; sent once, so that it keeps what is prepared from it.
_panels: list[LoadedPanel] = []


def _begin_worker(panel: LoadedPanel) -> None:
    """Keep the panel."""
    _panels[:] = [panel]
    gc.enable()


def _throw_once() -> None:
    """Load what the first throw of a process needs."""
    simulate_throw(_panels[0], ThrowInputs(overrides={}), QUICK)


def _simulate_in_worker(jobs: Sequence[Job]) -> list[tuple[str, Response]]:
    with one_blas_thread():
        return [(key, simulate_throw(_panels[0], throw, scheme)) for key, throw, scheme in jobs]


def simulate_throw(panel: LoadedPanel, throw: ThrowInputs, scheme: Scheme) -> Response:
    """Simulate one throw of a panel; what goes wrong with it comes back as its failure."""
    try:
        overrides = dict(throw.overrides)
        if throw.kind in WITH_HALF_ELEMENTS:
            length = panel.discretisation.element_length
            overrides["discretisation.element_length"] = FINE_MESH * length
        changed = panel.with_overrides(overrides) if overrides else panel
        foreign = ForeignObject(throw.size, throw.place) if throw.size > 0 else None
        solved = solve(changed, foreign_object=foreign, scheme=scheme)
    except TurnoutError as error:
        return _failed(str(error))
    if solved.history.outcome.code == Code.INTERRUPTED:
        raise KeyboardInterrupt
    return fitted_part(changed, solved)


def fitted_part(panel: LoadedPanel, solved: Solved) -> Response:
    """Return what a fit keeps of a simulation.

    Parameters
    ----------
    panel : LoadedPanel
        That was simulated.
    solved : Solved
        As the solver left it.
    """
    history, index = solved.history, solved.mechanism.index
    time = history.time
    late = history.machines is not None and any(p.length for p in history.machines.pauses[:-1])
    if late or time.size < 2:
        return _failed(LATE if late else history.outcome.message())
    edges = np.linspace(time[0], time[-1], max(2, round((time[-1] - time[0]) / CELL) + 1))

    def means(values: Floats) -> Floats:
        steps = 0.5 * (values[1:] + values[:-1]) * np.diff(time)
        total = np.concatenate(([0.0], np.cumsum(steps)))
        return _small(np.diff(np.interp(edges, time, total)) / np.diff(edges))

    objects = list(index.object.values())
    touches = history.law_first[objects]
    return Response(
        time=0.5 * (edges[1:] + edges[:-1]),
        drive_force={name: means(-history.law_force[:, index.drive[name]]) for name in panel.drive},
        # Without an object placed, nothing presses on the load cell.
        object_force=means(np.nan_to_num(history.law_force[:, objects].sum(axis=1))),
        onsets={movement.direction: movement.start for movement in throws(panel)},
        contact_time=float(np.nanmin(touches)) if np.isfinite(touches).any() else float("nan"),
        failure="" if history.outcome.complete else history.outcome.message(),
    )


def with_change(base: Response, after: Response, before: Response) -> Response:
    """Return a response with the difference of two others, which are on the same times."""
    if after.failure or before.failure:
        return after if after.failure else before
    return replace(
        base,
        drive_force={
            name: row + (after.drive_force[name] - before.drive_force[name])
            for name, row in base.drive_force.items()
        },
        object_force=base.object_force + (after.object_force - before.object_force),
    )


def _failed(reason: str) -> Response:
    no = np.zeros(0)
    return Response(time=no, drive_force={}, object_force=no, onsets={}, failure=reason)


def packed(response: Response) -> dict[str, NDArray[Any]]:
    """Return a response as arrays, of which `unpacked` makes it again."""
    drives = list(response.drive_force)
    shape = (len(drives), response.time.size)
    return {
        "time": response.time,
        "drives": np.array(drives, dtype=np.str_),
        "drive_force": _small(list(response.drive_force.values())).reshape(shape),
        "object_force": _small(response.object_force),
        "directions": np.array(list(response.onsets), dtype=np.str_),
        "onsets": np.array(list(response.onsets.values())),
        "contact_time": np.array(response.contact_time),
        "failure": np.array(response.failure),
    }


def _small(values: object) -> Floats:
    """Return values in half the room, in single precision; they keep seven digits."""
    return cast("Floats", np.asarray(values, dtype=np.float32))


def unpacked(kept: Mapping[str, NDArray[Any]], _: object) -> Response:
    """Return a response from its `packed` arrays."""
    names = [str(name) for name in kept["drives"]]
    directions = [str(name) for name in kept["directions"]]
    return Response(
        time=kept["time"],
        drive_force=dict(zip(names, kept["drive_force"], strict=True)),
        object_force=kept["object_force"],
        onsets={name: float(value) for name, value in zip(directions, kept["onsets"], strict=True)},
        contact_time=float(kept["contact_time"]),
        failure=str(kept["failure"]),
    )
