"""The long job of 2,000 scenarios (-m long), and the machinery that runs it."""

import gc
import json
import os
import signal
import subprocess
import sys
import time
import weakref
from pathlib import Path

import pytest
from benchmarks.studies import robustness
from benchmarks.studies.robustness import is_defect, main, read_results, result_of, run_job
from benchmarks.studies.robustness_report import page
from tests.verification.robustness_checks import seconds_deaf, simulate_module
from tests.verification.robustness_scenarios import numbered_scenario

COUNT = 2000
ALLOWED = 0.01
ROOT = Path(__file__).parents[2]


@pytest.mark.long
@pytest.mark.usefixtures("worker_processes")
def test_two_thousand_scenarios() -> None:
    """At most 1 % stop early, none without a reason, none that 0.1 ms would have saved."""
    chosen = os.environ.get("TURNOUT_ROBUSTNESS_DIR")
    folder = Path(chosen) if chosen else ROOT / "build" / "robustness"
    results = run_job(COUNT, folder=folder, workers=os.cpu_count() or 1)
    assert len(results) == COUNT
    defects = [record for record in results if is_defect(record)]
    assert not defects, "\n".join(str(record) for record in defects[:20])
    assert sum(not record["complete"] for record in results) <= ALLOWED * COUNT


@pytest.fixture
def in_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """Run scenarios here instead of in workers."""

    def results(missing: list[int], _workers: int):
        for index in missing:
            yield result_of(index)

    monkeypatch.setattr(robustness, "_results", results)


@pytest.mark.usefixtures("in_process")
def test_a_job_goes_on_where_it_was_killed(tmp_path: Path) -> None:
    first = run_job(3, folder=tmp_path, workers=1)
    assert [record["index"] for record in first] == [0, 1, 2]
    with (tmp_path / "runs.jsonl").open("a") as file:
        file.write('{"index": 3, "kind": "sb1", "comp')
    assert read_results(tmp_path) == first
    second = run_job(5, folder=tmp_path, workers=1)
    assert second[:3] == first
    assert [record["index"] for record in second] == [0, 1, 2, 3, 4]
    lines = (tmp_path / "runs.jsonl").read_text().splitlines()
    assert [json.loads(line)["index"] for line in lines] == [0, 1, 2, 3, 4]


@pytest.mark.usefixtures("worker_processes")
def test_ctrl_c_keeps_what_there_is(tmp_path: Path) -> None:
    module = "benchmarks.studies.robustness"
    command = [sys.executable, "-m", module, "run", "--count=2000", "--workers=1"]
    with subprocess.Popen(
        [*command, "--out", str(tmp_path)], cwd=ROOT, stderr=subprocess.PIPE, text=True
    ) as program:
        try:
            path = tmp_path / "runs.jsonl"
            while not (path.exists() and path.read_bytes().count(b"\n") > 2):
                assert program.poll() is None
                time.sleep(0.01)
            program.send_signal(signal.SIGINT)
            _, text = program.communicate(timeout=30)
        finally:
            program.kill()
    assert program.returncode == 130, text
    assert "interrupted; results until now are in" in text
    assert len(read_results(tmp_path)) > 2


class Cycle:
    """Garbage that only the collector finds."""

    def __init__(self, found: list[bool]) -> None:
        self.found, self.itself = found, self

    def __del__(self) -> None:
        self.found.append(True)


def test_no_finaliser_of_others_meets_the_interrupt(monkeypatch: pytest.MonkeyPatch) -> None:
    """When the throw begins the garbage of others is gone, and nothing collects during it."""
    found: list[bool] = []
    during: list[tuple[int, bool]] = []

    def thrown(*_: object, **__: object) -> None:
        during.append((len(found), gc.isenabled()))

    monkeypatch.setattr(simulate_module, "simulate", thrown)
    gc.disable()  # so that nothing else collects it
    Cycle(found)
    seconds_deaf(numbered_scenario(0), after=10.0)
    assert during == [(1, False)]
    assert gc.isenabled()


def test_an_interrupt_in_a_finaliser_comes_after_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """What a finaliser raises is dropped, so the alarm waits until it has ended."""
    rung: list[float] = []

    def finalised() -> None:
        signal.raise_signal(signal.SIGALRM)

    def thrown(*_: object, **__: object) -> None:
        weakref.finalize(Cycle([]), finalised)
        gc.collect()
        rung.append(time.monotonic())
        time.sleep(10.0)

    monkeypatch.setattr(simulate_module, "simulate", thrown)
    seconds_deaf(numbered_scenario(0), after=30.0)
    assert time.monotonic() - rung[0] < 5.0


def test_an_exception_is_a_result(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: object, **__: object) -> None:
        message = "no such thing"
        raise KeyError(message)

    monkeypatch.setattr(robustness, "run_scenario", broken)
    record = result_of(0)
    assert record["outcome"] == "EXCEPTION"
    assert is_defect(record)


def test_the_page_tells_what_happened(monkeypatch: pytest.MonkeyPatch) -> None:
    sound = [result_of(index) for index in (0, 1)]
    early = {
        **sound[0],
        "index": 7,
        "complete": False,
        "outcome": "NOT_CONVERGED",
        "message": "not converged at t = 1 s",
        "fine": "COMPLETE",
    }
    assert [is_defect(record) for record in (*sound, early)] == [False, False, True]
    job = {"machine": "a machine", "workers": 2, "python": "3", "seed": 1, "kernels": "k"}
    text = page([*sound, early], job)
    assert "| runs | 3 |" in text
    assert "| stopped early | 1 (33.33 %; allowed 1 %) |" in text
    assert "| defects | 1 |" in text
    assert "| 1 ms | 2 | " in text
    assert "| 7 | " in text
    assert "not converged at t = 1 s" in text
    assert "complete at 0.1 ms" in text
    assert "None." in page(sound, job)


def test_show_repeats_a_scenario(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["show", "2"]) == 0
    shown = capsys.readouterr().out
    assert shown.startswith("panel: sb1")
    assert "complete" in shown
