"""A panel file to edit is the panel it was made from, explained; the page of keys is true."""

import re
from pathlib import Path

import pytest
from tests.unit.panel_file_page import PAGE, page
from typer.testing import CliRunner

from turnout.cli.main import app
from turnout.core.errors import TurnoutError
from turnout.core.units import unit_factor
from turnout.panel.load import library_names, library_text, load_panel
from turnout.panel.model import FAMILIES
from turnout.panel.new_panel import key_tables, new_panel_text


def run(*line: object) -> None:
    done = CliRunner().invoke(app, [str(part) for part in line], catch_exceptions=False)
    assert done.exit_code == 0, done.output


def refused(*line: object) -> str:
    """Return the message of a refusal; the program turns it into exit code 2."""
    with pytest.raises(TurnoutError) as error:
        run(*line)
    return str(error.value)


def test_the_page_is_what_the_records_say() -> None:
    assert PAGE.read_text(encoding="utf-8") == page()


def test_every_key_has_a_meaning_and_the_unit_of_its_field() -> None:
    rows = [row for table in key_tables() for row in table.keys]
    assert [row.path for row in rows if not row.meaning] == []
    for row in rows:
        said = re.search(r"\[([^\]]+)\]\Z", row.field.description or "")
        unit = re.sub(r"(?<=[a-z])(?=\d)", "^", said[1]) if said else "-"
        if row.dimension is None:
            assert unit == "-", row.name
        elif said:
            assert unit_factor(unit, row.dimension) == 1.0, row.name


def test_the_reference_lists_every_family() -> None:
    named = {table.path[0] for table in key_tables() if table.path}
    assert named >= set(FAMILIES)


@pytest.mark.parametrize("name", library_names())
def test_a_new_file_is_the_same_panel_under_its_own_name(name: str, tmp_path: Path) -> None:
    target = tmp_path / "my-switch.toml"
    run("panel", "new", target, "--from", name)
    made, source = load_panel(target), load_panel(name)
    assert made.name == "my-switch"
    assert made.description.startswith(f"Made from {name}") == bool(source.description)
    assert made.with_overrides({"name": name}).hash == source.hash
    assert dict(made.origins) == dict(source.origins)


def test_a_new_file_is_accepted_unchanged_and_made_from_again(tmp_path: Path) -> None:
    first, second = tmp_path / "first.toml", tmp_path / "second.toml"
    run("panel", "new", first)
    run("panel", "check", first, "--no-throw", "--strict")
    run("panel", "new", second, "--from", first)
    text = first.read_text(encoding="utf-8")
    assert second.read_text(encoding="utf-8") == text.replace('"first"', '"second"')


def test_optional_keys_work_when_they_are_uncommented(tmp_path: Path) -> None:
    """Those with a default, all at once: the panel stays the same."""
    target = tmp_path / "mine.toml"
    text = new_panel_text("uic60-760-1-15", target=target)
    lines, uncommented = text.splitlines(), 0
    for number, line in enumerate(lines):
        value = line.removeprefix("# ").partition(" = ")[2]
        if line.startswith("# ") and "  # " in value and not value.startswith("..."):
            lines[number] = line.removeprefix("# ")
            uncommented += 1
    target.write_text("\n".join(lines), encoding="utf-8")
    assert uncommented > 8
    assert (
        load_panel(target).with_overrides({"name": "x"}).hash
        == load_panel("uic60-760-1-15").with_overrides({"name": "x"}).hash
    )


def test_an_existing_file_stays(tmp_path: Path) -> None:
    target = tmp_path / "mine.toml"
    target.write_text("mine", encoding="utf-8")
    assert "exists already" in refused("panel", "new", target)
    assert target.read_text(encoding="utf-8") == "mine"


def test_a_faulty_source_is_refused_and_nothing_written(tmp_path: Path) -> None:
    faulty, target = tmp_path / "faulty.toml", tmp_path / "mine.toml"
    faulty.write_text(library_text("sb1").replace("[lock]", "[luck]"), encoding="utf-8")
    assert "luck" in refused("panel", "new", target, "--from", faulty)
    assert "must end in .toml" in refused("panel", "new", tmp_path / "mine.txt")
    assert list(tmp_path.iterdir()) == [faulty]


def test_paths_in_a_panel_follow_the_file(tmp_path: Path) -> None:
    inner = tmp_path / "inner"
    inner.mkdir()
    (inner / "way.csv").write_text("time,fraction\n0,0\n3,1\n", encoding="utf-8")
    text = library_text("sb1").replace(
        'shape = "smoothstep"', 'shape = "table"\ntable_file = "way.csv"'
    )
    (inner / "one.toml").write_text(text, encoding="utf-8")
    load_panel(inner / "one.toml")
    target = tmp_path / "mine.toml"
    run("panel", "new", target, "--from", inner / "one.toml")
    assert 'table_file = "inner/way.csv"' in target.read_text(encoding="utf-8")
    assert load_panel(target).movement["throw"].table_fraction == [0.0, 1.0]
