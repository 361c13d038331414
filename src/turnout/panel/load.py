"""Load a panel from the library or a file, and make changed ones from it.

One direction: file, document, overrides, records, checks, panel.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from types import MappingProxyType
from typing import Any, Self

from pydantic import PrivateAttr

from turnout.core.errors import FileError, PanelError
from turnout.core.files import user_path
from turnout.core.html_table import html_table
from turnout.core.keys import mark_si
from turnout.core.library import names_a_file, names_in_library, open_toml, text_in_library
from turnout.core.problems import Problem, choices
from turnout.core.provenance import content_hash
from turnout.core.toml import Origin, TomlFile
from turnout.panel.check import check, reads_of_checks
from turnout.panel.compiled_keys import CompiledKeys, compile_keys
from turnout.panel.document import Document, expand
from turnout.panel.gauge_limits import has_default_limits, with_gauge_limits
from turnout.panel.library_members import add_library_members
from turnout.panel.markers import read_schedule_files
from turnout.panel.matrices import check_matrices, read_matrices
from turnout.panel.model import PANEL_KEYS, Panel, plain_value
from turnout.panel.override import (
    apply_overrides,
    restated,
    supersede,
)
from turnout.panel.records import RailMatrices
from turnout.panel.validate import validate_document, with_values

# The text about a panel does not change what it is.
_HASHED = tuple(name for name in Panel.model_fields if name != "description")
# For a notebook, and for completion.
_COUNTED = ("chair", "fastening", "stop", "stud", "link", "sensor", "sleeper")
_OWN = (
    "hash",
    "matrices",
    "origins",
    "overrides",
    "source",
    "values_at",
    "with_overrides",
    "with_settings",
)


@dataclass(frozen=True, slots=True)
class CheckedDocument:
    """A document after all checks.

    Attributes
    ----------
    document : Document
        With the columns of schedule files and the matrices that its tables name.
    records : mapping of str to object
        Value by field name of `Panel`; valid where there are no problems.
    problems : tuple of Problem
        In the order of the panel's keys, unknown keys first; empty for a valid panel.
    """

    document: Document
    records: Mapping[str, Any]
    problems: tuple[Problem, ...]


def check_document(document: Document, *, folder: Path | None) -> CheckedDocument:
    """Read the files that a document names, make its records and check them.

    Parameters
    ----------
    document : Document
        With its families expanded and its overrides applied.
    folder : Path or None
        Folder from which relative paths in its tables start.

    Returns
    -------
    CheckedDocument
    """
    document = add_library_members(document)
    document, limit_problems = with_gauge_limits(document, folder=folder)
    filled, file_problems = read_schedule_files(document, folder=folder)
    matrices, matrix_problems = read_matrices(
        document.tree.get("rail"), folder=folder, known=document.matrices
    )
    draft = validate_document(filled)
    of_files = [*limit_problems, *file_problems, *matrix_problems]
    found = [*draft.problems, *of_files, *check(draft)]
    if not found:
        found += check_matrices(draft.records, matrices)
    return CheckedDocument(
        document=replace(document, tables=filled.tables, matrices=matrices),
        records=draft.records,
        problems=tuple(sorted(found, key=_key_order)),
    )


def _key_order(problem: Problem) -> int:
    """Return the place of a problem in the order of the panel's keys; -1 for unknown keys."""
    known = list(Panel.model_fields)
    return known.index(problem.path[0]) if problem.path and problem.path[0] in known else -1


@dataclass(frozen=True, slots=True, eq=False)
class _PendingDocument:
    """The document of a panel with other values, whose tables have not been needed yet."""

    before: Document
    given: Mapping[str, object]

    @property
    def matrices(self) -> dict[str, RailMatrices]:
        """Matrices that tables name, which no value changes."""
        return self.before.matrices

    def made(self) -> Document:
        """Return the document."""
        return apply_overrides(self.before, self.given)[0]


class _Own:
    """Results that belong to one panel: its keys compiled, what its checks read, and hashes.

    A copy of the panel has none, and makes its own.
    """

    def __init__(self) -> None:
        self.compiled: dict[tuple[str, ...], CompiledKeys | None] = {}
        self.digests: dict[frozenset[tuple[str, str]], str] = {}
        self.parts: dict[frozenset[tuple[str, str]], dict[str, str]] = {}
        self.reads: dict[str, frozenset[tuple[str, str]]] = {}

    def __deepcopy__(self, memo: object) -> "_Own":
        return _Own()

    def __reduce__(self) -> tuple[type["_Own"], tuple[()]]:
        return _Own, ()


MOST_COMPILED = 16
"""Sets of keys that a panel has compiled; another one makes room for itself."""


class LoadedPanel(Panel):
    """A valid panel that knows the origins of its values.

    Besides the records (`panel.drive["1"].stiffness`) it has `origins`, `overrides` and `hash`.
    It can be pickled, and written as plain data (`turnout.panel.stored`).
    """

    _document: Document | _PendingDocument = PrivateAttr()
    _overrides: dict[str, object] = PrivateAttr(default_factory=dict)
    _source: str = PrivateAttr(default="panel")
    _folder: Path | None = PrivateAttr(default=None)
    _hash: str = PrivateAttr(default="")
    _own: _Own = PrivateAttr(default_factory=_Own)
    _base: "LoadedPanel | None" = PrivateAttr(default=None)
    _differs: frozenset[tuple[str, str]] = PrivateAttr(default=frozenset())

    @property
    def origins(self) -> Mapping[str, Origin]:
        """Origin of each value, by key; an override has the kind "override"."""
        return MappingProxyType(restated(self.document))

    @property
    def overrides(self) -> Mapping[str, object]:
        """The overrides that made this panel, by key."""
        return MappingProxyType(self._overrides)

    @property
    def matrices(self) -> Mapping[str, RailMatrices]:
        """Matrices of the rails that have them in place of beams, by the name of the rail."""
        known = self._document.matrices
        return {
            name: known[rail.matrices]
            for name, rail in self.rail.items()
            if rail.matrices is not None
        }

    @property
    def source(self) -> str:
        """The library name or file that the panel was loaded from."""
        return self._source

    @property
    def folder(self) -> Path | None:
        """Folder that relative paths in the panel's tables start from."""
        return self._folder

    @property
    def document(self) -> Document:
        """The tables that the panel was made of."""
        if isinstance(self._document, _PendingDocument):
            self._document = self._document.made()
        return self._document

    @property
    def hash(self) -> str:
        """Content hash of all SI values; the same for the same panel however it was written."""
        if not self._hash:
            values = _plain_values(self)
            if not values["machine"]:  # a panel of markers is what it was before there were any
                del values["machine"]
                for drive in values["drive"].values():
                    del drive["machine"]
            if values["schedule"]["loaded_by"] == "return":  # and one without cycles before it
                del values["schedule"]["loaded_by"]
            if values["gauge"] is None:  # and one without data of its gauge
                del values["gauge"]
            elif values["gauge"]["line_speed"] is None:  # and one judged by a limit of its own
                del values["gauge"]["line_speed"]
                if has_default_limits(self.gauge):
                    del values["gauge"]["limits"]
            for rail in values["rail"].values():  # and one that touches, before edges could meet
                if rail["gauge_widening"] is None:
                    del rail["gauge_widening"]
                edge = rail["running_edge"]
                if edge is not None and not edge["tangent_offset"]:
                    del edge["tangent_offset"]
            self._hash = content_hash(
                values
                | {f"matrices of {name}": given.digest for name, given in self.matrices.items()}
            )
        return self._hash

    def values_at(self, key: str) -> dict[str, Any]:
        """Return the values by full key: one for each member if a key names a family.

        Raises
        ------
        PanelError
            Where there is no such value.

        Examples
        --------
        >>> load_panel("sb1").values_at("drive.stiffness")
        {'drive.1.stiffness': 750000.0, 'drive.2.stiffness': 810000.0}
        """
        try:
            return PANEL_KEYS.values(self, key)
        except LookupError as error:
            raise PanelError([str(error)]) from None

    def with_overrides(self, overrides: Mapping[str, object], *, si: bool = True) -> Self:
        """Make a panel with changed values.

        Parameters
        ----------
        overrides : mapping of str to object
            Value by key: `{"chair.friction_coefficient": 0.3, "drive.2.stiffness": "81 kN/m"}`.
            A table may be given for a member: `{"object.stone": {"size": 0.013, "at": "drive 1"}}`.
        si : bool
            Whether bare numbers are SI (from Python) or refused for dimensional keys (from text).

        Returns
        -------
        LoadedPanel
            A new, completely checked panel; this one is not changed.

        Raises
        ------
        PanelError
            With all problems at once.

        Examples
        --------
        >>> panel = load_panel("sb1").with_overrides({"drive.1.stiffness": "75 kN/m"})
        >>> panel.drive["1"].stiffness
        75000.0
        """
        given = {key: mark_si(value) if si else value for key, value in overrides.items()}
        return self._changed(given, [])

    def with_settings(self, settings: Iterable[str]) -> Self:
        """Make a panel changed by texts "KEY=VALUE" of a command line; units are required.

        Examples
        --------
        >>> load_panel("sb1").with_settings(["drive.1.stroke=100 mm"]).drive["1"].stroke
        0.1
        """
        overrides, problems = PANEL_KEYS.settings(settings)
        return self._changed(overrides, [Problem((), text) for text in problems])

    def _changed(self, overrides: Mapping[str, object], problems: list[Problem]) -> Self:
        keys = None if problems else self._compiled(tuple(overrides))
        made = None if keys is None else keys.derive(overrides)
        if keys is not None and made is not None:
            panel = with_values(self, made.records)
            panel._document = _PendingDocument(self.document, overrides)
            panel._base, panel._differs, panel._overrides = self, keys.fields, made.overrides
        else:
            document, found, applied = apply_overrides(self.document, overrides)
            checked = check_document(document, folder=self._folder)
            refuse([*problems, *found, *checked.problems], heading="overrides")
            panel = with_values(self, dict(checked.records))
            panel._document = checked.document
            panel._base, panel._differs = None, frozenset()
            panel._overrides = supersede(self._overrides, applied)
        panel._hash, panel._own = "", _Own()
        return panel

    def _compiled(self, keys: tuple[str, ...]) -> CompiledKeys | None:
        """Return keys compiled for this panel, or None if they cannot be."""
        known = self._own.compiled
        if keys not in known:
            reads = self._own.reads = self._own.reads or reads_of_checks(self.__dict__)
            made = compile_keys(self, self.document, self._overrides, keys, reads)
            if len(known) >= MOST_COMPILED:
                known.clear()
            known[keys] = made
        return known[keys]

    def digest_without(self, fields: frozenset[tuple[str, str]]) -> str:
        """Return a content hash of all values but some.

        Parameters
        ----------
        fields : frozenset of (str, str)
            Families, and fields of theirs; with an empty second part whole families and tables.

        Returns
        -------
        str
            The same for all panels that differ in these alone.
        """
        known = self._own.digests
        if fields not in known and self._base is not None and not self._differing(fields):
            known[fields] = self._base.digest_without(fields)
        if fields not in known:
            matrices = {f"matrices of {name}": m.digest for name, m in self.matrices.items()}
            known[fields] = content_hash(self._digests_without(fields) | matrices)
        return known[fields]

    def digest_of(self, *parts: str) -> str:
        """Return a content hash of some fields, found once for panels that are alike in them."""
        return self.digest_without(_all_but(parts))

    def _differing(self, fields: frozenset[tuple[str, str]]) -> set[str]:
        """Return the parts of which more than some fields differ from the panel it was made of."""
        return {
            part
            for part, field in self._differs
            if (part, field) not in fields and (part, "") not in fields
        }

    def _digests_without(self, fields: frozenset[tuple[str, str]]) -> dict[str, str]:
        """Return digests of all parts, those of unchanged parts from the panel before.

        A panel has hundreds of members, and a throw of a sweep changes some of few.
        """
        known = self._own.parts
        if fields not in known:
            base = {} if self._base is None else self._base._digests_without(fields)
            changed = self._differing(fields) if base else {*_HASHED}
            known[fields] = base | {
                name: content_hash(plain_value(name, getattr(self, name), fields))
                for name in _HASHED
                if name in changed and (name, "") not in fields
            }
        return known[fields]

    def model_copy(self, *, update: Mapping[str, Any] | None = None, deep: bool = False) -> Self:
        """Return a copy, which knows nothing of the panel that it was made from."""
        copied = super().model_copy(update=update, deep=deep)
        copied._base, copied._differs, copied._own = None, frozenset(), _Own()
        copied._hash = ""
        return copied

    def __getstate__(self) -> dict[Any, Any]:
        """Return the state to pickle: with the tables, without the panel that it was made from."""
        state = super().__getstate__()
        own: dict[str, object] = {"_document": self.document, "_base": None}
        own |= {"_differs": frozenset(), "_own": _Own()}
        return state | {"__pydantic_private__": (state["__pydantic_private__"] or {}) | own}

    def __eq__(self, other: object) -> bool:
        """Return True if another panel has the same values, from any origin."""
        if not isinstance(other, LoadedPanel):
            return NotImplemented
        own, others = (
            {name: given.digest for name, given in panel.matrices.items()}
            for panel in (self, other)
        )
        return self.__dict__ == other.__dict__ and own == others

    __hash__ = None  # type: ignore[assignment]  # as of other panels, whose tables have none

    @classmethod
    def from_checked(
        cls,
        checked: CheckedDocument,
        *,
        source: str,
        folder: Path | None,
        overrides: Mapping[str, object],
    ) -> Self:
        """Make a panel of a checked document without problems."""
        panel = cls.model_construct(**checked.records)
        panel._document = checked.document
        panel._overrides = dict(overrides)
        panel._source = source
        panel._folder = folder
        return panel

    def __repr__(self) -> str:
        """Name the panel and its overrides; the records are too many to show."""
        changed = f", overrides={dict(self._overrides)}" if self._overrides else ""
        return f"LoadedPanel({self.name!r}, hash={self.hash[:12]!r}{changed})"

    __str__ = __repr__

    def _repr_html_(self) -> str:
        """Return a small table for a notebook."""
        counts = {
            name: len(members)
            for name in Panel.model_fields
            if isinstance(members := getattr(self, name), dict) and members
        }
        rows: list[tuple[object, ...]] = [("description", self.description.strip())]
        rows += [(name, ", ".join(getattr(self, name))) for name in ("rail", "drive", "movement")]
        rows += [(name, count) for name, count in counts.items() if name in _COUNTED]
        rows += [("lock rule", self.lock.rule), ("hash", self.hash[:12])]
        rows += [(f"set {key}", str(value)) for key, value in self._overrides.items()]
        return html_table(f"Panel {self.name}", rows)

    def __dir__(self) -> list[str]:
        """List records, properties and methods of a panel for completion."""
        return [*Panel.model_fields, *_OWN]


@lru_cache(maxsize=64)
def _all_but(parts: tuple[str, ...]) -> frozenset[tuple[str, str]]:
    """Return all fields of a panel but some, as of `LoadedPanel.digest_without`."""
    return frozenset((name, "") for name in _HASHED if name not in parts)


def _plain_values(panel: Panel) -> dict[str, Any]:
    """Return the values of a panel that are hashed, as plain ones.

    Each record was validated and has a serializer; for the panel as a whole one would be built.
    """
    return {name: plain_value(name, getattr(panel, name)) for name in _HASHED}


def refuse(problems: Iterable[Problem], *, heading: str) -> None:
    """Raise `PanelError` with all problems, each once, if there are any."""
    lines = [str(item) for item in problems]
    if lines:
        raise PanelError(list(dict.fromkeys(lines)), source=heading)


def library_names() -> tuple[str, ...]:
    """List the panels that come with the program.

    Examples
    --------
    >>> "sb1" in library_names()
    True
    """
    return names_in_library("turnout.panel")


def library_text(name: str) -> str:
    """Give the TOML text of a library panel, to start an own panel file from.

    Raises
    ------
    FileError
        When there is no such panel; the text lists those there are.
    """
    return text_in_library("turnout.panel", name, kind="panel")


def load_panel(
    name_or_path: str | Path, *, overrides: Mapping[str, object] | None = None
) -> LoadedPanel:
    """Load a panel of the library by its name, or a panel file by its path.

    Parameters
    ----------
    name_or_path : str or Path
        A library name, or a path; a text with ".toml" or a path separator is a path.
    overrides : mapping, optional
        Changes, as for `LoadedPanel.with_overrides`. They are set before anything is checked, so
        they may replace what is wrong in the file.

    Returns
    -------
    LoadedPanel
        The checked panel.

    Raises
    ------
    FileError
        When the file cannot be read or is not TOML.
    PanelError
        When what it says is not a valid panel; with all problems at once.

    Examples
    --------
    >>> load_panel("sb1").drive["1"].stiffness
    750000.0
    """
    file = open_toml("turnout.panel", panel_source(name_or_path), kind="panel")
    return panel_from_file(file, overrides=overrides)


def load_named_panel(name: str, file: TomlFile) -> LoadedPanel:
    """Load the panel that another file names; a path starts at the folder of that file."""
    return load_panel(file.path_of(name) if name.endswith(".toml") else name)


def panel_from_file(
    file: TomlFile, *, overrides: Mapping[str, object] | None = None
) -> LoadedPanel:
    """Make a panel from a TOML document that was already read, with overrides as in Python."""
    given = {key: mark_si(value) for key, value in (overrides or {}).items()}
    named = add_library_members(expand(file))  # so that overrides may set their values
    document, problems, applied = apply_overrides(named, given)
    return panel_from_document(
        document, source=file.source, folder=file.folder, overrides=applied, problems=problems
    )


def panel_from_document(
    document: Document,
    *,
    source: str,
    folder: Path | None,
    overrides: Mapping[str, object],
    problems: Iterable[Problem] = (),
) -> LoadedPanel:
    """Make a panel of its tables.

    Parameters
    ----------
    document : Document
        With its overrides applied.
    source : str
        Library name or file, the heading of what is wrong.
    folder : Path or None
        Folder from which relative paths in its tables start.
    overrides : mapping of str to object
        Applied overrides, by key.
    problems : iterable of Problem
        Found before, such as overrides that match nothing.

    Raises
    ------
    PanelError
        With all problems at once.
    """
    checked = check_document(document, folder=folder)
    refuse([*problems, *checked.problems], heading=source)
    return LoadedPanel.from_checked(checked, source=source, folder=folder, overrides=overrides)


def as_written(panel: LoadedPanel) -> LoadedPanel:
    """Return the same panel as if its file had the values of its overrides.

    Some checks let a study go further than a file: a value that is set may contradict one of the
    file, but not one that is set as well. On this panel any value can be set as on a file's.

    Examples
    --------
    >>> panel = as_written(load_panel("sb1").with_overrides({"drive.1.stiffness": 8e5}))
    >>> panel.drive["1"].stiffness, panel.origins["drive.1.stiffness"].kind
    (800000.0, 'override')
    """
    document = panel.document
    return panel_from_document(
        replace(document, given={}, origins=restated(document)),
        source=panel.source,
        folder=panel.folder,
        overrides=panel.overrides,
    )


def panel_source(name_or_path: str | Path) -> str | Path:
    """Return the path of a panel file, or the name of a library panel, which may not exist."""
    if isinstance(name_or_path, Path):
        return name_or_path
    if not isinstance(name_or_path, str):
        message = (
            f"load_panel() takes the name of a library panel or a path, not {name_or_path!r}; "
            f"there are {choices(library_names())}"
        )
        raise FileError(message)
    name = name_or_path.strip()
    if names_a_file(name):
        return user_path(name)
    return name
