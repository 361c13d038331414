"""What the jobs on verdicts and on a finer truth make and write; each runs whole with -m long."""

from pathlib import Path

import numpy as np
import pytest
from benchmarks.studies import finer_twin, validation_verdicts
from benchmarks.studies.resumable import Record
from benchmarks.studies.validation_verdicts import ACCEPTED, KINDS

from turnout.panel.load import load_panel


def verdict(index: int, *, accepted: bool, spreads: float) -> Record:
    channel = {"rms": 30.0, "nrmse": 0.01, "spread": 10.0, "spreads": spreads, "cover": 0.9}
    return {
        "index": index,
        "kind": KINDS[index % len(KINDS)],
        "failure": "",
        "accepted": accepted,
        "judged": 8,
        "used": 12,
        "cover": 0.93,
        "channels": {"drive 1": channel, "drive 2": {**channel, "spreads": 0.5}},
    }


def test_a_row_for_each_kind_of_switch() -> None:
    records = [verdict(n, accepted=n % 4 < 2, spreads=1.0 + n) for n in range(8)]
    text = "\n".join(validation_verdicts.section(records))
    assert "| as calibrated | 2 | 2 | 8 | 1.0 to 5.0 | 93 % | 1.0 % |" in text
    assert "| without links | 2 | 0 | 8 | 4.0 to 8.0 | 93 % | 1.0 % |" in text


def test_other_switches_are_what_they_are_called(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    known = load_panel(validation_verdicts.NAME)
    free = validation_verdicts.truth_of("free for 1 m more", tmp_path, rng)
    first = min(item.x for item in free.fastening.values())
    assert first == pytest.approx(min(item.x for item in known.fastening.values()) + 1.0)
    assert len(free.chair) == len(known.chair) + 2
    loose = validation_verdicts.truth_of("without links", tmp_path, rng)
    assert {item.stiffness for item in loose.link.values()} == {1e3}
    assert min(item.stiffness for item in known.link.values()) > 1e7


@pytest.mark.long
@pytest.mark.parametrize("index", range(len(KINDS)), ids=KINDS)
def test_the_right_switch_is_accepted_and_others_are_refused(
    index: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.argv", ["validation_verdicts", "run", "--out", str(tmp_path)])
    record = validation_verdicts.result_of(index)
    assert record["failure"] == ""
    assert record["accepted"] == (record["kind"] in ACCEPTED), record["text"]


@pytest.mark.long
def test_a_finer_twin_is_found_from_two_starts_within_one_per_cent(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.argv", ["finer_twin", "run", "--out", str(tmp_path)])
    records = [finer_twin.result_of(index) for index in range(len(finer_twin.STARTS))]
    for record in records:
        assert max(map(abs, record["errors"].values())) < finer_twin.LIMIT, record["errors"]
    assert "| `drive.2.stiffness` | 690000 |" in "\n".join(finer_twin.section(records))
