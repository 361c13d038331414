"""The studio's views of detection: probability along the blade, a detector's verdicts."""

from pathlib import Path

from tests.browser.conftest import Screen
from tests.unit.detector_files import detector_file, limit_file, table_file

BARS = (
    "[...document.querySelectorAll('#limit-blade g text:first-of-type')]"
    ".map((one) => one.textContent)"
)


def test_a_limit_follows_the_size_of_the_slider(
    screen: Screen, tmp_path: Path, shots: Path
) -> None:
    page = screen.page
    page.get_by_role("tab", name="Map").click()
    page.locator("#limit-file").set_input_files(limit_file(tmp_path))
    screen.wait(f"{BARS}.length === 4")
    assert page.evaluate(BARS) == ["1.00"] * 4
    screen.set("object.size", 5)
    assert page.evaluate(BARS) == ["1.00", "0.50", "0.00", "1.00"]
    page.screenshot(path=shots / "limit.png")
    assert page.locator("#limit-blade rect[fill*=hatch]").count() == 1
    assert page.locator("#limit-blade line.mark").count() == 4  # only the place known
    assert "Below 90 % at sleeper 3, sleeper 6" in page.locator("#limit-note").inner_text()
    page.get_by_label("Forces").select_option("drive 1")
    assert page.evaluate(BARS)[3] == "0.50"
    assert page.locator("#limit-blade line.mark").count() == 0  # known for both drives together
    assert "WARNING" not in page.locator("#limit-note").inner_text()
    page.locator("#panel").select_option("sb1")
    said = "WARNING: of panel sb2, not of sb1"
    screen.wait(f"document.querySelector('#limit-note').textContent.includes('{said}')")
    page.locator("#limit-file").set_input_files(table_file(tmp_path, [0.0]))
    page.wait_for_selector("#message:not([hidden])")
    assert "no netCDF-4 file" in page.locator("#message").inner_text()
    screen.finished()  # the throw of the other panel, which leaves the refusal where it is
    assert page.locator("#message").is_visible()
    screen.complaints.clear()  # a refusal is also reported on the console


def test_a_detector_judges_what_is_sent(screen: Screen, tmp_path: Path, shots: Path) -> None:
    page = screen.page
    page.get_by_role("tab", name="Detector").click()
    assert page.get_by_role("button", name="Judge the throw shown").is_disabled()
    page.locator("#detector-file").set_input_files(detector_file(tmp_path))
    screen.wait("!document.getElementById('judge-file').disabled")
    assert "Advisory" in page.locator("#detector-state").inner_text()
    page.locator("#judge-file").set_input_files(table_file(tmp_path, [0.0] * 5 + [24e-3]))
    screen.wait("document.getElementById('judged-band').data?.length === 8")
    page.screenshot(path=shots / "detector.png")
    assert page.locator("#judged-verdict").get_attribute("data-level") == "bad"
    assert page.locator("#judged-head").inner_text().startswith("t5: object")
    assert page.locator("#judged-gaps tr").count() == 3
    assert page.evaluate("document.getElementById('judged-trends').data.length") >= 3
    page.get_by_label("Throw", exact=True).select_option("0")
    assert page.locator("#judged-head").inner_text().startswith("t0: sound")
    assert page.locator("#judged-verdict").get_attribute("data-level") == "good"
    assert "gap at" not in page.locator("#judged-lines").inner_text()  # the table has them
    assert page.locator("#judged-blade").is_hidden()
    # a refusal leaves no verdict on other throws below it
    bad = tmp_path / "none.csv"
    bad.write_text("throw,rate [Hz],force 1 [N],force 2 [N]\n", encoding="utf-8")
    page.locator("#judge-file").set_input_files(bad)
    page.wait_for_selector("#message:not([hidden])")
    assert "but no row" in page.locator("#message").inner_text()
    assert page.locator("#judged").is_hidden()
    screen.complaints.clear()  # a refusal is also reported on the console
