"""Check a panel document: from its tables and files to records, with every problem found."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from turnout.core.problems import Problem
from turnout.panel.check import check
from turnout.panel.document import Document
from turnout.panel.library_members import add_library_members
from turnout.panel.markers import read_schedule_files
from turnout.panel.matrices import check_matrices, read_matrices
from turnout.panel.model import Panel
from turnout.panel.validate import Known, validate


@dataclass(frozen=True, slots=True)
class CheckedDocument:
    """A document after all checks.

    Attributes
    ----------
    document : Document
        With the columns of schedule files and the matrices that its tables name.
    records : mapping of str to object
        Value by field name of `Panel`; valid where there are no problems.
    asked : mapping of str to frozenset of str
        Fields of `Panel` that each check read, by the name of the check.
    problems : tuple of Problem
        In the order of the panel's keys, unknown keys first; empty for a valid panel.
    """

    document: Document
    records: Mapping[str, Any]
    asked: Mapping[str, frozenset[str]]
    problems: tuple[Problem, ...]


def check_document(
    document: Document, *, folder: Path | None, known: Known | None = None
) -> CheckedDocument:
    """Read the files that a document names, make its records and check them.

    Parameters
    ----------
    document : Document
        With its families expanded and its overrides applied.
    folder : Path or None
        Where relative paths in its tables start.
    known : Known, optional
        A valid panel that this one was made from; what did not change is not checked again.

    Returns
    -------
    CheckedDocument
    """
    document = add_library_members(document)
    filled, file_problems = read_schedule_files(document, folder=folder)
    matrices, matrix_problems = read_matrices(
        document.tree.get("rail"), folder=folder, known=document.matrices
    )
    draft = validate(filled, known=known)
    found = [*draft.problems, *file_problems, *matrix_problems, *check(draft, known=known)]
    if not found:
        found += check_matrices(draft.records, matrices)
    return CheckedDocument(
        document=replace(document, tables=filled.tables, matrices=matrices),
        records=draft.records,
        asked=draft.asked,
        problems=tuple(sorted(found, key=_key_order)),
    )


def _key_order(problem: Problem) -> int:
    """Return the place of a problem in the order of the panel's keys; -1 for unknown keys."""
    known = list(Panel.model_fields)
    return known.index(problem.path[0]) if problem.path and problem.path[0] in known else -1
