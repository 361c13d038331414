"""Working with the studio in a browser: verdict first, nothing lost, everything within reach."""

import json
import shlex
from pathlib import Path

import pytest

from tests.browser.conftest import Screen
from tests.unit.simulated import sb2_dataset
from turnout.core.toml import parse_toml
from turnout.panel.load import panel_from_file
from turnout.throw.checks import checks
from turnout.throw.verdict import verdict

STATES = "[...document.querySelectorAll('.lamp')].map((one) => one.dataset.state)"
ROWS = "document.querySelectorAll('#cursors .key').length"
MEASURES = "performance.getEntriesByName('slider to painted number').map((one) => one.duration)"


def test_the_verdict_is_first_and_green_never_means_missed(screen: Screen) -> None:
    page = screen.page
    expected = verdict(sb2_dataset())
    assert expected.missed
    head, _, detail = expected.text.partition(": ")
    assert page.locator("#verdict-meaning").inner_text() == f"{head}: {expected.meaning}"
    assert page.locator("#verdict-text").inner_text() == detail
    assert page.locator("#verdict").get_attribute("data-level") == "bad"
    assert "missed" in page.evaluate(STATES)
    assert "good" not in page.evaluate(STATES)
    page.get_by_role("tab", name="Findings").click()
    shown = page.locator("#limits").inner_text()
    for check in checks(sb2_dataset()):
        assert check.numbers in shown
        assert check.left in shown
    flangeway = page.locator(".lamp[data-name=Flangeway]")
    assert "of min" in flangeway.inner_text()
    screen.set("object.size", 25)
    assert page.locator("#verdict").inner_text().startswith("Detected by")
    assert "missed" not in page.evaluate(STATES)


def test_an_error_lies_over_the_page_and_marks_what_is_out_of_date(screen: Screen) -> None:
    page, force = screen.page, screen.figure("object_end")
    before = page.locator("#plan").bounding_box(), page.locator("#curves").bounding_box()
    box = page.get_by_label("Size, in mm")
    box.fill("400")
    box.press("Enter")
    page.wait_for_selector("#message:not([hidden])")
    assert "larger than the opening" in page.locator("#message").inner_text()
    assert screen.figure("object_end") == force
    assert (page.locator("#plan").bounding_box(), page.locator("#curves").bounding_box()) == before
    for name in ("Save", "Pin this throw"):
        assert page.get_by_role("button", name=name, exact=True).is_disabled()
    for part in (".verdict", ".lamps", ".plan", ".views"):
        assert (
            float(page.evaluate(f"getComputedStyle(document.querySelector('{part}')).opacity")) < 1
        )
    assert "not up to date" in page.locator("#state").inner_text()
    page.get_by_role("button", name="Close the message").click()
    assert page.get_by_role("button", name="Save", exact=True).is_disabled()
    screen.clear()
    page.get_by_role("button", name="Undo").click()
    screen.finished()
    assert page.input_value("#control-object-size-number") == "13"
    assert page.get_by_role("button", name="Save", exact=True).is_enabled()
    assert page.locator("#message").is_hidden()
    screen.complaints.clear()  # a refusal is also reported on the console


def test_undo_panes_reload_and_links(screen: Screen, studio_address: tuple[str, str]) -> None:
    page = screen.page
    screen.set("object.size", 20)
    screen.set("chair.friction_coefficient", 0.25)
    force = screen.figure("end_force:2")
    page.locator("body").press("Control+z")
    friction = "document.getElementById('control-chair-friction_coefficient-number').value"
    screen.wait(f"{friction} === '0.4'")
    page.locator("body").press("Control+Shift+z")
    screen.wait(f"{friction} === '0.25'")
    screen.finished()
    height = page.locator("#curves").bounding_box()["height"]
    bar = page.get_by_role("separator", name="Height of the plan")
    bar.focus()
    for _ in range(3):
        page.keyboard.press("ArrowDown")
    after = page.locator("#curves").bounding_box()["height"]
    assert after < height - 30
    page.get_by_role("tab", name="Compare").click()
    link = page.url
    assert "chair.friction_coefficient=0.25" in link
    page.reload()
    page.wait_for_selector(".lamp")
    screen.finished()
    assert page.input_value("#control-object-size-number") == "20"
    assert screen.figure("end_force:2") == force
    assert page.locator("#view-compare").is_visible()
    page.get_by_role("tab", name="Curves").click()
    assert page.locator("#curves").bounding_box()["height"] == pytest.approx(after, abs=1)
    bar.dblclick()
    assert page.locator("#curves").bounding_box()["height"] == pytest.approx(height, abs=1)
    # Pasted into the page that is open, which loads it again.
    asked = f"#panel=sb2&object=none&colour=red&{link.partition('&')[2]}"
    with page.expect_event("load"):
        page.goto(f"{studio_address[0]}/{asked}")
    screen.wait("document.getElementById('message-text')?.textContent.includes('colour=red')")
    screen.finished()
    assert not page.get_by_label("object trapped").is_checked()
    assert page.input_value("#control-chair-friction_coefficient-number") == "0.25"


def test_the_cursor_has_the_values_of_every_row(screen: Screen) -> None:
    page = screen.page
    page.get_by_text("Channels", exact=True).click()
    box = page.locator("#curves").bounding_box()
    assert box is not None
    rows = page.evaluate(ROWS)
    page.locator("#channel-list input").first.uncheck()
    assert page.evaluate(ROWS) == rows - 1
    assert "hide=" in page.url
    page.keyboard.press("Escape")
    page.mouse.move(box["x"] + 0.2 * box["width"], box["y"] + 0.2 * box["height"])
    shown = page.locator("#cursor-time").inner_text()
    instant = float(shown.split()[2])
    assert 0 < instant < 8.4
    dataset = sb2_dataset()
    for drive in dataset["drive"].values:
        label = page.locator("#cursors span", has_text=f"Drive {drive}").first.inner_text()
        expected = float(dataset["drive_force"].sel(drive=drive).interp(time=instant)) / 1e3
        assert float(label.split()[-1]) == pytest.approx(expected, abs=0.06)
    page.mouse.click(box["x"] + 0.2 * box["width"], box["y"] + 0.2 * box["height"])
    assert float(page.locator("#time-text").inner_text().split()[0]) == pytest.approx(
        instant, abs=0.1
    )


def test_what_is_saved_here_opens_here(screen: Screen, tmp_path: Path) -> None:
    page = screen.page
    screen.set("drive.2.stiffness", 300)
    saved = {}
    for kind in ("csv", "toml", "txt", "py"):
        page.get_by_label("Download").select_option(kind)
        with page.expect_download() as begun:
            page.get_by_role("button", name="Save", exact=True).click()
        saved[kind] = tmp_path / begun.value.suggested_filename
        begun.value.save_as(saved[kind])
    assert saved["csv"].name == "sb2_13mm_sleeper-6_drive.2.stiffness=300kN-m.csv"
    written = panel_from_file(parse_toml(saved["toml"].read_text(), source="saved.toml"))
    assert written.drive["2"].stiffness == 300e3
    assert "drive.2.stiffness=300kN/m" in shlex.split(saved["txt"].read_text())
    compile(saved["py"].read_text(), "throw.py", "exec")
    lines = page.evaluate("document.getElementById('curves').data.length")
    page.locator("#recording").set_input_files(saved["csv"])
    screen.wait(f"document.getElementById('curves').data.length > {lines}")
    # The same throw once more differs from itself by rounding alone.
    assert "rms 0.00 kN" in page.locator("#cursors").text_content()


def test_the_object_is_within_five_stops_and_space_plays(screen: Screen) -> None:
    page = screen.page
    # From the head of the page on.
    page.evaluate("document.body.tabIndex = -1, document.body.focus()")
    page.evaluate("document.body.removeAttribute('tabindex')")
    stops = []
    while "handle" not in stops and len(stops) < 9:
        page.keyboard.press("Tab")
        stops.append(page.evaluate("document.activeElement.id"))
    assert len(stops) <= 5, stops
    page.keyboard.press("Space")
    assert page.locator("#play").get_attribute("aria-pressed") == "true"
    page.keyboard.press("Space")
    assert page.locator("#play").get_attribute("aria-pressed") == "false"
    page.get_by_label("object trapped").focus()
    page.keyboard.press("Space")
    assert not page.get_by_label("object trapped").is_checked()
    assert page.locator("#play").get_attribute("aria-pressed") == "false"


def test_a_map_shows_what_reports_an_object(screen: Screen, shots: Path) -> None:
    page = screen.page
    page.get_by_role("tab", name="Map").click()
    page.get_by_label("Sizes [mm]").fill("13, 25")
    page.get_by_role("button", name="Compute").click()
    screen.wait("document.querySelectorAll('#map-table tr').length === 3")
    page.screenshot(path=shots / "map.png")
    assert "undetected" in page.locator("#map-state").inner_text()
    screen.clear()
    page.get_by_role("button", name="25 mm at sleeper 6: detected").click()
    screen.finished()
    assert page.input_value("#control-object-size-number") == "25"
    assert page.locator("#verdict").inner_text().startswith("Detected by")
    page.get_by_label("Sizes [mm]").fill("thirteen")
    page.get_by_role("button", name="Compute").click()
    assert "no list of sizes" in page.locator("#message").inner_text()


def test_a_wheel_narrows_the_gauge_beside_an_object(screen: Screen, shots: Path) -> None:
    page = screen.page
    page.get_by_role("tab", name="Wheel").click()
    page.get_by_role("button", name="Roll", exact=True).click()
    page.wait_for_selector("#message:not([hidden])")
    assert "has no [gauge]" in page.locator("#message").inner_text()
    screen.complaints.clear()
    screen.clear()
    page.get_by_label("Panel", exact=True).select_option("60e1-300-1-9")
    screen.finished()
    page.get_by_label("Y [kN]").fill("20")
    page.get_by_role("button", name="Roll", exact=True).click()
    screen.wait("document.querySelectorAll('#wheel-chart .scatterlayer .trace').length === 3")
    page.screenshot(path=shots / "wheel.png")
    told = page.locator("#wheel-findings").inner_text()
    assert "Gauge too narrow" in told
    assert "Y = 20 kN, Q = 50 kN" in told
    page.get_by_label("Y [kN]").fill("-1")
    page.get_by_role("button", name="Roll", exact=True).click()
    assert "no force of at least 0" in page.locator("#message").inner_text()


def test_the_page_measures_how_fast_it_is(screen: Screen) -> None:
    page = screen.page
    page.evaluate("performance.clearMeasures()")
    page.locator("#control-object-size").focus()
    page.keyboard.press("ArrowRight")
    screen.wait(f"{MEASURES}.length > 0")
    assert all(0 < one < 20_000 for one in page.evaluate(MEASURES))


def test_a_phone_and_paper_show_results_first(screen: Screen, shots: Path) -> None:
    page = screen.page
    page.set_viewport_size({"width": 390, "height": 844})
    page.screenshot(path=shots / "phone.png", full_page=True)
    tops = [
        page.locator(part).bounding_box()["y"]
        for part in ("#verdict", "#lamps", "#plan", "#curves", "aside")
    ]
    assert tops == sorted(tops)
    for view in ("Map", "Wheel", "Detector", "Curves"):
        page.get_by_role("tab", name=view).click()
        assert page.evaluate("document.documentElement.scrollWidth") <= 390, view
    page.emulate_media(media="print")
    page.screenshot(path=shots / "print.png", full_page=True)
    assert page.locator("aside").is_hidden()
    for part in ("#verdict", "#plan", "#curves", "#words"):
        assert page.locator(part).is_visible()


# Text against what is behind it, as WCAG 2 computes it: 4.5 : 1 for text of usual size.
CONTRAST = """() => {
  const parse = (text) => text.match(/[\\d.]+/g).map(Number);
  const part = (v) => { v /= 255; return v <= 0.03928 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4; };
  const bright = ([r, g, b]) => 0.2126 * part(r) + 0.7152 * part(g) + 0.0722 * part(b);
  const behind = (node) => {
    for (let one = node; one; one = one.parentElement) {
      const found = parse(getComputedStyle(one).backgroundColor);
      if (found.length < 4 || found[3] > 0.99) return found;
    }
    return [255, 255, 255];
  };
  const poor = [];
  for (const node of document.querySelectorAll("body *")) {
    const own = [...node.childNodes].some((one) => one.nodeType === 3 && one.textContent.trim());
    const left_out = node.disabled || node.closest("svg, #curves, option, i");
    if (!own || !node.checkVisibility() || left_out) continue;
    const ink = bright(parse(getComputedStyle(node).color)), paper = bright(behind(node));
    const ratio = (Math.max(ink, paper) + 0.05) / (Math.min(ink, paper) + 0.05);
    const name = `${node.tagName}#${node.id} ${node.textContent.trim().slice(0, 30)}`;
    if (ratio < 4.5) poor.push(`${name}: ${ratio.toFixed(2)}`);
  }
  return poor;
}"""


def test_text_has_contrast_and_axe_finds_nothing(screen: Screen) -> None:
    page = screen.page
    for theme in ("light", "dark"):
        page.get_by_label("Colours").select_option(theme)
        assert page.evaluate(CONTRAST) == [], theme
    ids = page.evaluate("[...document.querySelectorAll('[id]')].map((one) => one.id)")
    assert len(ids) == len(set(ids))
    axe = pytest.importorskip("axe_core_python", reason="axe-core is not a dependency of turnout")
    script = next(Path(axe.__file__).parent.glob("**/axe.min.js")).read_text(encoding="utf-8")
    page.evaluate(script)
    for theme in ("light", "dark"):
        page.get_by_label("Colours").select_option(theme)
        found = page.evaluate("axe.run().then((found) => JSON.stringify(found.violations))")
        places = [f"{item['id']}: {item['nodes'][0]['html'][:100]}" for item in json.loads(found)]
        assert places == [], theme
