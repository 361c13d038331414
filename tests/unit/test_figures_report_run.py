"""The page about a run: one file, small, that names no address and holds what it shows."""

import base64
import json
import re

import pytest
from tests.unit.simulated import sb2_dataset, sb2_panel

from turnout.figures.report.inputs import inputs_section, panel_of_result
from turnout.figures.report.page import Page, Picture, Section, Table, page_html
from turnout.figures.report.run import FIGURE_SUFFIXES, picture_of, run_page, run_sheets
from turnout.panel.load import load_panel

VOCABULARIES = {"http://www.w3.org"}


@pytest.fixture(scope="module")
def html() -> str:
    dataset = sb2_dataset()
    first, *others = run_sheets(dataset)
    pictures = [picture_of(first), *(Picture(sheet, {}) for sheet in others)]
    return page_html(run_page(dataset, panel=panel_of_result(dataset.attrs), pictures=pictures))


def test_it_is_one_file_that_names_no_address(html: str) -> None:
    assert set(re.findall(r"https?://[\w.-]+", html)) <= VOCABULARIES
    assert not re.search(r"<(link|iframe|object|embed|base)\b|\bsrc=['\"](?!data:)|@import", html)
    assert "default-src 'none'" in html


def test_it_says_first_what_matters(html: str) -> None:
    words = html[html.index("<body>") :]
    assert words.index("Undetected object") < words.index("Locked?") < words.index("class='chart'")


def test_every_figure_is_there_as_data_and_those_drawn_as_files(html: str) -> None:
    records = re.findall(r"<script type='application/json'>(.*?)</script>", html)
    names = [json.loads(record)["name"] for record in records]
    assert names == [sheet.name for sheet in run_sheets(sb2_dataset())]
    for suffix, start in ((".pdf", b"%PDF"), (".png", b"\x89PNG"), (".svg", b"<?xml")):
        files = re.findall(
            rf"download='([\w-]+)\{suffix}' href='data:[\w/+]+;base64,([^']+)'", html
        )
        assert [name for name, _ in files] == names[:1]
        assert all(base64.b64decode(content).startswith(start) for _, content in files)


def test_inputs_carry_their_origin() -> None:
    panel = load_panel("uic60-760-1-15").with_overrides({"drive.2.stiffness": "81 kN/m"})
    changed, values = inputs_section({"overrides": json.dumps(dict(panel.overrides))}, panel).tables
    assert changed.rows == [("drive.2.stiffness", "81 kN/m")]
    reported = {row[:2]: (number, *row[2:]) for number, row in enumerate(values.rows)}
    number, text, origin = reported["drive (1, 2)", "stiffness (1)"]
    assert (text, origin) == ("750 kN/m", "paper: section 4.2, best fit")
    assert number not in values.marked
    assert reported["drive (1, 2)", "stroke (1)"][0] in values.marked


def test_overrides_are_reported_and_the_panel_is_found_again_with_them() -> None:
    changed = sb2_panel().with_overrides({"chair.friction_coefficient": 0.3})
    attributes = {
        "panel": changed.name,
        "panel_hash": changed.hash,
        "overrides": json.dumps(dict(changed.overrides)),
    }
    found = panel_of_result(attributes)
    assert found is not None
    assert found.hash == changed.hash
    assert panel_of_result({**attributes, "overrides": "{}"}) is None
    assert panel_of_result({**attributes, "panel": "nowhere"}) is None
    assert panel_of_result(attributes, panel=load_panel("sb1")) is None


def test_a_panel_that_is_not_at_hand_is_said_to_be() -> None:
    page = run_page(sb2_dataset(), pictures=[])
    assert any("not at hand" in section.text for section in page.sections)


def test_texts_of_others_cannot_become_markup() -> None:
    rows = [("</td><script>alert(1)</script>", "&")]
    section = Section(heading="<b>", tables=[Table("", ("<i>",), rows)])
    html = page_html(Page(title="</title><b>", subtitle="'", findings=[], sections=[section]))
    assert "<script>alert" not in html
    assert "<b>" not in html
    assert "<i>" not in html


def test_a_title_cannot_end_the_data_of_a_chart() -> None:
    dataset = sb2_dataset().assign_attrs(panel="</script><b>")
    (sheet, *_) = run_sheets(dataset)
    html = page_html(run_page(dataset, pictures=[Picture(sheet, {})]))
    (record,) = re.findall(r"<script type='application/json'>(.*?)</script>", html)
    assert json.loads(record)["title"].startswith("</script><b>")


def test_a_measured_movement_needs_only_its_forces() -> None:
    forces = sb2_dataset()[["drive_force"]].drop_attrs().assign_attrs(title="Autumn, throw 3")
    page = run_page(forces)
    assert page.title == "Throw of Autumn, throw 3"
    assert [p.sheet.name for s in page.sections for p in s.pictures] == ["throw"]
    assert set(page.sections[0].pictures[0].files) == set(FIGURE_SUFFIXES)
