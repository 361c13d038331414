"""A switch from throw to throw: objects keep their damage, weather and wear go on."""

import json
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from turnout.core.channels import BREAK_NOTE, check_schema, label
from turnout.core.errors import ResponseError, TurnoutError
from turnout.core.scheme import Mode, Scheme, chosen_scheme
from turnout.core.threads import one_blas_thread
from turnout.mechanism.object_laws import dent_of, divided
from turnout.panel.foreign_object import ForeignObject, PlacedObject, resolve_objects
from turnout.panel.load import LoadedPanel
from turnout.solver.outcome import Code, NotConverged, Outcome
from turnout.throw.breaking import peak_attributes
from turnout.throw.dataset import (
    coordinates_of,
    describe_run,
    movement_records,
    response_channels,
)
from turnout.throw.drift import Drift, aged_objects, check_drift
from turnout.throw.drives import duties, duty_records, moved_throws
from turnout.throw.save import Save
from turnout.throw.signals import Channel, has_broken
from turnout.throw.simulate import Solved, as_objects, solve_placed

if TYPE_CHECKING:
    import xarray as xr

MOST_THROWS = 100_000
KEPT = Save(
    fields=(
        *("drive_force", "drive_displacement", "drive_slipping", "object_force"),
        *("drive_gap", "sensor_gap", "locked", "in_control", "end_gap", "force_margin"),
        *("object_touched", "object_placed", "contact_time", "object_left", "object_broken"),
        *("least_flangeway", "least_flangeway_x", "least_flangeway_rail"),
        *("least_gauge", "least_gauge_x", "least_gauge_rail", "least_gauge_place"),
        *("energy_object_dissipated", "energy_residual", "throw_time", "drive_current"),
    )
)
"""Channels of a sequence unless another choice is made."""


def simulate_sequence(
    panel: LoadedPanel,
    *,
    throws: int,
    foreign_object: ForeignObject | Sequence[ForeignObject] | None = None,
    drift: Drift | None = None,
    change: Callable[[int], Mapping[str, object]] | None = None,
    mode: Mode | None = "quick",
    scheme: Scheme | None = None,
    save: Save | None = None,
    throw: bool = True,
    report: Callable[[int, int], None] | None = None,
) -> "xr.Dataset":
    """Throw a switch again and again; trapped objects dent, break, grow and melt.

    Each throw is the panel's whole schedule from its own static equilibrium. Between the throws
    objects keep their dents and what is left of them.

    Parameters
    ----------
    panel : LoadedPanel
        From `load_panel`.
    throws : int
        How many.
    foreign_object : ForeignObject or sequence of them, optional
        Trapped objects at the first throw, in addition to the objects of the panel itself.
    drift : Drift, optional
        Changes from throw to throw.
    change : callable, optional
        Overrides of the panel for a throw, counted from 0, in SI; they precede those of `drift`.
    mode, scheme, save
        As for `simulate`; the mode is "quick" unless a scheme is given, and less is kept.
    throw : bool
        Whether a throw that ends early raises; otherwise the throws until then come back.
    report : callable, optional
        Called after each throw with throws done and throws in all.

    Returns
    -------
    xarray.Dataset
        Channels and labels as of `simulate` with the dimension `throw` in front, and what was
        different: `throw_temperature`, `object_size` before each throw. Coordinates that change
        from throw to throw, such as `saturation_force`, have the dimension `throw` too.

    Raises
    ------
    ResponseError
        When a number of throws makes no sense, or a drift leads to a switch that cannot be.
    PanelError
        When an object does not fit the panel.
    NotConverged
        When a throw ends early or is not possible, or Ctrl-C is pressed, with the throws until then
        as ``partial``; the first throw raises what is wrong with it.

    Examples
    --------
    >>> from turnout.panel.load import load_panel
    >>> ice = ForeignObject("15 mm", "sleeper 6", kind="ice")
    >>> made = simulate_sequence(load_panel("sb1"), throws=3, foreign_object=ice)  # doctest: +SKIP
    >>> made["drive_force"].dims  # doctest: +SKIP
    ('throw', 'drive', 'time')
    """
    if not isinstance(panel, LoadedPanel):
        message = f"simulate_sequence() takes a panel from load_panel(), not {panel!r}"
        raise ResponseError(message)
    if isinstance(throws, bool) or not isinstance(throws, int) or not 1 <= throws <= MOST_THROWS:
        message = f"throws = {throws!r}: must be a whole number, 1 to {MOST_THROWS}"
        raise ResponseError(message)
    objects = resolve_objects(panel, as_objects(foreign_object))
    chosen = chosen_scheme(None if scheme else mode, scheme, caller="simulate_sequence()")
    save = save or KEPT
    if save.interval is not None:
        chosen = replace(chosen, output_interval=save.interval)
    drift = drift or Drift()
    check_drift(panel, drift, throws)
    series = _Series(panel, objects, chosen, save, drift, throws)
    began = time.perf_counter()
    outcome = _throw_all(series, change, report)
    dataset = series.dataset(outcome, wall_time=time.perf_counter() - began)
    if throw and not outcome.complete:
        raise NotConverged(outcome, partial=dataset)
    return dataset


@dataclass(slots=True, eq=False)
class _Series:
    """Throws as they are made, with the kept values of each."""

    panel: LoadedPanel
    objects: tuple[PlacedObject, ...]
    scheme: Scheme
    save: Save
    drift: Drift
    throws: int
    kept: list[dict[str, Channel]] = field(default_factory=list)
    sizes: list[np.ndarray] = field(default_factory=list)
    coordinates: list[dict[str, Channel]] = field(default_factory=list)
    made: list[tuple[str, str]] = field(default_factory=list)
    attributes: dict[str, Any] = field(default_factory=dict)
    names: tuple[str, ...] = ()
    end: float = 0.0

    def add(self, panel: LoadedPanel, solved: Solved, parts: Sequence[PlacedObject]) -> None:
        """Keep the results of a throw; `parts` are the objects it met."""
        with one_blas_thread():
            channels = response_channels(panel, solved.mechanism, solved.history, save=self.save)
        present = tuple(solved.mechanism.index.object_parts)
        coordinates = coordinates_of(
            channels, panel, solved.mechanism, time=solved.history.time, save=self.save
        )
        if self.kept and panel.schedule.end != self.end:
            message = "it has other instants than the first; keep schedule.end for all throws"
            raise ResponseError(message)
        if not self.kept:
            self.end = panel.schedule.end
            self.attributes = describe_run(
                self.panel, solved.mechanism, solved.history, scheme=self.scheme,
                objects=self.objects, wall_time=0.0, solver_time=0.0,
            )  # fmt: skip
            self.attributes.pop("schedule_waits", None)  # of the first throw alone
        first = "break_throw" not in self.attributes
        if first and has_broken(solved.mechanism, solved.history):
            self.attributes |= {"break_note": BREAK_NOTE, "break_throw": len(self.kept) + 1}
        self.attributes |= peak_attributes((solved.mechanism, solved.history), self.scheme)
        self.coordinates.append(coordinates)
        self.kept.append({n: self._spread(v, present) for n, v in channels.items()})
        if (history := solved.history).machines is not None:
            moved = movement_records(moved_throws(panel, history))
            end = float(history.time[-1])
            self.made.append((moved, duty_records(panel, duties(history), end)))
        self.sizes.append(_sizes(parts, self.names))

    def _spread(self, variable: Channel, present: tuple[str, ...]) -> Channel:
        """Give the objects that are gone their places; nothing is left of them, nor any force."""
        dims, values = variable
        if "object" not in dims or present == self.names:
            return variable
        shape = (len(self.names), *values.shape[1:])
        found = np.zeros(shape, dtype=values.dtype)
        found[[self.names.index(name) for name in present]] = values
        return dims, found

    def _hold(self) -> None:
        """Give throws that did not wait for machines as long the instants of the longest.

        They rest to its end, as at their own.
        """
        times = [each["time"] for each in self.coordinates]
        if len({time.size for _, time in times}) <= 1:
            return
        longest = max(times, key=lambda item: item[1].size)
        for kept, coordinates, own in zip(self.kept, self.coordinates, times, strict=True):
            more, coordinates["time"] = longest[1].size - own[1].size, longest
            for name, (dims, values) in kept.items():
                if dims[-1:] == ("time",):
                    room = [*[(0, 0)] * (values.ndim - 1), (0, more)]
                    kept[name] = dims, np.pad(values, room, mode="edge")

    def dataset(self, outcome: Outcome, *, wall_time: float) -> "xr.Dataset":
        """Return all throws as one dataset."""
        import xarray as xr

        count = len(self.sizes)  # Ctrl-C may have come between the lists
        del self.kept[count:], self.coordinates[count:], self.made[count:]
        self._hold()
        channels: dict[str, Channel] = {}
        for name in dict.fromkeys(name for kept in self.kept for name in kept):
            dims, first = next(kept[name] for kept in self.kept if name in kept)
            blank = np.zeros(first.shape, dtype=first.dtype)
            stacked = np.stack([kept.get(name, (dims, blank))[1] for kept in self.kept])
            channels[name] = (("throw", *dims), stacked)
        coordinates = _joined(self.coordinates)
        if self.made:
            for at, name in enumerate(("throw_movements", "throw_machine_throws")):
                channels[name] = (("throw",), np.array([texts[at] for texts in self.made]))
        if self.names and count:
            channels["object_size"] = (("throw", "object"), np.array(self.sizes))
            names = np.array(self.names, dtype=np.str_)
            coordinates["object"] = (("object",), names)
        temperatures = self.drift.temperatures(self.throws)
        if temperatures is not None:
            channels["throw_temperature"] = (("throw",), temperatures[:count])
        coordinates["throw"] = (("throw",), np.arange(1, count + 1))
        made: xr.Dataset = check_schema(label(xr.Dataset(channels, coordinates)))
        drift = {item.name: getattr(self.drift, item.name) for item in fields(Drift)}
        return made.assign_attrs(
            {
                **self.attributes,
                "title": f"{count} throws of {self.panel.name}",
                "throws": self.throws,
                "drift": json.dumps(drift),
                "outcome": "refused"
                if isinstance(outcome, _Refused)
                else outcome.code.name.lower().replace("_", " "),
                "outcome_message": outcome.message(),
                "complete": outcome.complete,
                "wall_time": wall_time,
            }
        )


def _joined(made: Sequence[dict[str, Channel]]) -> dict[str, Channel]:
    """Return coordinates of all throws: once if they stay, else with "throw" in front."""
    found: dict[str, Channel] = {}
    for name, (dims, first) in made[0].items() if made else ():
        values = [each[name][1] for each in made if name in each]
        stays = len(values) < len(made) or name in ("object", "time")
        unknown = first.dtype.kind == "f"  # NaN is equal to itself here
        same = (np.array_equal(first, value, equal_nan=unknown) for value in values)
        if stays or all(same):
            found[name] = (dims, first)
        else:
            found[name] = (("throw", *dims), np.stack(values))
    return found


@dataclass(frozen=True, slots=True)
class _Refused(Outcome):
    """The end of a sequence by a throw that is not possible, with the reason."""

    reason: str = ""

    def message(self) -> str:
        """Return the throw that is not possible, with the reason."""
        return self.reason


def _throw_all(
    series: _Series,
    change: Callable[[int], Mapping[str, object]] | None,
    report: Callable[[int, int], None] | None,
) -> Outcome:
    """Make the throws one after the other; return the outcome of the last of them."""
    parts = divided(series.objects)
    series.names = tuple(dict.fromkeys(part.whole or part.name for part in parts))
    densities = {part.name: part.density for part in parts}
    temperatures = series.drift.temperatures(series.throws)
    random = np.random.default_rng(series.drift.seed)
    outcome = Outcome(Code.COMPLETE, 0.0, 0, 0.0)
    number = 0
    try:
        for number in range(series.throws):
            warmth = None if temperatures is None else float(temperatures[number])
            parts = _at_temperature(parts, warmth)
            overrides = dict(change(number)) if change is not None else {}
            panel = series.panel.with_overrides(overrides) if overrides else series.panel
            if drifted := series.drift.overrides(panel, number, warmth):
                panel = panel.with_overrides(drifted)
            solved = solve_placed(panel, parts, scheme=series.scheme)
            outcome = solved.history.outcome
            if not outcome.complete:
                return outcome
            series.add(panel, solved, parts)
            parts = aged_objects(
                parts, solved.mechanism, solved.history, panel=panel, drift=series.drift,
                temperature=warmth, random=random, densities=densities,
            )  # fmt: skip
            if report is not None:
                report(number + 1, series.throws)
    except KeyboardInterrupt:
        return Outcome(Code.INTERRUPTED, 0.0, number, 0.0)
    except TurnoutError as error:
        if not series.sizes:
            raise
        text = f"throw {number + 1} of {series.throws} is not possible: {error}"
        return _Refused(Code.NOT_CONVERGED, 0.0, number, 0.0, reason=text)
    return outcome


def _at_temperature(
    parts: Sequence[PlacedObject], temperature: float | None
) -> tuple[PlacedObject, ...]:
    """Give ice and snow the temperature of a throw, at most that of their melting point [K]."""
    if temperature is None:
        return tuple(parts)
    return tuple(
        replace(part, temperature=min(temperature, 273.15))
        if "temperature" in part.of_kind.parameters
        else part
        for part in parts
    )


def _sizes(parts: Sequence[PlacedObject], names: Sequence[str]) -> np.ndarray:
    """Return the size of the largest part of each object, 0 if nothing is left [m]."""
    found = np.zeros(len(names))
    for part in parts:
        at = names.index(part.whole or part.name)
        found[at] = max(found[at], part.size - part.lost - dent_of(part))
    return found
