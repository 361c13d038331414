"""The page on panel files: `python -m tests.unit.panel_file_page` writes it from the records."""

from pathlib import Path

from turnout.core.keys import Key
from turnout.panel.new_panel import TableRows, key_tables
from turnout.panel.unusual import USUAL

PAGE = Path(__file__).parents[2] / "docs" / "use" / "panel-file.md"

HEAD = """# Keys of a panel file

A panel file is TOML. `turnout panel new my-switch.toml` writes one to edit, with the meaning of
each key above it; [your own switch](own-panel.md) shows the way from there.

- **Units.** A value with a unit is text, such as `"750 kN/m"`; any unit of the same dimension does:
  `"16.5 ft"`, `"4 kip"` or `"5 lbf/in"` as well as `"5.03 m"`; one number and one unit,
  not `"16 ft 6 in"`. Ranges are in the unit of the table. Lists are `["1 m", "2 m"]`, or
  `{ unit = "mm", values = [1, 2] }`, or `{ start = "0 m", step = "0.6 m", count = 25 }` for lengths
  and times.
- **Families.** `[chair.5]` is the chair named 5. What stands in `[chair]` holds for all chairs that
  do not give it themselves. In families whose members stand at a place, a list as `x` of `[chair]`
  makes one member for each position; `names` names them, default "1", "2", ...
- **Defaults.** "required" must be given, by the member or its family; "none" may be left out.
- **Usual.** `turnout panel check` and `panel show` name values outside the usual range. They are
  not refused, but a unit is more often mistaken than a switch is so unusual.
- **Signs.** x runs from the toe to the heel, y towards the stock rail that the rail closes against,
  z up from the underside of the switch rail: [conventions](conventions.md).
"""


def page() -> str:
    """Return the whole page."""
    lines, known = [HEAD], dict[tuple[str, ...], str]()
    for table in key_tables():
        heading, keys = section(table), tuple(line(row) for row in table.keys)
        alike = known.setdefault(keys, table.header) if keys else table.header
        same = ["", f"Keys as in `{alike}`.", ""]
        lines += heading + (same if alike != table.header else rows_of(keys))
    return "\n".join(lines)


def section(table: TableRows) -> list[str]:
    """Return heading and meaning of a table of the file."""
    if not table.path:
        title = "## Top of the file"
    else:
        title = f"{'##' if len(table.path) < 3 else '###'} `{table.header}`"
    return [title, "", table.meaning]


def rows_of(keys: tuple[str, ...]) -> list[str]:
    """Return the lines of the keys below their head."""
    head = ["| key | unit | meaning | default | range |", "|---|---|---|---|---|"]
    return ["", *head, *keys, ""] if keys else [""]


def line(row: Key) -> str:
    """Return a key as a line of the table."""
    default = f"`{row.default}`" if row.default[:1] in '"-0123456789' else row.default
    allowed = ", ".join(
        f"`{part}`" if part.startswith('"') else part for part in row.allowed.split(", ")
    )
    usual = USUAL.get(".".join(part for part in row.path if part != "NAME"))
    span = f"usual {usual[0]:g} to {usual[1]:g}" if usual else ""
    allowed = "; ".join(part for part in (allowed or "any", span) if part)
    cells = (f"`{row.path[-1]}`", row.unit or "-", row.meaning, default, allowed)
    return "| " + " | ".join(cells) + " |"


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
