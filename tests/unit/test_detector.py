"""A detector on a switch of formulas: verdicts, history, files, commands."""

import json
import os
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.special import logsumexp
from tests.unit.detector_toy import toy_detector, toy_layout, toy_set, toy_setting, toy_throw
from typer.testing import CliRunner

from turnout.cli.main import app
from turnout.core.errors import FileError
from turnout.detection.alarm_threshold import threshold_for
from turnout.detection.detector import knowledge
from turnout.detection.detector.allowances import gain_times
from turnout.detection.detector.detector import Detector
from turnout.detection.detector.judging import (
    UNUSUAL,
    Ratios,
    evidence_of,
    make_view,
    ratios_of,
    support_of,
)
from turnout.detection.detector.knowledge import Knowledge
from turnout.detection.detector.throw_set import ThrowSet
from turnout.detection.detector.throw_verdict import named_cause
from turnout.detection.detector.training import teach
from turnout.detection.signal_discrepancy import SignalErrors


def fresh() -> Detector:
    return Detector(toy_detector().knowledge)


def test_sound_throws_are_sound_and_objects_are_called_where_they_are() -> None:
    detector = toy_detector()
    levels = np.linspace(0.12, 0.48, 6)
    sound = [toy_throw(level=level, seed=i) for i, level in enumerate(levels)]
    assert [item.status for item in detector.predict(sound)] == ["sound"] * len(sound)
    held = [toy_throw(level=level, seed=i, size=20e-3) for i, level in enumerate(levels)]
    found = detector.predict(held)
    assert [item.status for item in found] == ["object"] * len(held)
    assert all("sleeper 6" in item.places for item in found)
    sizes = np.array([item.size.middle for item in found if item.size is not None])
    assert np.median(np.abs(sizes - 20e-3)) < 2e-3
    scores = detector.score([*sound, *held], [False] * len(sound) + [True] * len(held))
    assert scores == {"false_alarms": 0.0, "detected": 1.0, "not_judged": 0.0}


@pytest.mark.parametrize("faster", [1.03, 1.01, 0.97])
def test_another_speed_of_the_drives_is_no_object(faster: float) -> None:
    """What comes earlier looks like an object near a drive, unless all of it comes earlier."""
    detector = toy_detector()
    levels = np.linspace(0.15, 0.45, 6)
    verdicts = []
    for number, level in enumerate(levels):
        own = toy_throw(level=float(level), seed=number)
        time = own.time.copy()
        for onset, end in ((0.2, 4.2), (4.4, np.inf)):
            moving = (time > onset) & (time < end)
            time[moving] = onset + (own.time[moving] - onset) * faster
        force = np.array([np.interp(time, own.time, row) for row in own.force])
        verdicts.append(detector.judge(replace(own, force=force, exact=True)))
    assert not any(item.alarm for item in verdicts)
    assert {item.cause for item in verdicts} <= {"", "other speed"}


def test_a_late_recorder_changes_nothing() -> None:
    """An onset that was found 20 ms off is found again."""
    detector = toy_detector()
    straight = detector.judge(toy_throw(seed=1))
    off = detector.judge(toy_throw(seed=1, shift=0.02))
    assert off.status == "sound"
    assert off.log_ratio == pytest.approx(straight.log_ratio, abs=1.5)
    assert off.friction == pytest.approx(straight.friction, abs=0.02)


def test_gaps_are_inferred_without_sensors() -> None:
    detector = toy_detector()
    sound = {gap.name: gap for gap in detector.judge(toy_throw(seed=2)).gaps}
    assert sound["sensor TKK1"].low < 6e-3 < sound["sensor TKK1"].high
    assert sound["sensor TKK1"].above < 0.01
    held = detector.judge(toy_throw(seed=2, size=28e-3))
    (gap,) = (item for item in held.gaps if item.name == "sensor TKK1")
    assert gap.middle == pytest.approx(6e-3 + 0.4 * 28e-3, abs=2e-3)
    assert held.in_control is False
    assert held.changes
    assert held.changes[0].force > 500.0


def test_history_tells_an_adjustment_and_sharpens() -> None:
    detector = fresh()
    rng = np.random.default_rng(6)
    throws = [toy_throw(level=rng.uniform(0.1, 0.5), over=(3.4, 4.5), seed=i) for i in range(20)]
    before = detector.judge(toy_throw(over=(3.4, 4.5), size=9e-3, seed=50))
    detector.learn(throws)
    assert detector.known.throws >= 19
    after = detector.judge(toy_throw(over=(3.4, 4.5), size=9e-3, seed=50))
    assert after.log_ratio > before.log_ratio
    moved = detector.judge(toy_throw(over=(4.4, 4.5), seed=51))
    assert not moved.alarm
    assert moved.odds["adjustment"] > moved.odds["object"]
    assert "adjustment" not in before.odds
    detector.clear_history()
    assert detector.known.throws == 0


def test_a_switch_that_scatters_is_not_full_of_unknown_deviations(tmp_path: Path) -> None:
    """Discrepancies of three times the assumed variance, drawn again in each throw."""
    detector = fresh()
    rng = np.random.default_rng(7)
    throws = [toy_throw(level=rng.uniform(0.15, 0.45), seed=i) for i in range(40)]
    alone = np.array([detector.features(item)[1] for item in throws])
    lower = np.linalg.cholesky(detector.knowledge.errors().changing)
    features = np.concatenate([alone, alone[20:], alone[20:]])
    features += np.sqrt(3.0) * rng.standard_normal(features.shape) @ lower.T
    detector.learn_features(features[:20])
    assert 2.0 < detector.known.scatter < 4.0
    detector.save(tmp_path / "own.detector")
    again = Detector.load(tmp_path / "own.detector")
    assert again.known.scatter == detector.known.scatter
    assert again.known.information == detector.known.information
    said = [again.judge_features(row).status for row in features[20:]]
    assert "object" not in said
    # One in a hundred on average: four in sixty are drawn once in three hundred sets.
    assert said.count("unknown deviation") <= 3
    strict = fresh()
    strict.known = replace(again.known, scatter=1.0)
    said = [strict.judge_features(row).status for row in features[20:]]
    assert said.count("unknown deviation") >= 57


def test_a_switch_at_the_limit_of_its_over_travel_is_no_object_without_a_history() -> None:
    """A normal model gives the ends of an even spread too little weight: an adjustment has it."""
    detector = toy_detector()
    view = detector.view()
    features = np.array(
        [detector.features(toy_throw(over=(5.0, 3.0), seed=seed))[1] for seed in range(40)]
    )
    evidence = evidence_of(view, features)
    weighed = ratios_of(view, evidence).alarm
    adjusted = view.kinds.index("adjustment") - view.objects
    others = np.delete(evidence.kind[view.objects :], adjusted, axis=0) + np.log(0.3)
    places = logsumexp(evidence.kind[: view.objects], axis=0) - np.log(view.objects)
    without = places - logsumexp(np.vstack([evidence.sound, others]), axis=0)
    assert np.all(weighed < without)
    assert not view.identifiable[adjusted]


def test_a_corner_that_the_sound_model_does_not_follow_is_no_object() -> None:
    """One sound throw in thirty presses late, as no polynomial does and a small object may."""

    def stepped(throws: ThrowSet) -> tuple[ThrowSet, np.ndarray]:
        corner = (throws.level < 0.2) & (throws.inputs[:, 0] > 4.5) & (throws.inputs[:, 1] > 4.4)
        late = np.clip((toy_layout().time - 7.0) / 0.4, 0.0, 1.0)
        features = throws.features + 900.0 * np.outer(corner, late)
        return replace(throws, features=features), corner

    sound, _ = stepped(toy_set(900))
    knowledge = teach({"sound": sound, "object": toy_set(500, kind="object")}, toy_setting())
    others, corner = stepped(toy_set(600, seed=8, sound_seed=8))
    assert 10 < corner.sum() < 40
    view = make_view(knowledge)
    evidence = evidence_of(view, others.features[corner])
    places = logsumexp(evidence.kind[: view.objects], axis=0) - np.log(view.objects)
    without = places - evidence.sound
    assert np.median(without) > 1.0
    weighed = ratios_of(view, evidence).alarm
    assert np.median(weighed) < 0.0
    unusual = view.kinds.index(UNUSUAL) - view.objects
    assert not view.identifiable[unusual]


def test_bad_recordings_are_not_judged_and_never_sound() -> None:
    detector = toy_detector()
    good = toy_throw()
    bad = [
        replace(good, force=np.minimum(good.force, 1500.0)),
        replace(good, force=np.full_like(good.force, np.nan)),
        replace(good, time=good.time[:700], force=good.force[:, :700]),
        replace(good, drives=("1", "3")),
        replace(good, onsets={}),
    ]
    for verdict in detector.predict(bad):
        assert verdict.status == "cannot judge"
        assert verdict.reason
        assert "cannot judge" in verdict.lines()[0]


def test_closing_alone_is_judged() -> None:
    detector = toy_detector()
    whole = toy_throw(size=25e-3)
    kept = whole.time > 3.6
    alone = replace(
        whole, time=whole.time[kept], force=whole.force[:, kept], onsets={"closing": 4.4}
    )
    verdict = detector.judge(alone)
    assert (verdict.part, verdict.status) == ("closing", "object")


def test_currents_are_judged_by_the_same_likelihood(tmp_path: Path) -> None:
    """A current in proportion to the force has the same ratios; the file keeps what it is."""
    ampere = 1.0 / 2500.0
    sets = {
        name: replace(
            toy_set(count, kind=name), features=item.features * ampere, rates=item.rates * ampere
        )
        for name, count in (("sound", 320), ("object", 120))
        for item in [toy_set(count, kind=name)]
    }
    forces = {"sound": toy_set(320), "object": toy_set(120, kind="object")}
    setting = toy_setting()
    allowed = replace(
        setting.allowances,
        current_noise=setting.allowances.noise * ampere,
        machine_discrepancy=0.0,
    )
    machines = SignalErrors(
        amplitude=np.zeros(2),
        force_peak=setting.amplitude,
        gain=np.full((2, len(gain_times(setting.layout))), ampere),
    )
    other = replace(
        setting,
        amplitude=setting.amplitude * ampere,
        allowances=allowed,
        quantity="current",
        machines=machines,
    )
    calibrated = toy_detector().knowledge.calibrated
    known = {
        "force": Detector(replace(teach(forces, setting), calibrated=calibrated)),
        "current": Detector(replace(teach(sets, other), calibrated=calibrated)),
    }
    throw = toy_throw(size=14e-3, seed=3)
    path = tmp_path / "currents.detector"
    known["current"].save(path)
    known["current"] = Detector.load(path)
    assert (known["current"].quantity, known["force"].quantity) == ("current", "force")
    assert known["current"].knowledge.setting.machines is not None
    one = known["force"].judge(replace(throw, exact=True))
    two = known["current"].judge(replace(throw, force=throw.force * ampere, exact=True))
    assert one.status == two.status == "object"
    # the assumed faults of sensors differ a little, and within the file numbers are rounded
    assert two.log_ratio == pytest.approx(one.log_ratio, abs=0.05)
    assert {item.unit for item in two.changes} == {"A"}
    assert " A, " in "\n".join(two.lines())


def test_where_a_machine_is_off_its_current_knows_no_error_of_the_force() -> None:
    """A gain of zero leaves the machine's own discrepancy, 2 % of its peak."""
    setting = toy_setting()
    time = gain_times(setting.layout)
    machines = SignalErrors(
        amplitude=np.array([2.0, 3.0]),
        force_peak=setting.amplitude,
        gain=np.where(time < 4.3, 1e-3, 0.0) * np.ones((2, 1)),
    )
    other = replace(setting, amplitude=machines.amplitude, quantity="current", machines=machines)
    nothing = np.zeros(setting.layout.size)
    found = other.errors(nothing, allowances=replace(setting.allowances, current_noise=1e-9))
    whole = np.diag(found.fixed + found.changing)
    off = setting.layout.time > 4.5
    peak = machines.amplitude[setting.layout.drive]
    short = 0.97  # of a kernel of 0.5 s over a window of 0.04 s
    assert whole[off] == pytest.approx((0.02 * peak[off]) ** 2 * short, rel=0.01)
    on = (setting.layout.time > 1.0) & (setting.layout.time < 3.5)
    through = (0.03 * 3000.0 * 1e-3) ** 2 + (0.02 * peak[on]) ** 2
    assert whole[on] == pytest.approx(through * 0.95, rel=0.01)


def test_a_file_keeps_detector_and_history(tmp_path: Path) -> None:
    detector = fresh()
    detector.learn([toy_throw(level=0.2 + 0.02 * i, seed=i) for i in range(4)])
    path = tmp_path / "switch.detector"
    detector.save(path)
    again = Detector.load(path)
    throw = toy_throw(size=12e-3, seed=30)
    one, other = detector.judge(throw), again.judge(throw)
    assert other.history == one.history > 0
    assert other.log_ratio == pytest.approx(one.log_ratio, abs=0.02)
    with zipfile.ZipFile(path) as packed:
        assert all(name.endswith(".npy") for name in packed.namelist())


def test_a_file_of_the_former_format_is_read_without_kinds_of_objects(tmp_path: Path) -> None:
    path = tmp_path / "former.detector"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(knowledge, "SCHEMA", 3)
        fresh().save(path)
    found = Detector.load(path)
    assert found.knowledge.object_kinds is None
    verdict = found.judge(toy_throw(size=20e-3))
    assert (verdict.status, verdict.kinds) == ("object", {})
    assert "kind" not in verdict.lines()[0]


@pytest.mark.parametrize("case", ["missing", "text", "flipped", "array", "older"])
def test_a_bad_file_is_one_message(tmp_path: Path, case: str) -> None:
    path = tmp_path / "switch.detector"
    if case == "text":
        path.write_text("no detector")
    elif case == "flipped":
        fresh().save(path)
        with np.load(path) as content:
            arrays = {name: content[name] for name in content.files}
        arrays["model.mean"] = arrays["model.mean"] + 1.0
        with path.open("wb") as file:
            np.savez(file, **arrays)
    elif case == "older":
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(knowledge, "SCHEMA", 2)
            fresh().save(path)
        with pytest.raises(FileError, match=r"format 2, this version reads 3 and 4; train"):
            Detector.load(path)
    elif case == "array":
        with path.open("wb") as file:
            np.savez(file, a=np.zeros(3))
    with pytest.raises(FileError, match=r"switch\.detector: .*(train|copy|writes)"):
        Detector.load(path)


def test_thresholds_are_quantiles_where_throws_suffice_and_follow_the_tail_beyond() -> None:
    """An exponential tail, and one of generalised Pareto with a shape of 0.2."""
    rng = np.random.default_rng(7)
    ratios = rng.exponential(2.0, 40_000) - 3.0
    assert threshold_for(ratios, rate=1e-3) == pytest.approx(-3.0 + 2.0 * np.log(1e3), abs=0.6)
    found = [threshold_for(rng.exponential(2.0, 40_000), rate=1e-6) for _ in range(9)]
    assert np.median(found) == pytest.approx(2.0 * np.log(1e6), rel=0.15)
    heavy = [threshold_for((rng.random(40_000) ** -0.2 - 1.0) / 0.2, rate=1e-5) for _ in range(9)]
    assert np.median(heavy) == pytest.approx((1e5**0.2 - 1.0) / 0.2, rel=0.2)


def test_a_detector_without_a_threshold_says_so() -> None:
    knowledge: Knowledge = replace(toy_detector().knowledge, calibrated=())
    with pytest.raises(Exception, match="no threshold"):
        Detector(knowledge).judge(toy_throw())


# ---- commands


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("detect")
    fresh().save(place / "switch.detector")
    lines = ["throw,rate [Hz],start [s],force 1 [N],force 2 [N]"]
    for seed, size in ((0, 0.0), (1, 0.0), (2, 24e-3)):
        rows = toy_throw(seed=seed, size=size).force
        cells = [" ".join(f"{value:.1f}" for value in row) for row in rows]
        lines.append(f"t{seed},125,-4.4,{cells[0]},{cells[1]}")
    (place / "throws.csv").write_text("\n".join(lines))
    return place


def test_run_judges_a_table(folder: Path) -> None:
    paths = [str(folder / "switch.detector"), str(folder / "throws.csv")]
    shown = CliRunner().invoke(app, ["detect", "run", *paths])
    assert shown.exit_code == 0, shown.output
    assert "t2: object" in shown.output
    assert "3 throws: 2 sound, 1 object" in shown.output
    found = CliRunner().invoke(app, ["detect", "run", *paths, "--json", "--strict"])
    assert found.exit_code == 1
    record = json.loads(found.output)
    assert [item["status"] for item in record["verdicts"]] == ["sound", "sound", "object"]
    assert record["units"]["size"] == "m"


def test_learn_watch_and_report(folder: Path, tmp_path: Path) -> None:
    detector, table = folder / "switch.detector", folder / "throws.csv"
    out = tmp_path / "own.detector"
    learned = CliRunner().invoke(
        app, ["detect", "learn", str(detector), str(table), "-o", str(out), "--json"]
    )
    assert learned.exit_code == 0, learned.output
    record = json.loads(learned.output)
    assert record["throws"] == 2
    assert record["scatter"] >= 1.0
    inbox = tmp_path / "in"
    inbox.mkdir()
    (inbox / "a.csv").write_text(table.read_text())
    (inbox / "b.csv").write_text("nothing of use")
    seen = CliRunner().invoke(app, ["detect", "watch", str(out), str(inbox), "--once"])
    assert seen.exit_code == 0, seen.output
    assert "t2: object" in seen.output
    assert "b.csv: cannot judge" in seen.output
    page = tmp_path / "page.html"
    (inbox / "c.csv").symlink_to(tmp_path / "moved away.csv")
    os.utime(inbox / "a.csv", (4e9, 4e9))
    dated = CliRunner().invoke(app, ["detect", "watch", str(out), str(inbox), "--once"])
    assert dated.exit_code == 0, dated.output
    assert "t2: object" in dated.output
    made = CliRunner().invoke(app, ["detect", "report", str(out), str(table), "-o", str(page)])
    assert made.exit_code == 0, made.output
    assert "Is something trapped?" in page.read_text()


def test_bad_input_is_one_message(folder: Path) -> None:
    paths = [str(folder / "switch.detector"), str(folder / "throws.csv")]
    refused = CliRunner().invoke(app, ["detect", "run", *paths, "--far", "0.5"])
    assert isinstance(refused.exception, FileError)
    assert "thresholds are known for" in str(refused.exception)


def test_throws_judged_together_get_the_verdicts_of_each_alone() -> None:
    """Good and bad recordings in any order; the order stays.

    Products of many throws and of one are summed in another order, in single precision (6e-8 of
    terms some hundred times the ratio).
    """
    detector = toy_detector()
    sound = [toy_throw(seed=61 + number) for number in range(3)]
    held = [toy_throw(seed=71 + number, size=20e-3) for number in range(3)]
    bad = replace(sound[0], force=np.full_like(sound[0].force, np.nan), name="bad")
    throws = [sound[0], bad, held[0], sound[1], held[1], held[2], sound[2]]
    together = detector.predict(throws)
    for one, throw in zip(together, throws, strict=True):
        alone = detector.judge(throw)
        assert (one.name, one.status) == (alone.name, alone.status)
        np.testing.assert_allclose(one.log_ratio, alone.log_ratio, rtol=1e-5)
        assert one.peaks == alone.peaks
    assert together[1].status == "cannot judge"


def test_dry_chairs_are_named_by_what_explains_them_and_by_what_is_left_irregular() -> None:
    """Each cause has its own limit; of those above it the one with most support is named."""
    detector = toy_detector()
    view = detector.view()
    rows = np.array([detector.features(toy_throw(seed=seed))[1] for seed in range(3)])
    ratios = ratios_of(view, evidence_of(view, rows))
    support = support_of(view, ratios, np.array([-2.0, 0.0, 6.0]))
    dry = view.kinds.index("dry chairs") - view.objects
    np.testing.assert_allclose(support[dry] - ratios.cause[dry], [0.0, 0.0, 3.0])
    others = np.delete(np.arange(len(support)), dry)
    np.testing.assert_array_equal(support[others], ratios.cause[others])
    limits = {name: 3.0 for name in view.kinds[view.objects :]} | {"dry chairs": 8.0}
    calibrated = replace(detector.knowledge.calibrated[0], cause_thresholds=limits)
    given = np.full((len(support), 1), -9.0)
    sensor = view.kinds.index("force sensor") - view.objects
    given[dry], given[sensor] = 7.0, 4.0

    def named(values: np.ndarray, irregular: float = 0.0, fit: float = 0.5) -> str:
        ratios = Ratios(alarm=values[0], place=values, cause=values, object=values[0])
        return named_cause(view, ratios, np.array([irregular]), fit, calibrated)

    assert named(given) == "force sensor"
    assert named(given, irregular=3.0) == "dry chairs"
    # more irregular than any sound throw: that speaks for nothing known
    assert named(given, irregular=300.0, fit=1e-5) == "force sensor"
    assert named(given, irregular=300.0, fit=1e-10) == ""
    given[dry], given[sensor] = -0.1, -9.0
    assert named(given, irregular=30.0) == ""


def test_causes_spikes_and_open_gaps_have_a_status_of_their_own() -> None:
    detector = toy_detector()
    dry = toy_set(6, seed=4, sound_seed=4, kind="dry chairs")
    said = [detector.judge_features(row) for row in dry.features]
    assert {item.status for item in said} == {"other cause"}
    assert {item.cause for item in said} == {"dry chairs"}
    assert "other cause: dry chairs" in said[0].lines()[0]
    assert said[0].advice == "grease the slide chairs"
    spikes = toy_set(1, seed=5, sound_seed=5).features[0]
    spikes[[40, 120, 200, 260]] += [900.0, -900.0, 900.0, -900.0]
    odd = detector.judge_features(spikes)
    assert (odd.status, odd.cause) == ("unknown deviation", "")
    far = [replace(item, gap_reach=(1e3, 0.0)) for item in detector.knowledge.calibrated]
    strict = Detector(replace(detector.knowledge, calibrated=tuple(far)))
    throw = strict.judge(toy_throw(seed=2))
    assert throw.status == "unknown deviation"
    assert "gap above its limit at sensor TKK1" in throw.lines()[0]
    assert throw.advice.startswith("check lock and end positions before trains pass")


def test_one_recording_without_a_threshold_does_not_end_the_others() -> None:
    detector = toy_detector()
    cycles = tuple(item for item in detector.knowledge.calibrated if item.part == "cycle")
    whole = toy_throw(seed=2)
    kept = whole.time > 3.6
    alone = replace(
        whole, time=whole.time[kept], force=whole.force[:, kept], onsets={"closing": 4.4}
    )
    first, second = Detector(replace(detector.knowledge, calibrated=cycles)).predict([alone, whole])
    assert (first.status, second.status) == ("cannot judge", "sound")
    assert "no threshold" in first.reason


def test_a_channel_that_is_held_cannot_be_judged() -> None:
    throw = toy_throw(seed=2)
    for since, until in ((6.5, 9.0), (2.0, 3.0)):
        force = throw.force.copy()
        held = (throw.time >= since) & (throw.time < until)
        force[1, held] = force[1, np.argmax(held)]
        verdict = toy_detector().judge(replace(throw, force=force))
        assert verdict.status == "cannot judge"
        assert "drive 2: constant for" in verdict.reason
    smooth = np.round(throw.force, -2)  # of a coarse recorder, which repeats values
    assert toy_detector().judge(replace(throw, force=smooth)).status != "cannot judge"
