"""A virtual campaign is what a data acquisition system would have left, and can be gone on with."""

import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.unit.campaigns import PLAN, made
from tests.unit.recorded import FIELDS, clean, run
from tests.unit.simulated import sb1_panel, sb2_panel

from turnout.core.channels import schema_problems
from turnout.core.errors import FileError, PanelError
from turnout.core.scheme import Scheme
from turnout.measurement.campaign.run_sheet import read_sheet
from turnout.measurement.formats.file_format import WRITERS, read_recording
from turnout.study.virtual import series as virtual_series
from turnout.study.virtual.campaign_files import WrittenThrow, mistype
from turnout.study.virtual.campaign_plan import (
    CampaignPlan,
    Case,
    Defects,
    default_places,
    overrides_for,
    series_of,
    throw_generator,
    virtual_plan,
)
from turnout.study.virtual.disturbance import QUIET, Disturbance, Transducer, add_disturbance
from turnout.study.virtual.make_campaign import make_virtual_campaign
from turnout.study.virtual.record_throw import (
    CurrentLaw,
    assumed_current,
    finer_panel,
    finer_scheme,
    record_throw,
)
from turnout.throw.store import open_response


def test_the_default_is_the_published_campaign() -> None:
    plan = virtual_plan(sb2_panel())
    assert len(plan.places) == 13
    assert plan.places[0] == "drive 1"
    assert plan.places[-1] == "drive 2"
    assert len(plan.sizes) == 10
    assert len(series_of(plan, ("opening", "closing"))) == 14


def test_files_are_in_two_formats_and_say_what_they_are() -> None:
    folder = made()
    names = sorted(path.name for path in folder.iterdir() if path.is_file())
    assert "none_closing_1.csv" in names
    assert "sleeper-6_13mm_1.mat" in names
    assert len(names) == 12
    assert "not measured" in (folder / "none_closing_1.csv").read_text(encoding="utf-8")[:200]
    assert "not measured" in (folder / "channels.toml").read_text(encoding="utf-8")
    assert "not measured" in read_sheet(folder / "runs.csv").synthetic
    assert b"synthetic: simulated" in (folder / "sleeper-6_13mm_1.mat").read_bytes()[:116]
    channels = read_recording(folder / "sleeper-6_13mm_1.mat").channels
    assert all("not measured" in channel.description for channel in channels.values())
    assert "not measured" in open_response(folder / "truth.nc").attrs["synthetic"]


def test_recordings_hold_what_was_wired() -> None:
    recording = read_recording(made() / "sleeper-6_31mm_1.mat")
    rod, clamp = recording.channel("Rod 2"), recording.channel("Clamp 2")
    assert (rod.unit, clamp.unit) == ("mV/V", "V")
    # 6 kN are 0.373 mV/V by hand; 2 A are 0.2 V.
    assert rod.values[9000:9500].mean() == pytest.approx(0.373, rel=0.005)
    assert clamp.values[9000:9500].mean() == pytest.approx(0.2, rel=0.01)
    assert rod.rate == 1000.0
    assert rod.values.size == 12000


def test_the_truth_has_the_schema_and_the_cases() -> None:
    truth = open_response(made() / "truth.nc")
    assert schema_problems(truth) == []
    assert truth.attrs["kind"] == "simulation"
    details = json.loads(truth.attrs["movements_overrides"])
    friction = [item["overrides"]["chair.friction_coefficient"] for item in details]
    assert len(set(friction)) == 9
    assert np.std(friction) / 0.4 == pytest.approx(PLAN.friction_scatter, rel=0.7)
    assert truth["slipped"].values.tolist() == [False] * 8 + [True]


def test_chance_does_not_depend_on_the_order() -> None:
    one, two = (Case(name=n, direction="closing", size=0.0, place="none") for n in "ab")
    first = [throw_generator(PLAN, case).standard_normal() for case in (one, two)]
    second = [throw_generator(PLAN, case).standard_normal() for case in (two, one)]
    assert first == second[::-1]
    assert first[0] != first[1]
    assert throw_generator(CampaignPlan(places=("x",), seed=6), one).standard_normal() != first[0]


def test_a_campaign_that_stopped_comes_to_the_same_files(tmp_path: Path) -> None:
    """Free throws are in one format, those at a place in another."""
    plan = CampaignPlan(
        places=("sleeper 6", "sleeper 3"),
        sizes=(0.013,),
        object_free=1,
        formats=tuple(sorted(WRITERS)),
        seed=1,
    )
    whole, stopped = tmp_path / "whole", tmp_path / "stopped"
    make_virtual_campaign(sb2_panel(), whole, plan=plan)
    seen: list[int] = []

    def stop(done: int, total: int) -> None:
        seen.append(total)
        if done == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        make_virtual_campaign(sb2_panel(), stopped, plan=plan, report=stop)
    assert not (stopped / "runs.csv").exists()
    (first,) = stopped.glob("none_opening_1.*")
    kept = first.stat().st_mtime_ns
    make_virtual_campaign(sb2_panel(), stopped, plan=plan)
    assert first.stat().st_mtime_ns == kept
    names = {path.name for path in whole.glob("*_1.*")}
    assert {Path(name).suffix for name in names} == set(WRITERS)
    for name in (*names, "runs.csv", "channels.toml"):
        assert (whole / name).read_bytes() == (stopped / name).read_bytes()
    assert seen[0] == 4


def test_another_plan_is_not_mixed_in(tmp_path: Path) -> None:
    folder = tmp_path / "copy"
    shutil.copytree(made(), folder)
    other = CampaignPlan(places=("sleeper 6",), seed=PLAN.seed + 1)
    with pytest.raises(
        FileError, match="another virtual campaign .* or give what it was begun with"
    ):
        make_virtual_campaign(sb2_panel(), folder, plan=other)


def test_a_folder_with_something_else_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "letter.txt").write_text("dear", encoding="utf-8")
    with pytest.raises(FileError, match="is not empty"):
        make_virtual_campaign(sb2_panel(), tmp_path, plan=PLAN)
    with pytest.raises(FileError, match="is a file"):
        make_virtual_campaign(sb2_panel(), tmp_path / "letter.txt", plan=PLAN)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["letter.txt"]


def test_unknown_places_and_sizes_are_all_named(tmp_path: Path) -> None:
    plan = virtual_plan(sb2_panel(), places=["sleeper 6", "sleeper 66", "drive 9"])
    with pytest.raises(PanelError) as caught:
        make_virtual_campaign(sb2_panel(), tmp_path / "new", plan=plan)
    assert len(caught.value.problems) == 2
    assert not (tmp_path / "new").exists()
    with pytest.raises(FileError, match="(?s)--size 13:.*--size big:"):
        virtual_plan(sb2_panel(), sizes=["13", "big"])
    with pytest.raises(FileError, match=r"format '\.doc'"):
        virtual_plan(sb2_panel(), formats=["doc"])


def test_a_worn_clutch_slips_above_its_level_and_scatters() -> None:
    plan = virtual_plan(sb2_panel(), defects=["clutch"])
    levels = [
        overrides_for(plan, sb2_panel(), np.random.default_rng(seed))["drive.2.saturation_force"]
        for seed in range(400)
    ]
    assert np.mean(levels) == pytest.approx(6000.0 * 1.15, rel=0.01)
    assert np.std(levels) == pytest.approx(300.0, rel=0.15)


def test_a_defect_needs_its_drive(tmp_path: Path) -> None:
    plan = CampaignPlan(places=(), defects=Defects(drive="3", build_up_lag=0.1))
    with pytest.raises(FileError, match="no such drive"):
        make_virtual_campaign(sb2_panel(), tmp_path / "new", plan=plan)


def test_a_soft_build_up_is_slower_and_ends_the_same() -> None:
    true = clean(0.026)
    soft = record_throw(run(0.026), direction="closing", build_up_lag={"2": 0.25})
    contact = float(run(0.026)["contact_time"]) - 4.4 + 2.0
    before, after = slice(None, contact - 0.002), slice(contact + 0.3, contact + 0.4)
    two_true, two_soft = (d["drive_force"].sel(drive="2") for d in (true, soft))
    np.testing.assert_array_equal(two_true.sel(time=before), two_soft.sel(time=before))
    assert float((two_true - two_soft).sel(time=after).mean()) > 50.0
    assert float(two_soft[-1]) == pytest.approx(float(two_true[-1]), rel=1e-6)
    np.testing.assert_array_equal(
        true["drive_force"].sel(drive="1"), soft["drive_force"].sel(drive="1")
    )


def test_the_current_law_is_the_assumed_one() -> None:
    elapsed = np.array([-0.001, 0.0, 1.0, 1.0, 9.0])
    load = np.array([0.0, 0.0, 3000.0, -3000.0, 3000.0])
    current = assumed_current(load, elapsed, end=3.0, limit=6000.0, law=CurrentLaw())
    np.testing.assert_allclose(current, [0.0, 7.5, 1.4, 0.8, 0.0], atol=1e-6)
    fine = np.arange(0.0, 0.1, 1e-4)
    inrush = assumed_current(0.0 * fine, fine, end=3.0, limit=6000.0, law=CurrentLaw())
    assert 3.0 < inrush.mean() < 4.0


def test_each_disturbance_is_of_the_size_asked_for() -> None:
    true = clean(0.0)
    rng = np.random.default_rng(0)
    noisy = Disturbance(drive_force=Transducer(noise=4.0), cross_talk=0.0)
    added = add_disturbance(true, rng=rng, disturbance=noisy)["drive_force"] - true["drive_force"]
    assert float(added.std()) == pytest.approx(4.0, rel=0.02)
    stepped = Disturbance(drive_force=Transducer(step=10.0), cross_talk=0.0)
    seen = add_disturbance(true, rng=rng, disturbance=stepped)["drive_force"]
    np.testing.assert_allclose(seen / 10.0, np.round(seen / 10.0), atol=1e-9)
    crossed = Disturbance(
        drive_force=Transducer(),
        drive_current=Transducer(),
        object_force=Transducer(),
        cross_talk=0.01,
    )
    added = add_disturbance(true, rng=rng, disturbance=crossed)["drive_force"] - true["drive_force"]
    np.testing.assert_allclose(added[0], 0.01 * true["drive_force"][1], atol=1e-9)
    assert add_disturbance(true, rng=rng, disturbance=QUIET).equals(true)
    with pytest.raises(FileError, match="at least 0"):
        Transducer(noise=-1.0)


def test_mistakes_are_made_and_named() -> None:
    thrown = [thrown_line(name, size) for name, size in (("a_1", 0.013), ("b_1", 0.016))] + [
        thrown_line(f"c_{n}", 0.0) for n in range(6)
    ]
    lines, mistakes = mistype(thrown, count=4, rng=np.random.default_rng(2))
    assert len(mistakes) == 4
    assert [line.case.size for line in lines[:2]] == [0.016, 0.013]
    assert sum(one != two for one, two in zip(lines, thrown, strict=True)) == 5
    assert mistype(thrown, count=0, rng=np.random.default_rng(2)) == (thrown, [])


def thrown_line(name: str, size: float) -> WrittenThrow:
    place = "sleeper 6" if size else "none"
    case = Case(name=name, direction="closing", size=size, place=place)
    return WrittenThrow(case, f"{name}.csv", slipped=False)


def test_places_go_from_toe_to_heel() -> None:
    assert default_places(sb2_panel())[1:3] == ("sleeper 1", "sleeper 2")


def test_a_throw_that_the_solver_gives_up_ends_its_series(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    broken = run(0.0).assign_attrs(complete=False, outcome="stuck", outcome_message="gave up")
    monkeypatch.setattr(virtual_series, "simulate", lambda *_, **__: broken)
    plan = CampaignPlan(places=(), object_free=2)
    with pytest.raises(FileError, match="no throw came to an end: none_opening_1: gave up"):
        make_virtual_campaign(sb2_panel(), tmp_path / "new", plan=plan)
    assert set(FIELDS) | {"drive_current"} == set(virtual_series.FIELDS)  # of machines


def test_a_series_ends_with_a_slip_but_not_before_a_load_cell_fits() -> None:
    plan = CampaignPlan(places=("drive 2",))
    nothing: Any = None
    part = virtual_series.SeriesPart(nothing, True, {}, "")
    held = virtual_series.SeriesPart(nothing, False, {}, "")
    cases = [
        Case(name="x", direction="closing", size=size, place="drive 2") for size in (0.01, 0.013)
    ]
    assert [virtual_series.stops_series(part, case, plan) for case in cases] == [False, True]
    assert not virtual_series.stops_series(held, cases[1], plan)


def test_a_finer_truth_is_solved_otherwise() -> None:
    panel, scheme = finer_panel(sb2_panel()), finer_scheme()
    assert panel.discretisation.element_length == 0.5 * sb2_panel().discretisation.element_length
    assert (scheme.step, scheme.cutoff_frequency, scheme.output_interval) == (2.5e-4, 600.0, 1e-3)
    assert scheme.spectral_radius != Scheme().spectral_radius


def test_the_truth_takes_the_scheme_of_its_plan(tmp_path: Path) -> None:
    plan = replace(PLAN, places=(), object_free=1, friction_scatter=0.0, disturbance=QUIET)
    coarse = replace(plan, scheme=Scheme(step=4e-3, cutoff_frequency=100.0))
    forces = []
    for name, chosen in (("usual", plan), ("coarse", coarse)):
        make_virtual_campaign(sb1_panel(), tmp_path / name, plan=chosen)
        truth = open_response(tmp_path / name / "truth.nc")
        forces.append(truth["drive_force"].values)
    assert 0.1 < np.nanmax(np.abs(forces[0] - forces[1])) < 300.0
