"""The studio in a real browser: what a user does, and what the screen then says."""

from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from tests.browser.conftest import Screen
from turnout.law.object_kind import OBJECT_KINDS
from turnout.panel.load import library_text

if TYPE_CHECKING:
    from playwright.sync_api import Browser

CURVE = "JSON.stringify(document.getElementById('curves').data.map((line) => line.y.slice(-50)))"
RAIL = "document.querySelector('polygon[data-rail]').getAttribute('points')"


def test_dragging_the_object_moves_it_and_the_curves(screen: Screen) -> None:
    page = screen.page
    box = page.locator("#handle .knob").bounding_box()
    assert box is not None
    force, curve = screen.figure("object_end"), page.evaluate(CURVE)
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    screen.clear()
    page.mouse.move(x, y)
    page.mouse.down()
    for step in range(1, 11):
        page.mouse.move(x + 9 * step, y)
    page.mouse.up()
    place = float(page.locator("#handle").get_attribute("aria-valuenow") or "nan")
    assert place > 4.5
    # A slow machine may have finished a throw of a place on the way.
    screen.wait(f"document.getElementById('words').textContent.includes('x = {place:g} m')")
    screen.finished()
    assert page.input_value("#control-object-x-number") == f"{place:g}"
    assert screen.figure("object_end") != force
    assert page.evaluate(CURVE) != curve


def test_keys_move_the_object(screen: Screen) -> None:
    page = screen.page
    handle = page.locator("#handle")
    start = float(handle.get_attribute("aria-valuenow") or "nan")
    screen.clear()
    handle.focus()
    page.keyboard.press("ArrowRight")
    screen.finished()
    assert float(handle.get_attribute("aria-valuenow") or "nan") == pytest.approx(start + 0.05)
    page.keyboard.press("PageUp")
    assert "sleeper 7" in (handle.get_attribute("aria-valuetext") or "")
    page.keyboard.press("Home")
    assert float(handle.get_attribute("aria-valuenow") or "nan") == 0.0
    screen.finished()


def test_sliders_change_numbers_lamps_and_rails(screen: Screen) -> None:
    page = screen.page
    before = screen.figure("end_force:2")
    assert page.locator(".lamp[data-name=TKK1]").get_attribute("data-state") == "missed"
    rail = page.evaluate(RAIL)
    slider = page.locator("#control-object-size")
    screen.clear()
    slider.focus()
    for _ in range(24):
        page.keyboard.press("ArrowRight")
    screen.finished()
    assert page.input_value("#control-object-size-number") == "25"
    assert screen.figure("end_force:2") != before
    assert page.locator(".lamp[data-name=TKK1]").get_attribute("data-state") == "bad"
    assert "13 mm" in page.locator(".lamp[data-name=TKK1] small").inner_text()
    assert page.evaluate(RAIL) != rail
    screen.set("chair.friction_coefficient", 0.1)
    low = float(screen.figure("end_force:2").split()[0])
    screen.set("chair.friction_coefficient", 0.4)
    assert low < float(screen.figure("end_force:2").split()[0])
    page.get_by_role("button", name="Reset to the panel's values").click()
    screen.finished()


def test_kinds_of_objects_are_chosen(screen: Screen) -> None:
    page = screen.page
    choice = page.get_by_label("Kind", exact=True)
    assert choice.locator("option").all_inner_texts() == list(OBJECT_KINDS)
    force = float(screen.figure("object_end").split()[0])
    screen.clear()
    choice.select_option("snow")
    screen.finished()
    assert float(screen.figure("object_end").split()[0]) < force  # snow is compacted
    assert "snow" in page.evaluate("document.getElementById('words').textContent")


def test_without_an_object_the_switch_closes(screen: Screen) -> None:
    page = screen.page
    screen.clear()
    page.get_by_label("object trapped").uncheck()
    screen.finished()
    assert page.locator("#handle").is_hidden()
    assert "none" in page.evaluate("document.getElementById('words').textContent")
    lamps = page.locator(".lamp:not([data-kind=limit])")
    assert set(lamps.evaluate_all("all => all.map((one) => one.dataset.state)")) == {"good"}
    # Of this panel the open rail is nearer to its stock rail than its limit.
    assert page.locator(".lamp[data-name=Flangeway]").get_attribute("data-state") == "bad"
    assert page.locator("#verdict").inner_text().startswith("Not sound")


def test_playing_moves_the_rails(screen: Screen) -> None:
    page = screen.page
    end = page.evaluate(RAIL)
    page.get_by_role("slider", name="Time", exact=True).fill("24")
    assert page.evaluate(RAIL) != end
    assert page.locator("#time-text").inner_text() == "1.70 s"
    # While the rail moves, no sensor is asked.
    assert page.locator(".lamp[data-name=TKK1]").get_attribute("data-state") == "rest"
    page.get_by_role("button", name="Play").click()
    screen.wait("Number(document.getElementById('time').value) > 26")
    page.get_by_role("button", name="Pause").click()
    middle = page.evaluate(RAIL)
    page.get_by_role("slider", name="Lateral scale").fill("12")
    assert page.evaluate(RAIL) != middle


def test_pinned_throws_stand_beside_the_present_one(screen: Screen, tmp_path: Path) -> None:
    page = screen.page
    lines = page.evaluate("document.getElementById('curves').data.length")
    page.get_by_role("button", name="Pin this throw").click()
    screen.set("object.size", 20)
    page.get_by_role("tab", name="Compare").click()
    row = page.locator("#table tr[data-key='object_end'] td")
    assert row.count() == 2
    assert row.nth(0).inner_text() != row.nth(1).inner_text()
    assert page.evaluate("document.getElementById('curves').data.length") > lines
    for kind, mark in (("nc", b"\x89HDF"), ("csv", b"time [s]"), ("png", b"\x89PNG")):
        page.get_by_label("Download").select_option(kind)
        with page.expect_download() as begun:
            page.get_by_role("button", name="Save").click()
        file = tmp_path / f"file.{kind}"
        begun.value.save_as(file)
        assert begun.value.suggested_filename == f"sb2_20mm_sleeper-6.{kind}"
        assert file.read_bytes().startswith(mark)
    assert "P1: 13 mm at sleeper 6" in page.locator("#curves-note").inner_text()
    page.get_by_role("button", name="Unpin 13 mm").click()
    assert row.count() == 1


def test_files_good_and_bad(screen: Screen, tmp_path: Path) -> None:
    page = screen.page
    bad = tmp_path / "bad.toml"
    bad.write_text(library_text("sb1").replace('"750 kN/m"', '"750 kg"'), encoding="utf-8")
    page.get_by_label("Panel file (.toml)").set_input_files(bad)
    page.wait_for_selector("#message:not([hidden])")
    assert "750 kg" in page.locator("#message").inner_text()
    assert page.input_value("#panel") == "sb2"
    good = tmp_path / "good.toml"
    good.write_text(library_text("sb2").replace('name = "sb2"', 'name = "ours"'), encoding="utf-8")
    screen.clear()
    page.get_by_label("Panel file (.toml)").set_input_files(good)
    screen.finished()
    assert "good.toml: OK (ours" in page.locator("#notes").inner_text()
    assert page.locator("#message").is_hidden()
    page.get_by_role("tab", name="Curves").click()
    page.get_by_role("button", name="Check the panel").click()
    assert page.locator("#check-progress").is_visible()
    screen.set("object.size", 11)  # the check goes on beside this
    screen.wait("/warning/.test(document.getElementById('notes').textContent)")
    assert "see Files and checks" in page.locator("#check-state").inner_text()
    assert page.locator("#view-curves").is_visible()
    csv = tmp_path / "empty.csv"
    csv.write_text("", encoding="utf-8")
    page.get_by_label("Recording of a data acquisition system").set_input_files(csv)
    page.wait_for_selector("#message:not([hidden])")
    assert "empty.csv: the file is empty" in page.locator("#message").inner_text()
    screen.complaints.clear()  # refusals are also shown on the console


def test_measured_throws_are_laid_over(screen: Screen, shots: Path) -> None:
    page = screen.page
    lines = page.evaluate("document.getElementById('curves').data.length")
    names = page.locator("#movement option").all_inner_texts()
    chosen = next(name for name in names if "13 mm" in name)
    page.get_by_label("Overlay").select_option(label=chosen)
    screen.wait(f"document.getElementById('curves').data.length > {lines}")
    assert "measured − computed" in page.locator("#channel-list").text_content()
    assert "rms" in page.locator("#cursors").text_content()
    screen.set("object.size", 5)
    page.get_by_role("button", name="Use the object from the run sheet").click()
    screen.wait("document.getElementById('control-object-size-number').value === '13'")
    screen.finished()
    page.screenshot(path=shots / "measured.png")


def test_a_sent_recording_is_laid_over(screen: Screen) -> None:
    page = screen.page
    page.get_by_role("tab", name="Files and checks").click()
    with page.expect_download() as begun:
        page.locator("#campaign-files a", has_text=".csv").first.click()
    file = begun.value.path()
    page.get_by_label("Recording of a data acquisition system").set_input_files(
        {"name": "ours.csv", "mimeType": "text/csv", "buffer": Path(file).read_bytes()}
    )
    screen.wait("/ours.csv: text/.test(document.getElementById('notes').textContent)")
    page.get_by_role("combobox", name="Map").select_option("campaign")
    screen.wait("document.getElementById('movement').value.startsWith('sent-')")
    assert "ours.csv: " in page.locator("#movement option:checked").inner_text()


def test_the_view_in_space_shows_the_panel_and_is_turned(screen: Screen, shots: Path) -> None:
    page = screen.page
    page.get_by_role("tab", name="3-D").click()
    screen.wait("/Lateral scale/.test(document.getElementById('scene-note').textContent)")
    pictures = [page.locator("#scene").screenshot()]
    assert len(pictures[0]) > 8000, "an empty picture is smaller"
    page.get_by_role("slider", name="Time", exact=True).fill("50")
    pictures.append(page.locator("#scene").screenshot())
    for name in ("From above", "Object"):
        page.get_by_role("button", name=name, exact=True).click()
        pictures.append(page.locator("#scene").screenshot())
    assert len(set(pictures)) == 4
    page.screenshot(path=shots / "space.png")


def test_everything_can_be_reached_and_named(screen: Screen) -> None:
    unnamed = screen.page.evaluate(
        """[...document.querySelectorAll("input, select, button, [tabindex]")].filter((one) =>
            !one.labels?.length && !one.getAttribute("aria-label") &&
            !one.getAttribute("aria-labelledby") && !one.textContent.trim())
            .map((one) => one.outerHTML)"""
    )
    assert unnamed == []
    screen.page.get_by_role("tab", name="Curves").focus()
    screen.page.keyboard.press("ArrowRight")
    assert screen.page.locator("#view-scene").is_visible()
    screen.page.keyboard.press("End")
    assert screen.page.locator("#view-notes").is_visible()


@pytest.mark.parametrize(
    ("size", "text", "theme"),
    [((1280, 720), "normal", "light"), ((1920, 1080), "large", "dark")],
    ids=["laptop", "projector"],
)
def test_it_fits_the_screen(
    screen: Screen, shots: Path, size: tuple[int, int], text: str, theme: str
) -> None:
    page = screen.page
    page.set_viewport_size({"width": size[0], "height": size[1]})
    page.get_by_label("Text").select_option(text)
    page.get_by_label("Colours").select_option(theme)
    screen.wait("document.getElementById('curves').data?.length > 4")
    page.screenshot(path=shots / f"{theme}-{size[1]}.png")
    overflow = page.evaluate(
        "[document.body.scrollWidth - innerWidth, document.body.scrollHeight - innerHeight]"
    )
    assert max(overflow) <= 0
    curves = page.locator("#curves").bounding_box()
    assert curves is not None
    assert curves["height"] >= 0.5 * size[1]
    ground = page.evaluate("getComputedStyle(document.body).backgroundColor")
    assert (sum(map(int, ground[4:-1].split(","))) < 200) == (theme == "dark")


def test_a_spent_address_says_what_to_do(
    browser: "Browser", studio_address: tuple[str, str]
) -> None:
    page = browser.new_page()
    page.goto(f"{studio_address[0]}/?token=spent")
    assert "used before" in page.locator("body").inner_text()
    page.close()
