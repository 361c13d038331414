"""The open benchmark on throws of its own: machines, obvious objects, runs that are interrupted."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from benchmarks.detection import run_methods, switch_throws, turnout_detector
from benchmarks.detection.data import Benchmark
from benchmarks.detection.definition import Counts
from benchmarks.detection.make_throws import make_throws
from benchmarks.detection.method import Method, judged_of
from benchmarks.detection.run_methods import Conditions, methods_for, numbers_digest, run_method

from turnout.detection.detector import training

MACHINES = Counts(switches=8, machines=8, known=3, sound=7, objects=3, causes=1)
FEW = Counts(switches=6, machines=6, known=1, sound=2, objects=1, causes=1)
OBVIOUS = Counts(switches=9, machines=0, known=3, sound=10, objects=7, causes=0)
CONDITIONS = [
    Conditions(track="machines", channels=name, history=3) for name in ("force", "current", "power")
]


@pytest.fixture(scope="module")
def machines(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("machines") / "bench"
    make_throws(folder, MACHINES)
    return folder


@pytest.fixture(scope="module")
def few(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return throws that are recorded and judged, however well."""
    folder = tmp_path_factory.mktemp("few") / "bench"
    make_throws(folder, FEW)
    return folder


@pytest.fixture(scope="module")
def obvious(tmp_path_factory: pytest.TempPathFactory) -> Benchmark:
    """Return a benchmark all of whose objects are 25 mm or more."""
    folder = tmp_path_factory.mktemp("obvious") / "bench"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(switch_throws, "SMALLEST", 25e-3)
        patch.setattr(switch_throws, "KINDS", {"stone": 0.5, "metal": 0.5})
        make_throws(folder, OBVIOUS)
    return Conditions(history=3).open(folder)


def baseline(name: str) -> Method:
    return next(item for item in methods_for(Conditions()) if item.name == name)


BASELINES = [item.name for item in methods_for(Conditions()) if item.name != "turnout"]


@pytest.mark.long
@pytest.mark.parametrize("name", BASELINES)
def test_each_baseline_sees_an_obvious_object_at_its_best_place(
    name: str, obvious: Benchmark
) -> None:
    if name in ("isolation-forest", "boosting"):
        pytest.importorskip("sklearn")
    train, test = judged_of(obvious, "train"), judged_of(obvious, "test")
    size, place = test.side.labels["size"], test.side.labels["place"]
    assert size[size > 0.0].min() >= 25e-3
    shares = []
    for setting in baseline(name).settings:
        score = baseline(name).fit(train, setting).score(test)
        called = score > np.quantile(score[test.sound], 0.9)
        shares.append(max(float(called[place == at].mean()) for at in set(place[place != ""])))
    # some setting calls all of them at some place, and one in ten sound throws
    assert max(shares) == 1.0


@pytest.mark.parametrize(
    "conditions",
    [
        pytest.param(CONDITIONS[0], marks=pytest.mark.long),
        pytest.param(CONDITIONS[1], marks=pytest.mark.long),
        pytest.param(CONDITIONS[2], marks=pytest.mark.long),
    ],
    ids=lambda item: item.channels,
)
def test_machines_are_judged_by_force_current_and_power(
    conditions: Conditions, machines: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(training, "LEAST_SOUND", 30)  # so few throws are made here
    monkeypatch.setattr(turnout_detector, "LEAST_SOUND", 30)
    bench = conditions.open(machines)
    assert bench.signals == (f"{conditions.channels} 1", f"{conditions.channels} 2")
    role = bench.train.labels["role"]
    assert {"clutch", "adjustment", "loose rod", "dry chairs"} < set(role)
    assert "slow drive" in bench.test.labels["role"]
    assert set(bench.amplitude) == {"jea73", "s700k", "m70"}
    method = next(item for item in methods_for(conditions) if item.name == "turnout")
    assert len(method.settings) == 4
    result = run_method(method, bench, tmp_path, data="toy")
    score = result["score"]
    assert {"gap", "x", "size"} <= set(score)
    assert score["gap"]["sensor TKK1, sound"]["count"] == bench.test.judged.sum() - np.sum(
        bench.test.labels["role"] != "sound"
    ) + np.sum(bench.test.labels["role"] == "history")
    assert result["setting"] in [dict(item) for item in method.settings]


def test_what_machines_record_is_far_above_what_the_recorder_adds(few: Path) -> None:
    for conditions in CONDITIONS:
        bench = replace(conditions, history=1).open(few)
        clean = bench.train.clean
        assert np.isfinite(clean).all()
        assert (
            np.abs(clean).max()
            < 32_000 * {"force": 0.5, "current": 2e-3, "power": 0.25}[conditions.channels]
        )  # stored without being cut off
        error = bench.train.histories - clean
        scale = np.array([bench.amplitude[name] for name in bench.train.labels["machine"]])
        share = np.median((error / scale[:, :, np.newaxis]).std(axis=0), axis=-1)
        assert np.all((share > 0.04) & (share < 0.08))  # 5 %, and noise; not of the inrush


def test_an_interrupted_run_of_methods_goes_on_to_the_same_numbers(
    few: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    names = ("three-features", "pca")
    folders = [tmp_path / name for name in ("whole", "stopped")]
    for folder in folders:
        shutil.copytree(few, folder)
    wanted = [replace(CONDITIONS[0], history=1)]
    whole = run_methods.run_methods(folders[0], wanted, only=names)
    computed: list[tuple[int, int]] = []
    tune = run_methods.tune

    def stopped(method, train, folds, keep):  # type: ignore[no-untyped-def]
        def counted(fold, setting, scores):  # type: ignore[no-untyped-def]
            def once():  # type: ignore[no-untyped-def]
                if len(computed) == 17:  # in the second piece
                    raise KeyboardInterrupt
                computed.append((fold, setting))
                return scores()

            return keep(fold, setting, once)

        return tune(method, train, folds, counted)

    with monkeypatch.context() as patch:
        patch.setattr(run_methods, "tune", stopped)
        with pytest.raises(KeyboardInterrupt):
            run_methods.run_methods(folders[1], wanted, only=names)
    assert len(list(folders[1].glob("results/*/*.json"))) == 1
    assert len(list(folders[1].glob("results/*/tuning/*.npz"))) == 5
    before = len(computed)

    def again(method, train, folds, keep):  # type: ignore[no-untyped-def]
        def counted(fold, setting, scores):  # type: ignore[no-untyped-def]
            return keep(fold, setting, lambda: computed.append((fold, setting)) or scores())

        return tune(method, train, folds, counted)

    monkeypatch.setattr(run_methods, "tune", again)
    found = run_methods.run_methods(folders[1], wanted, only=names)
    assert len(computed) - before == 2 * 12 - 17  # what was kept is not computed again
    digests = [numbers_digest(folder, own) for folder, own in zip(folders, (whole, found),
                                                                  strict=True)]  # fmt: skip
    assert digests[0] == digests[1]
    # changed verdicts change the digest; what is damaged or gone is made again, in two processes
    path = folders[1] / "results" / wanted[0].name / "pca.csv"
    path.write_text(path.read_text() + "\n")
    assert numbers_digest(folders[1], found) != digests[0]
    path.with_suffix(".json").write_text("{")
    for other in path.parent.glob("three-features*"):
        other.unlink()
    repaired = run_methods.run_methods(folders[1], wanted, only=names, workers=2)
    assert numbers_digest(folders[1], repaired) == digests[0]
