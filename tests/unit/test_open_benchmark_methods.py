"""Every method of the open benchmark sees what is obvious, and gives the same numbers twice."""

import ast
import json
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import xarray as xr
from benchmarks.detection import metrics, run_methods, turnout_detector
from benchmarks.detection.__main__ import main
from benchmarks.detection.data import Side, open_benchmark
from benchmarks.detection.definition import PRESETS, Counts
from benchmarks.detection.make_throws import make_throws
from benchmarks.detection.method import Method
from benchmarks.detection.run_methods import (
    COMMON,
    USES,
    Conditions,
    digest_of,
    folds_of,
    methods_for,
    run_method,
    sources_of,
)
from benchmarks.detection.score import score_verdicts
from benchmarks.detection.verdicts import Verdicts
from tests.unit.benchmark_toy import toy_benchmark

from turnout.detection.conditions import SIMULATED

bench = cache(toy_benchmark)
BASELINES = [item for item in methods_for(Conditions()) if item.name != "turnout"]


@pytest.mark.parametrize("method", BASELINES, ids=lambda item: item.name)
def test_each_baseline_sees_an_obvious_object(
    method: Method, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(metrics, "LEAST_HITS", 10**6)  # curves are fitted in other tests
    if method.name in ("isolation-forest", "boosting"):
        pytest.importorskip("sklearn")
    one = replace(method, settings=method.settings[:1])  # type: ignore[type-var]
    result = run_method(one, bench(), tmp_path, data="toy")
    place, share, count = result["score"]["obvious"]
    assert count >= 3
    # 25 mm are 3.75 kN here, on 0.4 kN of all that differs otherwise
    assert share == 1.0, place
    assert (tmp_path / f"{method.name}.csv").exists()


def test_a_perfect_detector_has_the_figures_of_one() -> None:
    side = bench().test.of(bench().test.judged)
    size = side.labels["size"]
    verdicts = Verdicts(
        throw=side.throw, score=size, alarm=size > 0.0,
        probability=(size > 0.0).astype(float), novelty=size, cause=side.labels["role"],
        size=np.column_stack([size, size, size]),
    )  # fmt: skip
    score = score_verdicts(verdicts, side, history=bench().history)
    assert score.false_alarms.value == 0.0
    assert score.macro_f1 == 1.0
    assert score.calibration == 0.0
    assert score.size is not None
    assert score.size.coverage == 1.0
    assert score.size.median == 0.0
    assert score.mid_span == pytest.approx(size[size > 0].min(), abs=2e-3)


TINY = Counts(switches=6, machines=0, known=1, sound=2, objects=2, causes=0)
Printed = Callable[..., Any]


@pytest.fixture
def printed(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Printed:
    """Return a function that runs a command and returns its stdout, `out`, and stderr, `err`."""

    def run(*line: str) -> Any:
        monkeypatch.setattr("sys.argv", ["benchmark", *line])
        main()
        return capsys.readouterr()

    return run


def made_until(folder: Path, count: int) -> Path:
    """Make a benchmark until some switches are thrown, and return the folder of these."""

    class Enough(Exception):
        pass

    def stop(done: int, total: int) -> None:
        if done == count:
            raise Enough

    with pytest.raises(Enough):
        make_throws(folder, TINY, report=stop)
    assert len(list((folder / "switches").glob("*.nc"))) == count
    return folder / "switches"


def check_partners(train: Side) -> None:
    """Check that a throw with an object is the sound one of its state and what the object adds."""
    rows = np.flatnonzero(train.partner >= 0)
    assert rows.size
    assert np.array_equal(train.groups[rows], train.groups[train.partner[rows]])
    assert np.array_equal(train.labels["level"][rows], train.labels["level"][train.partner[rows]])
    before = slice(0, 100)  # while the switch opens, before anything is touched
    for row in rows[train.labels["role"][rows] == "object"]:
        change = train.clean[row] - train.clean[train.partner[row]]
        assert np.abs(change[:, before]).max() <= 1.0


def test_the_command_goes_on_where_it_was_stopped_compares_and_scores(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, printed: Printed
) -> None:
    monkeypatch.setitem(PRESETS, "small", TINY)
    folder = tmp_path / "bench"
    kept = made_until(folder, 2)
    one, same = (
        xr.load_dataset(path / "000.nc") for path in (kept, made_until(tmp_path / "again", 1))
    )
    assert one.identical(same)
    line = ["run", str(folder), "--size", "small", "--workers", "1"]
    line += ["--method", "threshold", "--main"]
    first = printed(*line, "--json")
    assert "methods: 2 of 2 done, last markers-force-h0-d5" in first.err
    found = json.loads(first.out)
    assert set(found["results"]) == {"markers-force-h20-d5", "markers-force-h0-d5"}
    for name in ("data-card.md", "table.md", "roc.png", "pod.png"):
        assert (folder / name).stat().st_size > 100
    card = (folder / "data-card.md").read_text()
    assert "Panels on both sides of the split: 0." in card
    assert SIMULATED.capitalize() in card
    # the second time nothing is run again, and the numbers are the same
    again = printed(*line, "--json", "--quiet")
    assert not again.err
    assert json.loads(again.out)["results"] == found["results"]
    shown = printed(*line).out
    assert f"numbers         {found['numbers']}" in shown
    said = folder / "results" / "markers-force-h20-d5" / "threshold.csv"
    own = json.loads(printed("score", str(folder), str(said), "--json").out)
    assert own["score"] == found["results"]["markers-force-h20-d5"]["threshold"]["score"]
    scored = printed("score", str(folder), str(said)).out
    assert "false alarms" in scored
    assert found["origin"] == own["origin"] == SIMULATED
    assert all(f"origin          {SIMULATED}" in text for text in (shown, scored))
    sides = open_benchmark(folder)
    assert not set(sides.train.groups) & set(sides.test.groups)
    check_partners(sides.train)


@pytest.mark.parametrize(
    ("line", "words"),
    [
        (["run", "{}", "--size", "huge"], "invalid choice: 'huge' (choose from"),
        (["run", "{}", "--workers", "0"], "--workers: 0: must be a whole number, 1 or more"),
        (["run", "{}", "--size", "small"], "is not empty and holds no benchmark"),
        (["score", "{}", "said.csv"], "run: python -m benchmarks.detection run"),
        (["score", "{}", "said.csv", "--track", "all", "--history", "-1"], "2 problems"),
    ],
)
def test_bad_input_is_one_message_and_code_2(
    line: list[str], words: str, tmp_path: Path, printed: Printed,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(SystemExit) as ended:
        printed(*(part.format(tmp_path) for part in line))
    assert ended.value.code == 2
    assert words in capsys.readouterr().err


SOURCES = Path(run_methods.__file__).parent
MADE = {"definition", "make_throws", "switch_throws"}
"""Modules that what is stored of throws follows from: the digest of the data stands for them."""


@pytest.mark.parametrize(
    "method",
    [*methods_for(Conditions(discrepancy=0.1)), methods_for(Conditions(track="machines"))[-1]],
    ids=lambda item: f"{type(item).__name__} {item.name}",
)
def test_results_are_made_again_when_what_they_come_from_changes(method: Method) -> None:
    sources = sources_of(method)
    assert len(set(sources)) == len(sources)
    assert set(COMMON) < set(sources)
    assert digest_of(sources) != digest_of(sources[1:])
    for name in [item for item in sources if "/" not in item]:
        tree = ast.parse((SOURCES / name).read_text(encoding="utf-8"))
        own = {
            (node.module or "").rpartition(".")[2] for node in ast.walk(tree)
            if isinstance(node, ast.ImportFrom) and str(node.module).startswith("benchmarks.")
        }  # fmt: skip
        assert {f"{item}.py" for item in own - MADE} <= set(sources), name


def test_a_baseline_does_not_depend_on_the_detector() -> None:
    pca = next(item for item in methods_for(Conditions()) if item.name == "pca")
    assert not any("detection/" in name or "detector" in name for name in sources_of(pca))
    assert "detection/detector" in USES["turnout_detector.py"]


def test_a_fault_of_a_method_is_raised_after_the_others_ran(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def run_piece(folder: Path, conditions: Conditions, name: str, data: str) -> dict[str, str]:
        if name == "boosting":
            message = "no trees"
            raise RuntimeError(message)
        return {"title": name}

    monkeypatch.setattr(run_methods, "_run_piece", run_piece)
    missing: Sequence[run_methods.Piece] = [
        (Conditions(), name) for name in ("boosting", "pca", "dtw")
    ]
    came = []

    def take() -> None:
        for piece, _ in run_methods._results(tmp_path, missing, {"markers": ""}, workers=1):
            came.append(piece[1])

    with pytest.raises(RuntimeError, match="no trees"):
        take()
    assert sorted(came) == ["dtw", "pca"]


def test_every_fold_holds_back_as_many_switches_of_each_kind() -> None:
    # 8 kinds of 3 panels, two switches of each panel, one throw of each switch
    machine = np.repeat([f"kind {number}" for number in range(8)], 6)
    panel = np.repeat(np.random.default_rng(0).permutation(24), 2)
    labels = {**bench().train.labels, "panel": panel, "machine": machine}
    found = folds_of(replace(bench().train, labels=labels))
    assert np.array_equal(found[::2], found[1::2])
    for name in np.unique(machine):
        assert sorted(found[machine == name]) == [0, 0, 1, 1, 2, 2]


def test_few_switches_have_fewer_components(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(turnout_detector, "window_features", lambda clean, _: clean)
    groups, rng = np.repeat(["a", "b", "c"], 20), np.random.default_rng(1)
    labels = {"role": np.full(60, "sound"), "level": rng.uniform(0.1, 0.4, 60)}
    clean = np.repeat(rng.standard_normal((3, 12)), 20, axis=0)
    side = SimpleNamespace(labels=labels, clean=clean, groups=groups)
    found = turnout_detector.switch_components(side, None, count=6)
    assert found.shape == (60, 2)
    np.testing.assert_allclose(found.std(axis=0), 1.0)
    one = SimpleNamespace(labels=labels, clean=clean, groups=np.full(60, "a"))
    assert turnout_detector.switch_components(one, None, count=6).shape == (60, 0)
