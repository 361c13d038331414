"""Inputs of a result: the values of its panel with their origins, and their changes."""

import json
from collections.abc import Mapping
from typing import Any

from turnout.core.errors import TurnoutError
from turnout.figures.report.page import Section, Table
from turnout.figures.report.values import ASSUMED, value_groups
from turnout.panel.load import LoadedPanel, load_panel

# Attributes of a dataset about its computation, and their names on a page.
MADE_BY = {
    "version": "turnout",
    "python": "Python",
    "platform": "Platform",
    "schema_version": "Version of the schema",
    "panel": "Panel",
    "panel_hash": "Hash of the panel",
    "scheme": "Scheme",
    "cutoff_frequency": "Modes kept up to [Hz]",
    "outcome_message": "Outcome",
    "steps": "Steps",
    "wall_time": "Wall time [s]",
    "seed": "Seed",
}


def panel_of_result(
    attributes: Mapping[Any, Any], *, panel: LoadedPanel | None = None
) -> LoadedPanel | None:
    """Return the panel that a result was computed with, or None if it is not at hand.

    Parameters
    ----------
    attributes : mapping
        Of the result's dataset: panel, overrides and hash.
    panel : LoadedPanel, optional
        The panel file, without overrides; default the library's panel of that name.

    Returns
    -------
    LoadedPanel or None
        With the overrides of the run. It is the same panel to the last value, by its hash.

    Examples
    --------
    >>> run = {"panel": "sb1", "panel_hash": load_panel("sb1").hash, "overrides": "{}"}
    >>> panel_of_result(run).name
    'sb1'
    >>> panel_of_result({"panel": "sb1", "panel_hash": "another"}) is None
    True
    """
    try:
        found = panel if panel is not None else load_panel(str(attributes.get("panel", "")))
        changes = json.loads(str(attributes.get("overrides", "{}")))
        found = found.with_overrides(changes) if changes else found
    except TurnoutError:
        return None
    return found if found.hash == attributes.get("panel_hash") else None


def inputs_section(attributes: Mapping[Any, Any], panel: LoadedPanel | None) -> Section:
    """Return every value of a panel with its origin; assumed ones are marked.

    Parameters
    ----------
    attributes : mapping
        Of the result's dataset.
    panel : LoadedPanel or None
        From `panel_of_result`.
    """
    changes: dict[str, Any] = json.loads(str(attributes.get("overrides", "{}")))
    changed = Table(
        "Changed for this result", ("Key", "Value"), [(k, str(v)) for k, v in changes.items()]
    )
    tables = [changed] if changes else []
    name = str(attributes.get("panel", "not stated"))
    if panel is None:
        text = (
            f"Panel {name}. Its file is not at hand in the version that was used, so its values "
            "cannot be listed; name the file with --panel."
        )
        return Section(heading="Inputs and their origin", text=text, tables=tables)
    rows: list[tuple[str, ...]] = []
    marked = []
    for heading, leaves in value_groups(panel):
        for leaf in leaves:
            if ASSUMED in leaf.origin:
                marked.append(len(rows))
            rows.append((heading, leaf.below, leaf.text, leaf.origin))
    text = (
        f"{' '.join(panel.description.split())} Shaded rows are assumptions: "
        f"{len(marked)} of {len(rows)}."
    )
    values = Table("", ("Part", "Value", "", "Origin"), rows, frozenset(marked))
    return Section(
        heading="Inputs and their origin", text=text, tables=[*tables, values], folded=False
    )


def origin_section(attributes: Mapping[Any, Any]) -> Section:
    """Return the versions that computed a result, as far as its attributes name them."""
    rows = [(text, _text(attributes[name])) for name, text in MADE_BY.items() if name in attributes]
    return Section(heading="Versions", tables=[Table("", ("What", ""), rows)])


def _text(value: object) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)
