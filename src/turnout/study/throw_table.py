"""Throws of a panel that differ in the values of some keys: compiled once, then tables of numbers.

>>> from turnout.panel.load import load_panel
>>> plan = compile_throws(load_panel("sb1"), ["chair.friction_coefficient", "rail.section_scale"])
>>> plan.effects["chair.friction_coefficient"].changes
'laws'
>>> plan.effects["rail.section_scale"].changes
'rails in nominal shapes'
>>> plan.run([[0.2, 1.0], [0.3, 1.05]])["peak_force"].dims  # doctest: +SKIP
('scenario', 'drive', 'direction')
"""

import logging
from collections.abc import Collection, Iterable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import numpy as np

from turnout.core.errors import StudyError, TurnoutError
from turnout.core.problems import nearest, show_value
from turnout.core.progress import Pace, Report
from turnout.core.scheme import Scheme
from turnout.core.workers import MakePool, Workers
from turnout.mechanism.shape_key import change_of
from turnout.panel.load import LoadedPanel
from turnout.panel.model import PANEL_KEYS
from turnout.study.design import Axis, Design
from turnout.study.random_inputs import TemperatureLaw
from turnout.study.read_study import scheme_for
from turnout.study.scenario import Output, Value
from turnout.study.study import Study
from turnout.study.sweep.row import COMPLETE, INVALID
from turnout.study.sweep.run import throw_studies
from turnout.study.variable import (
    LABEL,
    OBJECT_KEYS,
    RECORDER_KEYS,
    TEMPERATURE_KEY,
    Variable,
    foreign_objects,
    value_kind,
    variable_keys,
)

if TYPE_CHECKING:
    import xarray as xr

MOST_SHOWN, MOST_NAMED = 5, 4
"""Rows that were not thrown of which a warning says why, and their values that it names."""
_log = logging.getLogger("turnout")


@dataclass(frozen=True, slots=True)
class KeyEffect:
    """Effect of a key on a panel and its mechanism.

    Attributes
    ----------
    places : tuple of str
        Full keys of the values that it sets; none where it sets none of the panel.
    changes : str
        What is made anew for another value: "laws", "motion", "rails in nominal shapes",
        "rails and their shapes", "object", "recorder" or "label".
    """

    places: tuple[str, ...]
    changes: str


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CompiledThrows:
    """Throws of a panel that differ in the values of some keys.

    Attributes
    ----------
    panel : LoadedPanel
        Has all other values.
    variables : mapping of str to Variable
        By the name of their column.
    scheme : Scheme
        Numerical choices.
    output : Output
        Histories that are kept, and their rate.
    law : TemperatureLaw or None
        Effect of a key "temperature".
    """

    panel: LoadedPanel
    variables: Mapping[str, Variable]
    scheme: Scheme
    output: Output
    law: TemperatureLaw | None = None

    @property
    def effects(self) -> dict[str, KeyEffect]:
        """Effect of each column."""
        return {name: _effect(self.panel, item, self.law) for name, item in self.variables.items()}

    def study(self, rows: Iterable[Sequence[Value]], *, name: str = "throws") -> Study:
        """Return valid rows, values in SI, as a study of one scenario each."""
        axis = Axis(names=tuple(self.variables), rows=tuple(map(tuple, rows)))
        return Study(
            name=name,
            description="",
            panel=self.panel,
            scheme=scheme_for(self.scheme, self.output),
            output=self.output,
            seed=0,
            design=Design(axes=(axis,), drawn=(), method="random", draws=1, copula=None, seed=0),
            variables=self.variables,
            fields=(),
            law=self.law,
            rule=None,
            split=(),
        )

    def rows_of(self, values: Any) -> tuple[list[list[Value]], dict[int, str]]:
        """Read a table.

        Parameters
        ----------
        values : array_like, shape (n_rows, n_columns), or pandas.DataFrame or mapping
            Numbers in SI, or texts with a unit; of the latter two the columns by name.

        Returns
        -------
        rows : list of list
            Values in SI.
        faults : dict of int to str
            What is wrong with rows that cannot be thrown, by their number from 0.

        Raises
        ------
        StudyError
            When columns are missing, or there are no rows.
        """
        rows, faults = list[list[Value]](), dict[int, str]()
        for number, given in enumerate(self._table(values)):
            row, wrong = list[Value](), list[str]()
            for (name, variable), value in zip(self.variables.items(), given, strict=True):
                plain = value.item() if isinstance(value, np.generic) else value
                try:
                    row.append(_read(variable, plain))
                except ValueError as error:
                    row.append(plain)
                    wrong.append(f"{name} = {show_value(plain)}: {error}")
            wrong = wrong or self._object_faults(row)
            if wrong:
                faults[number] = f"row {number}: {'; '.join(wrong)}"
            rows.append(row)
        return rows, faults

    def run(
        self,
        values: Any,
        *,
        folder: Path | str | None = None,
        workers: int | Workers = 1,
        pool: MakePool | None = None,
        report: Report | None = None,
    ) -> "xr.Dataset":
        """Throw the rows of a table.

        Parameters
        ----------
        values : array_like, shape (n_rows, n_columns), or pandas.DataFrame or mapping
            Numbers in SI, or texts with a unit; of the latter two the columns by name.
        folder : path-like, optional
            Keeps the throws, so that the same call goes on where it was ended; as of `run_sweep`.
        workers : int or Workers
            Processes.
        pool : callable, optional
            Makes the executor of a cluster in place of processes of this machine.
        report : callable, optional
            Called twice a second with the progress.

        Returns
        -------
        xarray.Dataset
            A scenario a row: inputs, labels, features and histories. Where a row was not thrown to
            its end numbers are NaN and logical values -1; `outcome` and `reason` say why, and
            ``attrs["faults"]`` lists these rows.

        Raises
        ------
        StudyError
            When columns are missing, or no row could be thrown.
        """
        rows, faults = self.rows_of(values)
        good = [number for number in range(len(rows)) if number not in faults]
        if not good:
            raise StudyError(list(faults.values()), source="table")
        study = self.study([rows[number] for number in good])
        made = thrown({"": study}, folder, workers=workers, pool=pool, report=report)[""]
        found = _in_their_rows(made, good, len(rows), faults)
        return self._checked(found, faults)

    def _checked(self, found: "xr.Dataset", faults: dict[int, str]) -> "xr.Dataset":
        """Return results with their faults stated; StudyError if there are only these."""
        outcome, reason = (found[name].astype(str).to_numpy() for name in ("outcome", "reason"))
        for number in np.flatnonzero(outcome != COMPLETE).tolist():
            if number not in faults:
                names = [*self.variables][:MOST_NAMED]
                values = ((name, found[name].values[number]) for name in names)
                given = ", ".join(f"{name} = {_shown(value)}" for name, value in values)
                faults[number] = f"row {number} ({given}): {reason[number]}"
        listed = [faults[number] for number in sorted(faults)]
        if len(listed) == outcome.size:
            raise StudyError(listed, source="table")
        if listed:
            more = len(listed) - MOST_SHOWN
            shown = "\n  - ".join([*listed[:MOST_SHOWN], *([f"{more} more"] if more > 0 else [])])
            _log.warning("%d of %d rows gave no results:\n  - %s", len(listed), outcome.size, shown)
        return found.assign_attrs(faults=listed)

    def _table(self, values: Any) -> Iterable[Sequence[Any]]:
        """Return rows of as many values as there are columns."""
        names = list(self.variables)
        if hasattr(values, "columns") or isinstance(values, Mapping):
            known = list(values.columns if hasattr(values, "columns") else values)
            if missing := [name for name in names if name not in known]:
                message = f"table: has no column {', '.join(missing)}"
                raise StudyError([message])
            values = list(zip(*(list(values[name]) for name in names), strict=True))
        table = list(values)
        wrong = [n for n, row in enumerate(table) if np.ndim(row) != 1 or len(row) != len(names)]
        if wrong or not table:
            what = f"row {wrong[0]} has not" if wrong else "it has no rows of"
            message = f"table: {what} {len(names)} values ({', '.join(names)})"
            raise StudyError([message])
        return table

    def _object_faults(self, row: Sequence[Value]) -> list[str]:
        """Return the faults of the object of a row."""
        keys = [item.key for item in self.variables.values()]
        try:
            foreign_objects(dict(zip(keys, row, strict=True)))
        except TurnoutError as error:
            return list(getattr(error, "problems", (str(error),)))
        return []


def compile_throws(
    panel: LoadedPanel,
    keys: Sequence[str] | Mapping[str, str],
    *,
    factors: Collection[str] = (),
    scheme: Scheme | None = None,
    channels: Sequence[str] = (),
    rate: float = 125.0,
    law: TemperatureLaw | None = None,
) -> CompiledThrows:
    """Compile throws of a panel that differ in the values of some keys.

    Parameters
    ----------
    panel : LoadedPanel
        From `load_panel`.
    keys : sequence of str, or mapping of str to str
        Keys of the panel, of the object ("object.size", "object.at"), of the recorder, or
        "temperature", as a study has them; or such keys by the names of columns.
    factors : collection of str
        Columns that multiply the values of the panel.
    scheme : Scheme, optional
        Numerical choices; default those of mode quick.
    channels : sequence of str
        Histories that are kept; none for labels and features alone.
    rate : float
        Of these [Hz].
    law : TemperatureLaw, optional
        Of a key "temperature".

    Raises
    ------
    StudyError
        With all keys that there are not, and the nearest ones.

    Examples
    --------
    >>> from turnout.panel.load import load_panel
    >>> compile_throws(load_panel("sb1"), ["chair.friction"])  # doctest: +ELLIPSIS
    Traceback (most recent call last):
        ...
    turnout.core.errors.StudyError: ...chair.friction: no value of this name can vary...
    """
    named = dict(keys) if isinstance(keys, Mapping) else {key: key for key in keys}
    variables, problems = dict[str, Variable](), list[str]()
    for name in factors:
        if name not in named:
            problems.append(f"factors: {name} is none of the columns")
    for name, key in named.items():
        factor = name in factors
        try:
            kind = value_kind(panel, key, factor=factor)
            of_panel = key not in OBJECT_KEYS and PANEL_KEYS.find(key)
            if of_panel and not PANEL_KEYS.places(panel.document.tree, key):
                near = nearest(key, variable_keys(panel))
                problems.append(f"{key}: matches nothing in panel {panel.name}{near}")
        except ValueError as error:
            problems.append(f"{key}: {error}")
        else:
            variables[name] = Variable(name=name, key=key, kind=kind, factor=factor)
    taken = [item.key for item in variables.values()]
    if ("object.size" in taken) != bool({"object.at", "object.x"} & {*taken}):
        problems.append('object: give "object.size" and one of "object.at", "object.x", or none')
    if not named:
        problems.append("keys: none is given")
    if problems:
        raise StudyError(problems, source=f"throws of {panel.name}")
    return CompiledThrows(
        panel=panel,
        variables=variables,
        scheme=scheme or Scheme.of("quick"),
        output=Output(rate=rate, channels=tuple(channels)),
        law=law,
    )


def thrown(
    studies: Mapping[str, Study],
    folder: Path | str | None = None,
    *,
    workers: int | Workers = 1,
    pool: MakePool | None = None,
    report: Report | None = None,
    pace: Pace | None = None,
) -> dict[str, "xr.Dataset"]:
    """Throw studies into folders of a given one, or without one into memory, and return all.

    Parameters
    ----------
    studies : mapping of str to Study
        By the name of their folder.
    folder : path-like, optional
        Keeps the throws.
    workers, pool, report, pace
        As of `throw_studies`.
    """
    from turnout.study.sweep.read import open_batches  # loads xarray, which no worker needs

    with ExitStack() as stack:
        whole = folder or stack.enter_context(TemporaryDirectory(prefix="turnout-"))
        places = {Path(whole, name): study for name, study in studies.items()}
        throw_studies(places, workers=workers, pool=pool, report=report, pace=pace)
        found = [open_batches(place) for place in places]
        if folder is None:
            found = [dataset.load() for dataset in found]
    return dict(zip(studies, found, strict=True))


def _shown(value: object) -> str:
    """Return a stored value as it was given; numbers are stored in single precision."""
    return f"{value:.7g}" if isinstance(value, float | np.floating) else str(value)


def _read(variable: Variable, value: object) -> Value:
    """Read a value of a table, in SI; ValueError states the requirement."""
    numeric = variable.factor or variable.kind not in (str, bool)
    if numeric and isinstance(value, int | float) and not isinstance(value, bool):
        if not np.isfinite(value):
            message = "must be a finite number"
            raise ValueError(message)
        return float(value)
    return variable.read(value)


def _effect(panel: LoadedPanel, variable: Variable, law: TemperatureLaw | None) -> KeyEffect:
    key = variable.key
    for keys, text in ((OBJECT_KEYS, "object"), (RECORDER_KEYS, "recorder")):
        if key in keys:
            return KeyEffect((), text)
    if key.startswith(LABEL):
        return KeyEffect((), "label")
    if key == TEMPERATURE_KEY:
        key = (law or TemperatureLaw()).key
    places = PANEL_KEYS.places(panel.document.tree, key)
    changes = change_of(places[0] if places else key.split("."))
    return KeyEffect(tuple(".".join(place) for place in places), changes)


def _in_their_rows(
    made: "xr.Dataset",
    good: Sequence[int],
    count: int,
    faults: Mapping[int, str],
) -> "xr.Dataset":
    """Return results by the row of the table that they are of, and none for those with faults."""
    if not faults:
        return made
    blank: dict[str, Any] = {}
    for name, item in made.variables.items():
        if item.dims[:1] == ("scenario",) and name != "scenario":
            blank[str(name)] = {"f": np.nan, "i": -1, "u": 0, "b": False}.get(item.dtype.kind, "")
    found = made.assign_coords(scenario=list(good))
    found = found.reindex(scenario=np.arange(count), fill_value=blank)
    said = {"outcome": dict.fromkeys(faults, INVALID), "reason": faults}
    for name, texts in said.items():
        values = found[name].astype(object).to_numpy().copy()
        values[list(texts)] = list(texts.values())
        found = found.assign_coords({name: ("scenario", values, found[name].attrs)})
    return found
