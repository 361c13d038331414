"""Simulate a throw: panel, objects in their places, mechanism, history, dataset."""

import functools
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from turnout.core.errors import ResponseError
from turnout.core.lru_cache import LRUCache
from turnout.core.scheme import Mode, Scheme, chosen_scheme
from turnout.core.threads import one_blas_thread
from turnout.mechanism.build import build_mechanism
from turnout.mechanism.drive_machines import schedule_waits
from turnout.mechanism.mechanism import Mechanism
from turnout.panel.foreign_object import ForeignObject, PlacedObject, resolve_objects
from turnout.panel.load import LoadedPanel, load_panel
from turnout.panel.markers import (
    marker_offsets,
    marker_positions,
    motion_key,
    movement_time,
    prior_movement,
    prior_positions,
)
from turnout.solver.arrange import clear_memory
from turnout.solver.integration import Floats, History, RunPlan, carry_out, integrate, plan_run
from turnout.solver.outcome import NotConverged
from turnout.solver.record import SaveAt
from turnout.solver.start import PriorMotion
from turnout.throw.breaking import break_attributes, peak_attributes
from turnout.throw.compilation import WITH_MACHINES, must_compile
from turnout.throw.save import Save

if TYPE_CHECKING:
    import xarray as xr


def simulate(
    panel: LoadedPanel,
    *,
    foreign_object: ForeignObject | Sequence[ForeignObject] | None = None,
    mode: Mode | None = None,
    scheme: Scheme | None = None,
    save: Save | None = None,
    throw: bool = True,
    report: Callable[[int, int], None] | None = None,
) -> "xr.Dataset":
    """Throw a switch from its start position through its whole schedule.

    Parameters
    ----------
    panel : LoadedPanel
        From `load_panel`.
    foreign_object : ForeignObject or sequence of them, optional
        Trapped objects, in addition to the objects of the panel itself.
    mode : {"waveform", "quick", "quasi-static"}, optional
        Level of detail: impacts and single chairs; drives, gaps and labels, several
        times as fast; or without inertia. Default "waveform".
    scheme : Scheme, optional
        Numerical choices of your own in place of a mode, such as
        ``Scheme.of("quick", step=2e-3)``.
    save : Save, optional
        How often, where and what to keep.
    throw : bool
        Whether a run that ends early raises; otherwise its dataset comes back with
        ``attrs["complete"]`` false and the reason in ``attrs["outcome_message"]``.
    report : callable, optional
        Called now and then with steps done and steps in all.

    Returns
    -------
    xarray.Dataset
        Channels, energies and labels of the schema, in SI; lateral quantities are positive in the
        closing direction of the instrumented rail.

    Raises
    ------
    ResponseError
        When `panel` is no loaded panel, or both `mode` and `scheme` are given.
    SolverError
        When there is no such mode.
    PanelError
        When a foreign object does not fit the panel.
    NotConverged
        When the run ends early, with the response until then as ``partial``.

    Examples
    --------
    >>> from turnout.panel.load import load_panel
    >>> panel = load_panel("sb1").with_overrides({"schedule.end": "1.5 s"})  # doctest: +SKIP
    >>> simulate(panel)["drive_force"].dims  # doctest: +SKIP
    ('drive', 'time')
    """
    if not isinstance(panel, LoadedPanel):
        message = f"simulate() takes a panel from load_panel(), not {type(panel).__name__}"
        raise ResponseError(message)
    for name, given, kind in (("scheme", scheme, Scheme), ("save", save, Save)):
        if given is not None and not isinstance(given, kind):
            message = f"simulate(): {name} = {given!r} must be a {kind.__name__}"
            raise ResponseError(message)
    return simulate_placed(
        panel,
        resolve_objects(panel, as_objects(foreign_object)),
        scheme=chosen_scheme(mode, scheme, caller="simulate()"),
        save=save or Save(),
        throw=throw,
        report=report,
    )


def simulate_placed(
    panel: LoadedPanel,
    objects: tuple[PlacedObject, ...],
    *,
    scheme: Scheme,
    save: Save,
    throw: bool = True,
    report: Callable[[int, int], None] | None = None,
) -> "xr.Dataset":
    """Simulate a throw with all objects in their places, those of the panel among them."""
    if save.interval is not None:
        scheme = replace(scheme, output_interval=save.interval)
    began = time.perf_counter()
    with one_blas_thread():  # nested limits are free
        solved = solve_placed(panel, objects, scheme=scheme, report=report)
        from turnout.throw.dataset import describe_run, response_dataset  # the solver needs none

        dataset = response_dataset(panel, solved.mechanism, solved.history, save=save)
        taken = time.perf_counter() - began - solved.compile_time
        further = peak_attributes((solved.mechanism, solved.history), scheme)
        further |= _compare_breaks(panel, solved, scheme)
    attributes = describe_run(
        panel,
        solved.mechanism,
        solved.history,
        scheme=scheme,
        objects=solved.objects,
        wall_time=taken,
        solver_time=solved.solver_time,
    )
    dataset.attrs.update(attributes | further)
    if throw and not solved.history.outcome.complete:
        raise NotConverged(solved.history.outcome, partial=dataset)
    return dataset


def release_memory() -> None:
    """Free memory that a next run would use again: histories, condensed rails."""
    from turnout.throw.dataset_template import clear_datasets
    from turnout.throw.output_rows import row_blocks

    clear_memory()
    row_blocks.clear()
    clear_datasets()


def prepare_panel(
    panel: LoadedPanel,
    *,
    foreign_object: ForeignObject | Sequence[ForeignObject] | None = None,
) -> None:
    """Reduce the rails of a throw that may come, so that `simulate` finds them in memory.

    Parameters
    ----------
    panel : LoadedPanel
        From `load_panel`.
    foreign_object : ForeignObject or sequence of them, optional
        Objects that may be trapped; their places count, their sizes do not.

    Raises
    ------
    PanelError
        When a foreign object does not fit the panel.

    Examples
    --------
    >>> from turnout.panel.load import load_panel
    >>> prepare_panel(load_panel("sb1"))
    """
    build_mechanism(panel, resolve_objects(panel, as_objects(foreign_object)))


@dataclass(frozen=True, slots=True)
class Solved:
    """A throw as the solver left it, before it becomes a dataset.

    Attributes
    ----------
    mechanism : Mechanism
        Integrated mechanism.
    history : History
        Results of the integration, complete or not.
    objects : tuple of PlacedObject
        The foreign objects with their places.
    solver_time, compile_time : float
        Taken to build and integrate, and before that to compile kernels [s].
    build_time : float
        The part of the solver's time in which the mechanism was built [s].
    processor_time : float
        That processors took for building and integrating [s].
    """

    mechanism: Mechanism
    history: History
    objects: tuple[PlacedObject, ...]
    solver_time: float
    compile_time: float
    build_time: float
    processor_time: float


def solve(
    panel: LoadedPanel,
    *,
    foreign_object: ForeignObject | Sequence[ForeignObject] | None = None,
    scheme: Scheme,
    report: Callable[[int, int], None] | None = None,
) -> Solved:
    """Build the mechanism of a panel and integrate it; `simulate` is this and a dataset.

    Parameters
    ----------
    panel : LoadedPanel
        From `load_panel`.
    foreign_object : ForeignObject or sequence of them, optional
        Trapped objects.
    scheme : Scheme
        Numerical choices.
    report : callable, optional
        Called now and then with steps done and steps in all.

    Returns
    -------
    Solved
        A run that ends early is returned as it is; see ``history.outcome``.

    Raises
    ------
    PanelError
        When a foreign object does not fit the panel.
    """
    objects = resolve_objects(panel, as_objects(foreign_object))
    return solve_placed(panel, objects, scheme=scheme, report=report)


def solve_placed(
    panel: LoadedPanel,
    objects: tuple[PlacedObject, ...],
    *,
    scheme: Scheme,
    report: Callable[[int, int], None] | None = None,
    save_at: Callable[[Mechanism], SaveAt] | None = None,
) -> Solved:
    """Solve a throw with all objects in their places, those of the panel among them.

    `save_at` says for a mechanism what alone is wanted of its run.
    """
    with one_blas_thread():  # nested limits are free
        planned = plan_throw(panel, objects, scheme=scheme, save_at=save_at)
        return solve_planned(planned, report=report)


@dataclass(frozen=True, slots=True)
class PlannedThrow:
    """A throw that can be solved; times as of `Solved`, those that planning took.

    Attributes
    ----------
    mechanism : Mechanism
        Mechanism to be integrated.
    run : RunPlan
        How.
    objects : tuple of PlacedObject
        The foreign objects with their places.
    solver_time, compile_time, build_time, processor_time : float
        [s]
    """

    mechanism: Mechanism
    run: RunPlan
    objects: tuple[PlacedObject, ...]
    solver_time: float
    compile_time: float
    build_time: float
    processor_time: float


def plan_throw(
    panel: LoadedPanel,
    objects: tuple[PlacedObject, ...],
    *,
    scheme: Scheme,
    save_at: Callable[[Mechanism], SaveAt] | None = None,
    nominal: LoadedPanel | None = None,
) -> PlannedThrow:
    """Do all of `solve_placed` that comes before its kernels.

    `nominal` is the panel whose rails give the shapes of varied ones, see `build_mechanism`.
    """
    began = time.perf_counter()
    machines = any(drive.machine is not None for drive in panel.drive.values())
    if machines and must_compile(WITH_MACHINES):
        compile_kernels(machines=True)
    elif must_compile():
        compile_kernels()
    compiled, used = time.perf_counter(), time.process_time()
    mechanism = build_mechanism(panel, objects, nominal=nominal)
    built = time.perf_counter()
    run = plan_run(
        mechanism,
        scheme,
        inputs=lambda instants: marker_inputs(panel, instants),
        end=panel.schedule.end,
        prior=prior_motion(panel),
        save_at=None if save_at is None else save_at(mechanism),
        waits=schedule_waits(panel),
    )
    return PlannedThrow(
        mechanism,
        run,
        objects,
        solver_time=time.perf_counter() - compiled,
        compile_time=compiled - began,
        build_time=built - compiled,
        processor_time=time.process_time() - used,
    )


def solve_planned(
    planned: PlannedThrow, *, report: Callable[[int, int], None] | None = None
) -> Solved:
    """Solve a planned throw, once; see `solve_placed`."""
    began, used = time.perf_counter(), time.process_time()
    history = carry_out(planned.run, report=report)
    return Solved(
        planned.mechanism,
        history,
        planned.objects,
        solver_time=planned.solver_time + time.perf_counter() - began,
        compile_time=planned.compile_time,
        build_time=planned.build_time,
        processor_time=planned.processor_time + time.process_time() - used,
    )


def _compare_breaks(panel: LoadedPanel, solved: Solved, scheme: Scheme) -> dict[str, str]:
    """Return attributes on breaks; throws without them are not compared."""
    if not any(item.of_kind.breaks for item in solved.objects):
        return {}

    def throw(objects: tuple[PlacedObject, ...], other: Scheme) -> tuple[Mechanism, History]:
        made = solve_placed(panel, objects, scheme=other)
        return made.mechanism, made.history

    thrown = solved.mechanism, solved.history
    return break_attributes(panel, solved.objects, thrown, scheme, throw)


def compile_kernels(*, machines: bool = False) -> None:
    """Throw a small panel for an instant, so that no run's own time holds the compilation.

    Parameters
    ----------
    machines : bool
        Whether the kernels for drives that are machines are wanted.
    """
    from turnout.throw.flangeway import compile_distances
    from turnout.throw.output_rows import HISTORIES, sums_of_columns

    moments = {"throw.start": 0.0, "throw.duration": 0.01, "return.start": 0.02}
    changes: dict[str, object] = {f"movement.{key}": value for key, value in moments.items()}
    changes |= {"movement.return.duration": 0.01, "movement.return.extra_time": {"2": 0.0}}
    changes["schedule.loaded"] = True
    if machines:
        changes["drive.1.machine"] = "sb3"
    panel = load_panel("sb1").with_overrides({**changes, "schedule.end": 0.03})
    integrate(
        build_mechanism(panel, ()),
        Scheme(),
        inputs=lambda instants: marker_inputs(panel, instants),
        end=panel.schedule.end,
        prior=prior_motion(panel),
    )
    sums_of_columns("g", [[0]]).over_time(dict.fromkeys(HISTORIES, np.zeros((1, 1))))
    compile_distances()


_motions = LRUCache[Floats](8)


def marker_inputs(panel: LoadedPanel, instants: Floats) -> Floats:
    """Return marker positions from the stress-free position of the rails [m]."""
    made = functools.partial(marker_positions, panel, instants)
    return _shared_motion(panel, instants, made)


def prior_motion(panel: LoadedPanel) -> PriorMotion | None:
    """Return the motion that a loaded start follows; None for any other start."""
    movement, cycles = prior_movement(panel), panel.schedule.loaded_by == "cycles"
    if movement is None:
        return None
    duration = max(movement_time(movement, drive) for drive in panel.drive)
    made = functools.partial(prior_positions, panel, movement)
    if cycles:
        duration, made = panel.schedule.end, functools.partial(marker_positions, panel)

    def positions(instants: Floats) -> Floats:
        return _shared_motion(panel, instants, functools.partial(made, instants), prior=True)

    return PriorMotion(duration, positions, cyclic=cycles)


def _shared_motion(
    panel: LoadedPanel,
    instants: Floats,
    made: Callable[[], Floats],
    *,
    prior: bool = False,
) -> Floats:
    """Return positions of markers from the stress-free position, which throws share [m].

    Shape (n_inputs, n); each instant lies in one piece, as the kernels take it. They must not be
    changed.
    """
    offsets = marker_offsets(panel)
    key = prior, *motion_key(panel), *offsets.tolist(), instants.tobytes()
    shared = _motions.get(key)
    if shared is None:
        # not frozen: kernels are compiled for arrays that can be written to
        shared = np.ascontiguousarray((made() + offsets[:, np.newaxis]).T)
        _motions.put(key, shared)
    return shared.T


def as_objects(
    given: ForeignObject | Sequence[ForeignObject] | None,
) -> tuple[ForeignObject, ...]:
    """Return the foreign objects given by a caller as a tuple."""
    if given is None:
        return ()
    if isinstance(given, ForeignObject):
        return (given,)
    items = tuple(given) if isinstance(given, Sequence) and not isinstance(given, str) else (given,)
    wrong = [repr(item) for item in items if not isinstance(item, ForeignObject)]
    if wrong:
        message = (
            f"foreign_object: {', '.join(wrong)}: takes a ForeignObject or a list of them, such as "
            "ForeignObject('13 mm', 'sleeper 6')"
        )
        raise ResponseError(message)
    return items
