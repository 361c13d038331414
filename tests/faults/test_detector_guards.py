"""What a detector does not know is not judged: recorded currents, other speeds, other starts."""

import json
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from tests.unit.detector_toy import RATE, TIME, toy_detector, toy_set, toy_throw
from typer.testing import CliRunner

from turnout.cli.main import app
from turnout.core.channels import SCHEMA_VERSION
from turnout.detection.detector.another_switch import misfit_remark
from turnout.detection.detector.detector import Detector
from turnout.detection.detector.recorded import Recorded
from turnout.detection.detector.throw_verdict import Verdict
from turnout.detection.detector.throws_of_dataset import throws_of_dataset
from turnout.figures.report.detection import detection_page
from turnout.measurement.campaign.find_throws import find_throws
from turnout.throw.store import save_response

NOT_VERIFIED = "not verified for recordings"
OBJECTS = "cannot judge objects"
MOVEMENTS = [
    {"name": "throw", "to": "open", "start": 0.2, "end": 3.4},
    {"name": "return", "to": "closed", "start": 4.4, "end": 7.8},
]
MAP = "".join(
    f'[drive_current.{drive}]\ncolumn = "current {drive}"\nkind = "scaled"\n' for drive in "12"
)


def currents() -> np.ndarray:
    """Return what two motors draw in a throw: an inrush, then 2 A, and nothing at rest."""
    found = []
    for late in (0.0, 0.1):
        row = np.zeros(TIME.size)
        for begin, end in ((0.26, 3.4), (4.46, 7.8)):
            since, lasts = TIME - begin, end + late - begin
            on = (since > 0.0) & (since < lasts)
            row[on] = 2.0 + 6.0 * np.exp(-20.0 * since[on])
        found.append(row)
    return np.array(found)


def dataset(channel: str = "drive_current", **attributes: str) -> xr.Dataset:
    return xr.Dataset(
        {channel: (("drive", "time"), currents())},
        {"time": TIME, "drive": ["1", "2"]},
        {"schema_version": SCHEMA_VERSION, **attributes},
    )


@pytest.fixture(scope="module")
def of_currents(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a detector that takes the forces of the toy for currents."""
    known = toy_detector().knowledge
    path = tmp_path_factory.mktemp("currents") / "currents.detector"
    Detector(replace(known, setting=replace(known.setting, quantity="current"))).save(path)
    return path


def recording(folder: Path, case: str) -> list[str]:
    """Write a recording of currents, and return how the command is given it."""
    path = folder / ("throws.nc" if case in ("measured", "stripped") else "throws.csv")
    if case == "map":
        (folder / "map.toml").write_text(f"schema_version = 1\n{MAP}")
        np.savetxt(path, np.column_stack([TIME, *currents()]), delimiter=",", fmt="%.4f",
                   header="time [s],current 1 [A],current 2 [A]", comments="")  # fmt: skip
        return [str(path), "--channels", str(folder / "map.toml")]
    if path.suffix == ".nc":
        known = {"kind": "measurement", "movements": json.dumps(MOVEMENTS)}
        save_response(dataset(**(known if case == "measured" else {})), path)
        return [str(path)]
    cells = ",".join(" ".join(f"{value:.3f}" for value in row) for row in currents())
    start = {"no start": "", "start": "-4.4", "inrush": "-4.46"}[case]
    head = "throw,rate [Hz],start [s],current 1 [A],current 2 [A]"
    path.write_text(f"{head}\na,{RATE:g},{start},{cells}\n")
    return [str(path)]


@pytest.mark.parametrize("case", ["no start", "start", "inrush", "map", "measured", "stripped"])
def test_currents_of_recordings_are_not_judged(
    case: str, of_currents: Path, tmp_path: Path
) -> None:
    """Five of the six ended in an IndexError or a verdict; an object of 29 mm could be sound."""
    given = [str(of_currents), *recording(tmp_path, case)]
    found = CliRunner().invoke(app, ["detect", "run", *given, "--json"])
    assert found.exit_code == 0, found.exception
    record = json.loads(found.output)
    assert [(item["status"], item["reason"]) for item in record["verdicts"]] == [
        ("cannot judge", NOT_VERIFIED)
    ]
    shown = CliRunner().invoke(app, ["detect", "run", *given]).output
    assert f": cannot judge: {NOT_VERIFIED}\n" in shown
    assert "record again" not in shown
    out = str(tmp_path / "own.detector")
    learned = CliRunner().invoke(app, ["detect", "learn", *given, "-o", out])
    assert NOT_VERIFIED in str(learned.exception)
    assert CliRunner().invoke(app, ["detect", "run", *given, "--strict"]).exit_code == 1
    assert not misfit_remark(["cannot judge"] * 5, {"quantity": "current"})


def test_a_power_that_cannot_be_read_says_both(of_currents: Path) -> None:
    known = Detector.load(of_currents).knowledge
    power = Detector(replace(known, setting=replace(known.setting, quantity="power")))
    (verdict,) = power.predict(dataset())
    assert verdict.reason == f"{NOT_VERIFIED}; no drive powers are recorded"
    (verdict,) = power.predict(dataset("drive_power"))
    assert verdict.reason == NOT_VERIFIED


def test_onsets_of_a_simulation_are_those_of_its_commands() -> None:
    """Training counts from the command too; the inrush is 0.06 s later."""
    known = toy_detector().knowledge
    judge = Detector(replace(known, setting=replace(known.setting, quantity="current")))
    throw = toy_throw(seed=3, size=24e-3)
    simulated = xr.Dataset(
        {"drive_current": (("drive", "time"), throw.force)},
        {"time": TIME, "drive": ["1", "2"]},
        {"kind": "simulation", "movements": json.dumps(MOVEMENTS)},
    )
    (found,) = judge.predict(simulated)
    exact = judge.judge(replace(throw, exact=True))
    assert (found.status, found.log_ratio) == ("object", exact.log_ratio)
    assert judge.judge(throw).reason == NOT_VERIFIED
    twice = simulated.assign_attrs(movements=json.dumps([*MOVEMENTS, *MOVEMENTS]))
    assert [item.name for item in judge.predict(twice)] == ["throw#1", "throw#2"]


def test_onsets_of_a_sequence_are_those_of_each_throw() -> None:
    """A throw that waited for a machine begins its return later than the first one did."""
    waited = [{**item, "start": item["start"] + 0.5 * at} for at, item in enumerate(MOVEMENTS)]
    throw = toy_throw(seed=3)
    sequence = xr.Dataset(
        {
            "drive_current": (("throw", "drive", "time"), np.stack([throw.force] * 2)),
            "throw_movements": ("throw", [json.dumps(item) for item in (MOVEMENTS, waited)]),
        },
        {"time": TIME, "drive": ["1", "2"]},
        {"kind": "simulation", "movements": json.dumps(MOVEMENTS)},
    )
    first, second = throws_of_dataset(sequence, name="it", quantity="current")
    assert second.onsets["closing"] == first.onsets["closing"] + 0.5
    assert [item.exact for item in (first, second)] == [True, True]


def test_currents_alone_have_no_direction() -> None:
    """Without rod forces `find_throws` ended in an IndexError."""
    assert [item.direction for item in find_throws(dataset())] == ["unknown", "unknown"]


# ---- speed


def at_speed(throw: Recorded, slower: float) -> Recorded:
    """Return a throw whose movements take longer by a share."""
    time = throw.time.copy()
    for onset, end in ((0.2, 4.2), (4.4, np.inf)):
        moving = (time > onset) & (time < end)
        time[moving] = onset + (throw.time[moving] - onset) / (1.0 + slower)
    force = np.array([np.interp(time, throw.time, row) for row in throw.force])
    return replace(throw, force=force, exact=True)


@pytest.mark.parametrize("size", [0.0, 16e-3])
@pytest.mark.parametrize("slower", [-0.05, -0.03, 0.03, 0.05])
def test_a_switch_off_its_schedule_is_no_finding(slower: float, size: float) -> None:
    """It was 'other cause: other speed', with an object in it or without."""
    detector = toy_detector()
    for seed, level in enumerate((0.15, 0.45)):
        throw = toy_throw(level=level, seed=seed, size=size)
        verdict = detector.judge(at_speed(throw, slower))
        assert (verdict.status, verdict.cause, verdict.gaps) == (OBJECTS, "", ())
        way = "slower" if slower > 0.0 else "faster"
        words = verdict.reason.split()
        assert verdict.reason == f"the switch is {words[3]} % {way} than the detector knows"
        assert float(words[3]) == pytest.approx(100.0 * abs(slower), abs=1.0)
        assert verdict.lines()[0] == f"{throw.name}: {OBJECTS}: {verdict.reason}"
        assert "counts as not supervised" in verdict.lines()[-1]


def test_a_fault_within_a_drive_is_no_finding_about_objects() -> None:
    """Objects were thrown with drives that are not slow: nothing is known of both together."""
    known = toy_detector().knowledge
    renamed = tuple("in-drive" if name == "dry chairs" else name for name in known.causes)
    calibrated = tuple(
        replace(item, cause_thresholds={"in-drive": item.cause_thresholds["dry chairs"]})
        for item in known.calibrated
    )
    detector = Detector(replace(known, causes=renamed, calibrated=calibrated))
    slow = toy_set(4, seed=4, sound_seed=4, kind="dry chairs")
    for verdict in map(detector.judge_features, slow.features):
        assert (verdict.status, verdict.cause) == (OBJECTS, "")
        assert verdict.reason == "a drive is slower than the detector knows"
        assert max(verdict.odds, key=lambda name: verdict.odds[name]) == "in-drive"
        assert verdict.advice.startswith("check gear, bearings, brushes and cable")


def test_a_switch_on_its_schedule_is_judged_as_before() -> None:
    detector = toy_detector()
    throws = [at_speed(toy_throw(seed=3, size=size), 0.0) for size in (0.0, 24e-3)]
    assert [item.status for item in detector.predict(throws)] == ["sound", "object"]
    assert detector.judge(at_speed(toy_throw(seed=3), 0.3)).status != "sound"


# ---- start

PRELOAD = 2500.0


@cache
def preloaded() -> Detector:
    """Return a detector of the toy that starts as its last return left it, pressed home."""
    known = toy_detector().knowledge
    layout, mean = known.layout, known.model.mean.copy()
    rest = np.flatnonzero(layout.before_onset & (layout.part == 0))
    mean[:, rest] += PRELOAD
    return Detector(replace(known, model=replace(known.model, mean=mean)))


def starting(throw: Recorded, force: float) -> Recorded:
    """Return a throw with a force at its rods until it opens [N]."""
    held = throw.force + np.where(throw.time < 0.165, force, 0.0)
    return replace(throw, force=held, exact=True)


@pytest.mark.parametrize("size", [0.0, 24e-3])
@pytest.mark.parametrize("force", [0.0, 300.0, 1200.0, 4500.0])
def test_no_alarm_comes_from_a_start_that_is_not_known(force: float, size: float) -> None:
    """61 % of sound throws that began unloaded were called an object."""
    detector = preloaded()
    verdict = detector.judge(starting(toy_throw(seed=3, size=size), force))
    assert (verdict.status, verdict.cause, verdict.gaps, verdict.odds) == (OBJECTS, "", (), {})
    how = "unloaded, unlike" if force < 600.0 else "unlike"
    assert verdict.reason.startswith(
        f"the throw starts {how} all that the detector learned from: drive 1 at "
    )
    kilo = float(verdict.reason.partition("drive 1 at ")[2].split()[0])
    assert kilo == pytest.approx(1e-3 * force, abs=0.03)


def test_a_known_start_is_judged_as_before() -> None:
    detector = preloaded()
    throws = [starting(toy_throw(seed=3, size=size), PRELOAD) for size in (0.0, 24e-3)]
    assert [item.status for item in detector.predict(throws)] == ["sound", "object"]


def test_a_page_says_where_objects_were_not_judged() -> None:
    """Nothing may look like good news: 'Not called' in green."""
    lost = Verdict(name="a", status=OBJECTS, reason="the switch is 3.1 % slower")
    fields = {name: getattr(lost, name) for name in lost.__dataclass_fields__}
    findings = {item.question: item.answer for item in detection_page([fields], about={}).findings}
    assert findings["Is something trapped?"] == "Unknown"
    assert findings["Could every throw be judged?"] == "No"
