"""The open benchmark: its definition, its recorder, its metrics, and the file of verdicts."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from benchmarks.detection.classical import (
    NUMBERS,
    Limits,
    LimitsMethod,
    closing_of,
    peak_and_build_up,
)
from benchmarks.detection.data import Recorder, Side, correlated, recorded
from benchmarks.detection.definition import (
    MACHINES,
    PRESETS,
    Counts,
    definition_digest,
    switches_of,
)
from benchmarks.detection.method import judged_of
from benchmarks.detection.metrics import clustered_rate, detectable, roc_curve, weighted_a90
from benchmarks.detection.minirocket import fit_minirocket
from benchmarks.detection.order import (
    margin_over,
    margins_from,
    mid_span_draws,
    order_changes,
    order_table,
)
from benchmarks.detection.run_methods import Conditions
from benchmarks.detection.switch_throws import (
    causes_of,
    fixed_state,
    holds_at_rest,
    shifts_of,
    study_of,
)
from benchmarks.detection.turnout_detector import less_offset, machine_offsets
from benchmarks.detection.verdicts import Verdicts, read_verdicts, write_verdicts
from scipy.stats import norm
from tests.unit.benchmark_toy import POSITIONS, TIME, toy_benchmark, toy_side

from turnout.core.errors import FileError, StudyError
from turnout.core.kept_results import claim_for
from turnout.detection.detector.allowances import Allowances
from turnout.detection.detector.training_plan import Population

# ---- definition


@pytest.mark.parametrize("name", PRESETS)
def test_no_panel_is_on_both_sides(name: str) -> None:
    sides: dict[str, set[int]] = {"train": set(), "test": set()}
    for switch in switches_of(PRESETS[name]):
        sides[switch.split].add(switch.panel)
    assert sides["train"]
    assert sides["test"]
    assert not sides["train"] & sides["test"]


def test_the_full_size_is_100000_throws() -> None:
    full = PRESETS["full"]
    sound_and_objects = full.known + full.sound + full.objects
    causes = sum(full.causes * len(causes_of(switch)) for switch in switches_of(full))
    assert 1.0e5 <= full.switches * sound_and_objects + causes < 1.02e5


def test_every_machine_is_on_both_sides_of_the_full_size() -> None:
    found = [switch for switch in switches_of(PRESETS["full"]) if switch.machines]
    assert len(found) == 40
    for side in ("train", "test"):
        assert {switch.machines for switch in found if switch.split == side} == set(MACHINES)


def test_a_switch_whose_drive_slips_at_rest_is_drawn_again() -> None:
    # case 36 holds its rail open with 7.43 kN, 3 N below the slip level of Drive 2
    number = next(s.number for s in switches_of(PRESETS["full"]) if s.panel == 36)
    switch = switches_of(PRESETS["full"])[number]
    study = study_of(switch)
    population = Population(study, seed=1)
    level, stiffness = "drive.2.saturation_force.factor", "drive.2.stiffness.factor"
    usual = population.row(0) | {stiffness: 1.0, "rail.fit_gap.value.factor": 1.0}
    assert holds_at_rest(population, usual | {level: 1.05})
    assert not holds_at_rest(population, usual | {level: 0.95})
    state = fixed_state(population, shifts_of(study))
    assert holds_at_rest(population, population.row(state))


def test_the_definition_is_frozen() -> None:
    # changes with the reference case, the default panel or the definition: raise VERSION then
    first = definition_digest(PRESETS["reduced"])
    assert first == definition_digest(PRESETS["reduced"])
    assert first != definition_digest(PRESETS["small"])


def test_counts_without_throws_are_refused_together() -> None:
    with pytest.raises(StudyError, match=r"(?s)switches = 1.*objects = 0.*machines = 2"):
        Counts(switches=1, machines=2, known=1, sound=1, objects=0, causes=0)


def test_a_folder_of_something_else_is_refused(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(FileError, match="is not empty and holds no benchmark"):
        claim_for(tmp_path, "head.json", {"digest": "one"}, what="benchmark")
    own = tmp_path / "own"
    for _ in range(2):
        claim_for(own, "head.json", {"digest": "one"}, what="benchmark")
    with pytest.raises(FileError, match="holds another benchmark"):
        claim_for(own, "head.json", {"digest": "other"}, what="benchmark")


# ---- recorder


def test_the_discrepancy_has_its_size_and_its_kernel() -> None:
    rng = np.random.default_rng(0)
    time = 0.02 * np.arange(200)
    found = correlated(rng.standard_normal((20_000, 200)), time, Allowances())
    assert found.std(axis=0) == pytest.approx(np.ones(200), abs=0.03)
    after = (found[:, 100] * found[:, 125]).mean()  # 0.5 s later
    assert after == pytest.approx(np.exp(-1.0), abs=0.03)


def test_half_of_the_discrepancy_is_fixed_for_a_switch() -> None:
    recorder = Recorder(
        signals=("force 1",), time=TIME, part=np.zeros(TIME.size, int),
        amplitude=np.array([1000.0]), rate=50.0,
    )  # fmt: skip
    errors = Allowances(discrepancy=0.1, gain=0.0, zero=0.0, timing=0.0, noise=20.0)
    means = []
    for switch in range(300):
        found = recorded(np.zeros((40, 1, TIME.size)), recorder, switch=switch, errors=errors)
        means.append(found[:, 0, 200].mean())
        if not switch:
            again = recorded(np.zeros((40, 1, TIME.size)), recorder, switch=0, errors=errors)
            assert np.array_equal(found, again)
    # variance of a mean of 40: half of 100 N squared, and what differs from throw to throw / 40
    wanted = np.sqrt(0.5e4 + (0.5e4 + 400.0) / 40.0)
    assert np.std(means) == pytest.approx(wanted, rel=0.15)


# ---- metrics on closed forms


def test_throws_that_are_all_alike_widen_the_interval_of_false_alarms() -> None:
    switches = np.repeat(np.arange(50), 20)
    alike = clustered_rate(switches < 5, switches)
    assert alike.value == 0.1
    # five of fifty switches: the binomial interval of switches, 0.033 to 0.218
    assert alike.high == pytest.approx(0.19, abs=0.03)
    apart = clustered_rate(np.arange(1000) % 10 == 0, switches)
    assert apart.high == pytest.approx(0.12, abs=0.005)


def test_a90_of_a_normal_curve_is_its_quantile() -> None:
    rng = np.random.default_rng(1)
    size = 30e-3 * rng.random(4000)
    hit = size + 2e-3 * rng.standard_normal(4000) > 12e-3
    found = detectable(size, hit, np.arange(4000) % 40)
    assert found.a90 == pytest.approx(12e-3 + 2e-3 * norm.isf(0.1), abs=0.2e-3)
    assert found.a90 < found.a90_95 < found.a90 + 0.5e-3


def test_a90_of_nothing_and_of_everything_and_of_a_step() -> None:
    size, groups = np.linspace(1e-3, 30e-3, 60), np.arange(60)
    assert detectable(size, np.zeros(60, bool), groups).a90 == np.inf
    assert detectable(size, np.ones(60, bool), groups).a90 == 1e-3
    # sizes are 0.5 mm apart: a step is known no better
    assert detectable(size, size > 10e-3, groups).a90 == pytest.approx(10e-3, abs=0.5e-3)


def test_the_curve_of_two_normals_has_the_area_of_the_distance_between_them() -> None:
    rng = np.random.default_rng(2)
    false, seen = roc_curve(rng.standard_normal(20_000), 1.5 + rng.standard_normal(20_000))
    order = np.argsort(false, kind="stable")
    area = np.trapezoid(seen[order], false[order])
    assert area == pytest.approx(norm.cdf(1.5 / np.sqrt(2.0)), abs=0.01)


# ---- margin


def test_many_weighted_curves_have_the_quantile_of_each() -> None:
    rng = np.random.default_rng(1)
    size = 30e-3 * rng.random(4000)
    first = size + 2e-3 * rng.standard_normal(4000) > 12e-3
    second = size + 3e-3 * rng.standard_normal(4000) > 15e-3
    weight = np.ones((4, 4000))
    weight[2] = 3.0  # as if each were there three times
    weight[3, ::2] = 0.0
    found = weighted_a90(size, np.array([first, second, second, second]), weight)
    wanted = [12e-3 + 2e-3 * norm.isf(0.1), 15e-3 + 3e-3 * norm.isf(0.1)]
    assert found[:2] == pytest.approx(wanted, abs=0.3e-3)
    assert found[2] == pytest.approx(found[1], abs=2e-6)
    groups = np.arange(4000)
    assert found[0] == pytest.approx(detectable(size, first, groups, grouped=False).a90, rel=2e-3)
    assert found[3] == pytest.approx(
        detectable(size[1::2], second[1::2], groups[1::2], grouped=False).a90, rel=2e-3
    )


def test_a_curve_without_hits_or_growth_has_no_size() -> None:
    size = np.linspace(1e-3, 30e-3, 60)
    hit = np.array([np.zeros(60, bool), size < 10e-3, size > 10e-3])
    found = weighted_a90(size, hit, np.ones((3, 60)))
    assert found[:2].tolist() == [np.inf, np.inf]
    assert found[2] == pytest.approx(10e-3, abs=0.5e-3)  # sizes are 0.5 mm apart


def margin_side(*, alike: bool, switches: int = 12) -> tuple[Side, dict[str, np.ndarray]]:
    """Return throws and scores: the first sees 12 mm, the other 15 mm, on single switches later."""
    side = toy_side(0, switches, sound=40, objects=60)
    side = side.of(side.judged)
    rng = np.random.default_rng(2)
    noise = 2e-3 * rng.standard_normal(len(side.throw))
    size = side.labels["size"] + noise
    worse = 3e-3 + (6e-3 * rng.standard_normal(switches)[side.groups] if alike else 0.0)
    return side, {"turnout": size, "other": size - worse * (side.labels["size"] > 0.0)}


def test_the_margin_covers_what_it_is_and_widens_where_switches_differ() -> None:
    found = {}
    for alike in (False, True):
        side, scores = margin_side(alike=alike)
        draws = mid_span_draws(side, scores, draws=200)
        found[alike] = margin_over(draws["turnout"], [draws["other"]])
        assert found[alike].low < found[alike].value < found[alike].high
    assert found[False].low < 3e-3 < found[False].high
    assert found[False].ahead == 1.0
    width = {alike: item.high - item.low for alike, item in found.items()}
    assert width[True] > 2.0 * width[False]


def test_the_best_of_two_baselines_is_chosen_in_every_draw() -> None:
    own = np.array([10.0, 10.0, 10.0])
    found = margin_over(own, [np.array([11.0, 14.0, np.inf]), np.array([12.0, 9.0, np.inf])])
    assert (found.value, found.low, found.high) == (1.0, -1.0, np.inf)
    never = margin_over(np.full(3, np.inf), [own])
    assert never.value == -np.inf


def test_who_is_first_is_said_in_a_table_and_in_words() -> None:
    conditions = [Conditions(), Conditions(discrepancy=0.1)]
    margins = {}
    for own, other in zip(conditions, (13e-3, 16e-3), strict=True):
        draws = {"turnout": np.full(9, 11e-3), "rocket": np.full(9, other)}
        margins[own.name] = margins_from(draws)
    margins[conditions[1].name]["best"]["value"] = -1e-3
    results = {own.name: {"rocket": {"title": "Rocket"}} for own in conditions}
    table = order_table(conditions, results, margins)
    assert "| markers | force | 20 | 5% | 11.0 (11.0 to 11.0) | 13.0 (13.0 to 13.0) |" in table
    said = order_changes(conditions, margins)
    assert said[0] == "markers-force-h20-d10: a baseline is first by 1.0 mm."
    assert "discrepancy of 8.3%" in said[1]  # 2 mm at 5 %, -1 mm at 10 %
    of_machines = Conditions(track="machines")
    lost = margins_from({"turnout": np.full(9, np.inf), "rocket": np.full(9, 13e-3)})
    lost["best"]["own"] = lost["best"]["value"] = None  # as files say it
    assert order_changes([of_machines], {of_machines.name: lost})[0].startswith(
        "machines-force-h20-d5: a baseline is first"
    )
    assert order_changes(conditions[:1], margins) == [
        "Under none of these conditions is a baseline first."
    ]


# ---- methods


def test_the_duration_is_that_until_the_force_builds_up() -> None:
    bench = toy_benchmark(train=2, test=1)
    closing = closing_of(bench.layout)
    steps = np.arange(closing.stop - closing.start)
    force = np.zeros((2, 1, closing.stop))
    for row, (at, rise) in enumerate(((120, 800.0), (135, 3000.0))):  # below and above 1 kN
        force[row, 0, closing] = 1500.0 + rise * (steps >= at)
    found = peak_and_build_up(force, closing)
    assert found[:, 0] == pytest.approx([2300.0, 4500.0])
    assert found[1, 1] - found[0, 1] == pytest.approx(15 * 0.02)


def test_a_number_that_is_mostly_the_same_does_not_take_the_limit() -> None:
    # of a duration that is the same in most throws the median deviation is 0
    train = judged_of(toy_benchmark(train=6, test=2), "train")
    for name in NUMBERS:
        method = LimitsMethod("threshold", "threshold", name)
        model = method.fit(train, {"relative": True, "largest": True})
        assert isinstance(model, Limits)
        values = model.values(train)[train.sound]
        assert model.spread == pytest.approx(np.maximum(values.std(axis=0), 1e-6))
        assert np.quantile(model.score(train)[train.sound], 0.999) < 12.0


def test_offsets_of_machines_leave_what_they_have_in_common() -> None:
    bench = toy_benchmark(train=6, test=2)
    machine = np.array(["first", "second"])[bench.train.groups % 2]
    kinds = {"first": 500.0, "second": -300.0}
    added = np.array([kinds[name] for name in machine])[:, np.newaxis, np.newaxis]
    clean = bench.train.histories + added
    side = replace(bench.train, clean=clean, labels={**bench.train.labels, "machine": machine})
    found = machine_offsets(side)
    assert found["first"].mean() - found["second"].mean() == pytest.approx(800.0, abs=300.0)
    judged = judged_of(replace(bench, train=replace(side, histories=clean)), "train")
    centred = less_offset(judged, found)
    assert abs(sum(item.mean() for item in found.values())) < 1e-6
    for name in found:
        rows = (centred.side.labels["machine"] == name) & centred.sound
        others = (centred.side.labels["machine"] != name) & centred.sound
        apart = centred.side.histories[rows].mean(0) - centred.side.histories[others].mean(0)
        assert np.abs(apart).mean() < 40.0  # 500 N and more apart before
    assert less_offset(judged, {}) is judged


# ---- MiniRocket


def test_a_feature_of_minirocket_is_the_share_above_its_bias() -> None:
    rng = np.random.default_rng(3)
    series = np.cumsum(rng.standard_normal((5, 2, 120)), axis=-1)
    rocket = fit_minirocket(series, features=840, seed=0)
    found = rocket.transform(series)
    # the last dilation, first kernel: weights 2 at places 0, 1 and 2
    number = len(rocket.dilations) - 1
    dilation, own = rocket.dilations[number], list(rocket.signals[number][0])
    bias = rocket.biases[number][0][0]
    at = sum(part.size for part in rocket.biases[:number])
    signal = np.zeros((5, 120 + 8 * dilation), dtype=np.float32)
    signal[:, 4 * dilation : 4 * dilation + 120] = series[:, own].sum(axis=1).astype(np.float32)
    weights = [2, 2, 2, -1, -1, -1, -1, -1, -1]
    whole = sum(w * signal[:, k * dilation : k * dilation + 120] for k, w in enumerate(weights))
    if number % 2:
        whole = whole[:, 4 * dilation : -4 * dilation]
    assert found[:, at] == pytest.approx((whole > bias).mean(axis=1), abs=1e-6)
    assert found.shape == (5, 840)


# ---- verdict files


def verdicts_of(throws: np.ndarray) -> Verdicts:
    count = len(throws)
    rng = np.random.default_rng(4)
    middle = rng.random((count, 1))
    return Verdicts(
        throw=throws, score=rng.random(count), alarm=rng.random(count) < 0.5,
        rare_alarm=rng.random(count) < 0.1, x=middle + [0.0, -0.1, 0.1],
        size=middle + [0.0, -0.1, 0.1], cause=np.full(count, "sound"),
        gap=(middle + [0.0, -0.1, 0.1])[:, np.newaxis, :].repeat(2, axis=1),
        probability=rng.random(count), novelty=rng.random(count),
    )  # fmt: skip


@pytest.mark.parametrize("name", ["said.csv", "said.parquet"])
def test_a_verdict_file_comes_back_in_the_order_of_the_throws(tmp_path: Path, name: str) -> None:
    if name.endswith("parquet"):
        pytest.importorskip("pyarrow")
    throws = np.arange(20, 40)
    given = verdicts_of(throws[::-1])
    write_verdicts(given, tmp_path / name, POSITIONS)
    found = read_verdicts(tmp_path / name, throws=throws, positions=POSITIONS)
    assert np.array_equal(found.throw, throws)
    assert found.score == pytest.approx(given.score[::-1])
    assert found.gap is not None
    assert given.gap is not None
    assert found.gap == pytest.approx(given.gap[::-1])


@pytest.mark.parametrize(
    ("name", "content", "parts"),
    [
        ("none.csv", None, ["there is no such file"]),
        ("no.parquet", "nothing", ["no.parquet: "]),
        ("columns.csv", "throw,score,alarms,x\n1,0.5,1,2.0\n", [
            'column "alarm" is missing', 'column "alarms" is unknown; nearest is ',
            '"x" needs all of x, x_low and x_high',
        ]),
        ("values.csv", "throw,score,alarm,probability\n1,inf,2,0.1\n1,,0,1.5\n9,0.1,0,0.2\n", [
            "1 throws judged twice: 1", "1 throws to be judged are missing: 2",
            "1 throws are none of those to be judged: 9", '"score" is empty in 1 rows',
            '"score" is infinite in 1 rows', '"alarm" must be 0 or 1',
            '"probability" must be from 0 to 1',
        ]),
    ],
)  # fmt: skip
def test_all_faults_of_a_verdict_file_are_said_at_once(
    tmp_path: Path, name: str, content: str | None, parts: list[str]
) -> None:
    if content is not None:
        (tmp_path / name).write_text(content)
    with pytest.raises(FileError) as fault:
        read_verdicts(tmp_path / name, throws=np.array([1, 2]), positions=POSITIONS)
    assert [part for part in parts if part not in str(fault.value)] == []


def test_the_history_of_a_switch_is_its_first_throws() -> None:
    bench = toy_benchmark(train=2, test=1)
    assert bench.train.known(3).sum() == 6
    assert not bench.train.known(3)[bench.train.judged].any()
