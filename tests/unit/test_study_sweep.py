"""A sweep from study to dataset: nothing lost, nothing doubled, the same bits in any order."""

import json
import shutil
from collections.abc import Callable, Generator, Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import xarray as xr
from tests.faults.terminal import run_code
from tests.unit.sweeps import batch_names, here, small_study, variables_of

from turnout.calibration.load_study import load_study
from turnout.core.errors import FileError
from turnout.core.json_files import sealed_json
from turnout.core.progress import Pace, Progress
from turnout.core.scheme import Scheme
from turnout.core.workers import Job, T, Workers
from turnout.metric.features import FEATURES, features
from turnout.panel.load import panel_from_document
from turnout.solver.outcome import Code, Outcome
from turnout.study.scenario import Output
from turnout.study.study import Study
from turnout.study.sweep import folder as sweep_folder
from turnout.study.sweep import row as sweep_row
from turnout.study.sweep.batch import batch_variables, throw_batch
from turnout.study.sweep.batch_bytes import file_bytes
from turnout.study.sweep.batch_index import label_arrays, read_index
from turnout.study.sweep.folder import lock_folder
from turnout.study.sweep.labels import object_labels
from turnout.study.sweep.read import open_batches, read_labels
from turnout.study.sweep.run import throw_studies, throw_study
from turnout.throw.simulate import PlannedThrow, Solved, simulate, solve_planned
from turnout.throw.slip import Span


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> Study:
    return small_study(tmp_path_factory.mktemp("study"))


@pytest.fixture(scope="module")
def whole(study: Study, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The sweep without any interruption; no test may change it."""
    folder = tmp_path_factory.mktemp("sweep") / "whole"
    assert throw_study(study, folder, pool=here).thrown == study.count
    return folder


def test_it_opens_as_one_dataset_and_reads_nothing_before_it_is_used(whole: Path) -> None:
    dataset = open_batches(whole)
    assert dataset["drive_force"].dims == ("scenario", "drive", "time")
    assert dataset["scenario"].values.tolist() == list(range(20))
    assert set(FEATURES) <= set(dataset)
    assert "chair.friction_coefficient" in dataset.coords
    assert not dataset["drive_force"].variable._in_memory
    np.testing.assert_allclose(np.diff(dataset["time"].values), 0.01, rtol=1e-9)
    assert dataset.attrs["complete"]
    assert not list(whole.glob("batches/.*"))


def test_values_are_those_of_a_single_throw(study: Study, whole: Path) -> None:
    dataset = open_batches(whole)
    for index in (0, 13):
        scenario = study.scenario(index)
        run = simulate(study.panel.with_overrides(dict(scenario.overrides)), scheme=study.scheme)
        mine = dataset.isel(scenario=index)
        for name in study.output.channels:
            alone = run[name].isel(time=slice(None, None, 10)).values.astype(np.float32)
            np.testing.assert_array_equal(mine[name].values, alone, err_msg=name)
        for name in ("force_margin", "contact_time", "least_flangeway"):
            np.testing.assert_array_equal(mine[name].values, run[name].values, err_msg=name)
        # The gaps of a watched throw are summed in another order.
        np.testing.assert_allclose(mine["end_gap"].values, run["end_gap"].values, rtol=1e-14)
        assert int(mine["end_locked"]) == int(run["locked"][-1])
        for name, found in features(run).items():
            np.testing.assert_array_equal(mine[str(name)].values, found.values, err_msg=str(name))
        stored = float(mine["chair.friction_coefficient"])
        assert stored == scenario.inputs["chair.friction_coefficient"]


def test_a_study_chooses_its_mode_and_a_rate_between_the_steps(tmp_path: Path) -> None:
    """Without a rate quick keeps every second step; another rate is filled in between them."""
    usual = small_study(tmp_path, more='[scheme]\nmode = "quick"\n')
    assert (usual.scheme, usual.output.rate) == (Scheme.of("quick"), pytest.approx(125.0))
    between = small_study(tmp_path, more='[scheme]\nmode = "quick"\n[output]\nrate = "100 Hz"\n')
    assert between.scheme.mode == "quick"
    (row,) = sweep_row.throw_scenarios(between, [between.scenario(0)])
    run = simulate(
        between.panel.with_overrides(dict(row.scenario.overrides)),
        scheme=Scheme.of("quick", output_interval=0.01),
    )
    for name in ("drive_force", "drive_gap"):
        np.testing.assert_allclose(
            variables_of(row)[name][1], run[name].values, rtol=1e-5, atol=1e-5
        )


LOOKS: tuple[Callable[[xr.Dataset], xr.DataArray], ...] = (
    lambda d: d["drive_force"].isel(scenario=[17, 2, 2], time=slice(5, None, 20)),
    lambda d: d["drive_force"].isel(scenario=-1, drive=1),
    lambda d: d["drive_gap"].isel(scenario=slice(3, 19, 5)).sel(drive="2", time=0.5),
    lambda d: d["outcome"].isel(scenario=slice(7, 9)),
    lambda d: d["peak_force"].sel(scenario=11, direction="closing"),
    lambda d: d["drive_force"].isel(scenario=np.arange(20) % 2 == 0),
)


def test_any_part_is_that_of_the_whole(whole: Path) -> None:
    loaded = open_batches(whole).load()
    for look in LOOKS:
        xr.testing.assert_identical(look(open_batches(whole)).load(), look(loaded))
    xr.testing.assert_identical(read_labels(whole), loaded.drop_dims("time"))


def test_what_is_missing_is_said_and_thrown_and_comes_to_the_same_bits(
    study: Study, whole: Path, tmp_path: Path
) -> None:
    reported: list[Progress] = []
    shutil.copytree(whole, tmp_path / "s")
    names = batch_names(whole)
    assert len(names) == 3
    (tmp_path / "s" / "batches" / names[1]).unlink()
    there = [*range(8), *range(16, 20)]
    part, full = open_batches(tmp_path / "s"), open_batches(whole)
    assert (full.attrs["missing"], part.attrs["missing"]) == (0, 8)
    assert part["scenario"].values.tolist() == there
    kept = full.isel(scenario=there).drop_attrs(deep=False).load()
    xr.testing.assert_identical(part.drop_attrs(deep=False).load(), kept)
    torn = tmp_path / "s" / "batches" / names[2]
    torn.write_bytes(torn.read_bytes()[:-200])
    half = tmp_path / "s" / "batches" / f".{names[1][:-3]}.ab_cd123.nc"
    half.write_bytes(b"half")
    again = throw_study(study, tmp_path / "s", pool=here, report=reported.append)
    assert again.thrown == 12
    assert again.damaged == (tmp_path / "s" / "damaged" / names[2],)
    assert batch_names(tmp_path / "s") == names
    assert not list((tmp_path / "s" / "batches").glob(".*"))
    assert (reported[0].done, reported[-1].done, reported[-1].total) == (8, 20, 20)
    assert reported[-1].left == 0.0
    assert throw_study(study, tmp_path / "s", pool=here).thrown == 0


@pytest.mark.parametrize(
    ("count", "panel", "words"),
    [
        (21, "sb1", r"holds the sweep 'tiny' \(20 scenarios.*another folder"),
        (20, "other", r"of panel sb1 \(20 scen.*, not 'tiny' of panel other \(20 scen"),
        (20, "sb1", r"\), which has other values; name another folder"),
    ],
    ids=["count", "panel", "values"],
)
def test_another_study_is_refused_and_nothing_is_touched(
    study: Study, whole: Path, tmp_path: Path, count: int, panel: str, words: str
) -> None:
    before = {p: p.stat().st_mtime_ns for p in whole.rglob("*")}
    known = study.panel
    named = panel_from_document(
        replace(known.document, tree={**known.document.tree, "name": panel}),
        source=known.source,
        folder=known.folder,
        overrides=known.overrides,
    )
    other = replace(small_study(tmp_path, count=count), panel=named, seed=study.seed + 1)
    with pytest.raises(FileError, match=words):
        throw_study(other, whole, pool=here)
    assert {p: p.stat().st_mtime_ns for p in whole.rglob("*")} == before


def test_another_version_is_refused(
    study: Study, whole: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sweep_folder, "version", lambda: "9.9")
    with pytest.raises(FileError, match=r"begun with turnout .* this is 9\.9"):
        throw_study(study, whole, pool=here)
    known = json.loads((whole / "sweep.json").read_text(encoding="utf-8"))
    known.pop("checksum")
    (tmp_path / "sweep.json").write_text(sealed_json(known | {"store_version": 99}))
    with pytest.raises(FileError, match="stored in form 99, this turnout has form 2"):
        open_batches(tmp_path)


def test_two_runs_do_not_write_to_one_folder(study: Study, tmp_path: Path) -> None:
    folder = tmp_path / "s"
    with lock_folder(folder), pytest.raises(FileError, match="another run writes to it now"):
        throw_study(study, folder, pool=here)


def test_a_failed_throw_is_made_again_with_half_the_step(
    study: Study, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Scenario 1 fails at the first step size, scenario 2 at any."""
    steps: list[float] = []
    friction = [study.scenario(index).inputs["chair.friction_coefficient"] for index in range(3)]

    def failing(planned: PlannedThrow) -> Solved:
        solved, step = solve_planned(planned), planned.run.scheme.step
        at = friction.index(planned.mechanism.laws.friction_coefficient[0])
        steps.append(step)
        if at == 0 or (at == 1 and step < study.scheme.step):
            return solved
        outcome = Outcome(Code.NOT_CONVERGED, 0.5, 500, 1e-3, ("chair 1",))
        return replace(solved, history=replace(solved.history, outcome=outcome))

    monkeypatch.setattr(sweep_row, "solve_planned", failing)
    rows = throw_batch(study, [[0], [1], [2]])
    assert steps == [1e-3, 1e-3, 5e-4, 1e-3, 5e-4]
    assert [row.outcome for row in rows] == ["complete", "complete", "failed"]
    assert [row.attempts for row in rows] == [1, 2, 2]
    assert "not converged at t = 0.5" in rows[2].reason
    stored = batch_variables(study, rows)
    assert np.isnan(stored["drive_force"].values[2]).all()
    assert stored["end_locked"].values[2] == -1
    assert file_bytes(batch_variables(study, rows[2:])), "a batch without any complete scenario"


def test_throws_that_differ_in_time_and_movement_are_looked_at_like_each_alone(
    tmp_path: Path,
) -> None:
    """Two with the same instants, one that ends later, one whose rail moves later."""
    changes: list[dict[str, Any]] = [
        {},
        {"chair.friction_coefficient": 0.3},
        {"schedule.end": 1.2},
        {"movement.return.start": 0.5},
    ]
    study = small_study(tmp_path, count=4)
    scenarios = [
        replace(study.scenario(number), overrides=changed) for number, changed in enumerate(changes)
    ]
    together = sweep_row.throw_scenarios(study, scenarios)
    assert len({variables_of(row)["drive_force"][1].tobytes() for row in together}) == len(changes)
    for row, scenario in zip(together, scenarios, strict=True):
        (alone,) = sweep_row.throw_scenarios(study, [scenario])
        assert variables_of(row).keys() == variables_of(alone).keys()
        for name, (dims, values) in variables_of(row).items():
            assert dims == variables_of(alone)[name][0]
            np.testing.assert_array_equal(values, variables_of(alone)[name][1], err_msg=name)


def test_long_throws_are_thrown_a_few_at_a_time(study: Study) -> None:
    def thrown(**changed: object) -> int:
        scenario = replace(study.scenario(0), overrides=changed)
        ready = [sweep_row.prepare_scenario(study, scenario)]
        return sweep_row.throws_at_once(study, ready)

    assert thrown() == sweep_row.AT_ONCE
    assert thrown(**{"schedule.end": 40.0}) == 3
    assert thrown(**{"schedule.end": 1000.0}) == 1
    quick = replace(study, scheme=Scheme.of("quick"))
    ready = [sweep_row.prepare_scenario(quick, quick.scenario(0))]
    assert sweep_row.throws_at_once(quick, ready) == sweep_row.AT_ONCE


def test_throws_are_planned_before_they_are_made(
    study: Study, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Those that cannot be thrown say why."""
    order: list[str] = []
    for name in ("plan_scenario", "throw_scenario"):
        made = getattr(sweep_row, name)

        def noted(*given: Any, made: Any = made, name: str = name) -> Any:
            order.append(name.partition("_")[0])
            return made(*given)

        monkeypatch.setattr(sweep_row, name, noted)
    monkeypatch.setattr(sweep_row, "AT_ONCE", 3)
    values = [0.2, 0.21, -1.0, 0.22]
    scenarios = [
        replace(study.scenario(0), overrides={"chair.friction_coefficient": value})
        for value in values
    ]
    rows = sweep_row.throw_scenarios(study, scenarios)
    assert order == ["plan"] * 3 + ["throw"] * 3 + ["plan", "throw"]
    assert [row.outcome for row in rows] == ["complete", "complete", "invalid", "complete"]
    assert "friction_coefficient" in rows[2].reason


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"output": replace(Output(), rate=300.0)}, "300 Hz.*divides 1000 Hz"),
        ({"rule": object()}, "study 'tiny': cannot be stored"),
    ],
    ids=["rate between the steps", "rule of no file"],
)
def test_a_wrong_study_is_refused_before_anything_is_made(
    study: Study, tmp_path: Path, changed: dict[str, Any], words: str
) -> None:
    with pytest.raises(FileError, match=words):
        throw_study(replace(study, **changed), tmp_path / "s", pool=here)
    assert not (tmp_path / "s").exists()


def test_the_rest_of_a_chain_is_left_out(study: Study) -> None:
    """Whatever the rule looks at: a chain ends with the first scenario that it stops at."""

    class AtSix:
        def stops(self, labels: dict[str, object]) -> bool:
            return labels["chair.friction_coefficient"] == inputs[1]

    inputs = [study.scenario(index).inputs["chair.friction_coefficient"] for index in range(6)]
    ruled = replace(study, rule=AtSix())  # type: ignore[arg-type]
    rows = throw_batch(ruled, [range(3), range(3, 6)])
    outcomes = [row.outcome for row in rows]
    assert outcomes == ["complete", "complete", "skipped", "complete", "complete", "complete"]
    assert "scenario 1" in rows[2].reason


def test_labels_that_are_not_requested_are_not_read(whole: Path) -> None:
    index = read_index(whole)
    every, some = label_arrays(index), label_arrays(index, names=("peak_force", "outcome"))
    assert set(some) == {"peak_force", "outcome", "chair.friction_coefficient"}
    assert set(some) < set(every)
    np.testing.assert_array_equal(some["peak_force"].values, every["peak_force"].values)


def test_a_batch_is_read_as_its_format_says(whole: Path) -> None:
    """What the variables are like is read without the layers that xarray reads a file with."""
    path = sorted(whole.glob("batches/*.nc"))[0]
    options = {"decode_times": False, "decode_timedelta": False, "mask_and_scale": False}
    with xr.open_dataset(path, engine="h5netcdf", **options) as plain:
        mine = open_batches(whole).isel(scenario=slice(plain.sizes["scenario"])).load()
        assert set(mine.variables) == set(plain.variables)
        assert set(mine.coords) == set(plain.coords)
        for name, variable in plain.variables.items():
            assert mine[name].variable.identical(variable.load()), name


def test_all_scenarios_of_a_condition_are_in_one_split(whole: Path) -> None:
    labels = read_labels(whole)
    split = dict(zip(labels["condition"].values, labels["split"].values, strict=True))
    assert [split[c] for c in labels["condition"].values] == labels["split"].values.tolist()
    assert {"train"} < set(split.values()) <= {"train", "validation", "test"}


def test_the_card_says_what_how_and_where_from(study: Study, whole: Path) -> None:
    text = (whole / "README.md").read_text(encoding="utf-8")
    for words in ("One rail, cut short", "Simulated, not measured", "seed 3", "never by row"):
        assert words in text
    least = f"{float(open_batches(whole)['chair.friction_coefficient'].min()):.6g}"
    assert f"| `chair.friction_coefficient` | 1 | {least} |" in text
    assert "| complete | 20 |" in text


@pytest.mark.parametrize(
    ("contact", "slips", "found"),
    [
        (np.nan, [(0.5, -9.0)], (False, True)),
        (np.nan, [(2.5, 9.0)], (True, True)),
        (2.2, [(2.5, 9.0)], (True, False)),
        (2.8, [(2.5, 9.0)], (True, True)),
        (2.2, [(2.5, -9.0)], (False, False)),
    ],
)
def test_slips_with_and_without_an_object(
    contact: float, slips: list[tuple[float, float]], found: tuple[bool, bool]
) -> None:
    """A drive at its limit against the movement still holds the force of the one before."""
    panel = load_study("sleeper-6").panel
    opening, closing = (movement.start for movement in panel.movement.values())
    time = np.linspace(0.0, panel.schedule.end, 400)
    force = np.zeros(time.size)
    for when, value in slips:
        at = opening + when if when < 1 else closing + when
        force[np.searchsorted(time, at)] = value
    later = contact if np.isnan(contact) else closing + contact
    spans = [Span("a", "open", opening, opening + 2.0), Span("b", "closed", closing, closing + 2.0)]
    together = SimpleNamespace(  # of three throws, the first and last without slips
        runs=[SimpleNamespace(spans=spans)],
        time=time,
        sizes=np.full(3, time.size),
        starts=np.tile([opening, closing], (3, 1)),
        instants=time.searchsorted,
        force=np.stack([0 * force, force, 0 * force])[:, np.newaxis],
        slipping=np.stack([0 * force, np.abs(force), 0 * force])[:, np.newaxis] >= 9.0,
        on_objects={"object_force": (("time",), np.zeros((3, time.size)))},
    )
    touched = np.array([2.0, later, 2.0])
    labels = object_labels(together, touched)  # type: ignore[arg-type]
    for name, expected in zip(("slipped", "slipped_free"), found, strict=True):
        assert labels[name][1].tolist() == [False, expected, False]


class WatchedWorkers(Workers):
    """Workers in this process that keep what is called while nothing comes."""

    waits: list[Callable[[], None] | None]

    def run(
        self, jobs: Sequence[Job[T]], *, wait: Callable[[], None] | None = None
    ) -> Generator[tuple[int, T], None, None]:
        self.waits.append(wait)
        yield from super().run(jobs)


def test_progress_goes_on_while_batches_and_cards_are_waited_for(tmp_path: Path) -> None:
    workers, pace = WatchedWorkers(0), Pace()
    workers.waits = []
    throw_studies({tmp_path / "sweep": small_study(tmp_path, count=2)}, workers=workers, pace=pace)
    assert workers.waits == [pace.emit, pace.emit]


def test_a_worker_loads_only_what_it_needs(study: Study, whole: Path) -> None:
    """Each worker waits for what it imports, so what only others need would cost every sweep."""
    script = f"""
import sys
from turnout.study.sweep.batch_bytes import file_bytes
from turnout.study.sweep.batch import batch_variables, throw_batch
from turnout.study.sweep.stored_study import load_stored_study
from turnout.study.sweep.worker import make_batch
from pathlib import Path
study = load_stored_study(Path({str(whole)!r}), {study.digest!r})
print(len(file_bytes(batch_variables(study, throw_batch(study, [[0]])))) > 1000)
unwanted = "xarray", "pandas", "dask", "scipy.stats", "scipy.special", "scipy.interpolate"
print(*[name for name in unwanted if name in sys.modules])
"""
    assert run_code(script).splitlines() == ["True", ""]
