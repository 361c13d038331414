"""Causes of a misfit: each tested by one more parameter, the decisive one fitted."""

from dataclasses import replace

import numpy as np
import pytest
from tests.unit.test_calibration_fit import PARAMETERS, TRUE, misfit, movement, response

from turnout.calibration import cause_trials, causes
from turnout.calibration.candidate_causes import (
    GROUP,
    SOFTNESS,
    Cause,
    candidate_causes,
    soft_bushing,
)
from turnout.calibration.cause_trials import one_of_alike, own_levels, with_cause
from turnout.calibration.causes import (
    DECISIVE,
    CauseSearch,
    FittedChoice,
    _fitted_choices,
    _fitted_with,
    _gone_on,
    _rivals,
    cause_lines,
    is_needed,
    is_worth_a_search,
    with_causes,
    without_needless,
)
from turnout.calibration.comparison import predicted
from turnout.calibration.covariance import spread_of
from turnout.calibration.fit import Fit, brief_fit, fit
from turnout.calibration.measured_movements import MeasuredMovement
from turnout.calibration.misfit import Misfit
from turnout.calibration.result_entries import distrust_reasons
from turnout.calibration.sensors import common_lead
from turnout.calibration.stages import default_plan
from turnout.core.errors import SolverError
from turnout.measurement.chain.recorder import LowPass, Recorder
from turnout.panel.load import LoadedPanel, load_panel

AVERAGE = Recorder(average=0.3)
FILTER = Recorder(low_pass=LowPass(corner=1.5))


def of_order_4(kind: str) -> Recorder:
    return Recorder(low_pass=LowPass(kind=kind, order=4, corner=1.5))


def recorded(
    by: Recorder, *, stated: Recorder, late: float = 0.0, count: int = 3
) -> list[MeasuredMovement]:
    """Movements behind a recorder that the channel map states or not, begun late by so much [s]."""
    made = []
    for number in range(count):
        rng = np.random.default_rng(number)
        item = movement(f"m{number}", rng=rng)
        signal = item.signals[0]
        marked, seen = replace(item, clocked=True), replace(signal, recorder=by)
        clean = predicted(response(TRUE), marked, seen, np.arange(signal.time.size), shift=late)
        values = clean + 2.0 * rng.standard_normal(clean.size)
        kept = replace(signal, values=values, recorder=stated)
        made.append(replace(marked, signals=(kept,)))
    return made


def search_of(whole: Misfit) -> CauseSearch:
    """Search for causes where a rough fit ended."""
    near = fit(whole, PARAMETERS, TRUE, rough=True)
    return with_causes(brief_fit(whole, near), whole, load_panel("sb1"))


def averaged(*, stated: float = 0.0) -> list[MeasuredMovement]:
    """Movements of a recorder that averages over 0.3 s, which the map states or not."""
    return recorded(AVERAGE, stated=Recorder(average=stated))


def cause_of(panel: LoadedPanel, name: str) -> Cause:
    causes = candidate_causes(panel, default_plan(panel).parameters)
    return next(item for item in causes if item.name == name)


@pytest.mark.parametrize(
    ("by", "size", "remedy"),
    [
        (AVERAGE, pytest.approx(0.3, abs=0.02), 'recorded_average = "0.'),
        # The time constant of a corner at 1.5 Hz.
        (
            FILTER,
            pytest.approx(0.106, rel=0.05),
            'recorded_filter = { kind = "butterworth", order = 2, corner = "1.',
        ),
        # It was taken for a mean over the past, and values were 7 deviations off.
        (of_order_4("bessel"), None, 'kind = "bessel", order = 4, corner = "1.'),
        (of_order_4("butterworth"), None, 'kind = "butterworth", order = 4, corner = "1.'),
        (Recorder(rate=4.0), None, 'recorded_rate = "4'),
    ],
    ids=["average", "filter", "bessel", "butterworth", "rate"],
)
def test_what_a_recorder_does_is_found_and_the_remedy_named(
    by: Recorder, size: object, remedy: str
) -> None:
    count = 6 if by is AVERAGE else 3
    search = search_of(misfit(recorded(by, stated=Recorder(), count=count)))
    cause = search.tested[0]
    assert not search.misses
    assert (cause.name, cause.fitted) == ("recorder filter", True)
    assert cause.gain > (100.0 if by is AVERAGE else 20.0)
    assert size is None or cause.sizes[0] == size
    assert remedy in cause.text
    assert search.found.values["k"] == pytest.approx(TRUE["k"], rel=5e-3)


@pytest.mark.parametrize("by", [AVERAGE, Recorder(low_pass=LowPass(corner=3.0))])
def test_a_recorder_that_takes_many_samples_is_trusted(by: Recorder) -> None:
    """The interval between its samples is 0, where a fit begins: that is no bound."""
    search = search_of(misfit(recorded(by, stated=Recorder(), count=6)))
    found = search.found
    final = fit(search.first, found.parameters, found.values, near=found)
    assert any(name.endswith(".lines") for name in final.values)
    assert distrust_reasons(final, spread_of(final), ["recorder filter"]) == []


def test_the_rate_of_a_recorder_that_filters_is_unknown_too() -> None:
    # Without it the corner was found as 4.7 Hz, and a stiffness was 1 % off with nothing missed.
    # With samples 20 ms apart expected, as 5.7 Hz and 22 samples a second, with 0.2 %.
    by = Recorder(low_pass=LowPass(corner=6.0), rate=20.0)
    search = search_of(misfit(recorded(by, stated=Recorder(), count=6)))
    (cause,) = search.taken
    size, square = cause.sizes
    assert 1.0 / (2.0 * np.pi * size) == pytest.approx(6.0, rel=0.03)
    assert square**-0.5 == pytest.approx(20.0, rel=0.03)
    assert 'corner = "5.8' in cause.text
    assert cause.text.endswith(f'and recorded_rate = "{square**-0.5:.3g} Hz"')
    assert search.found.values["k"] == pytest.approx(TRUE["k"], rel=1e-3)


def test_a_first_fit_that_misses_something_takes_slopes_of_its_own(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    whole = misfit(averaged())
    near = fit(whole, PARAMETERS, TRUE, rough=True)
    found = brief_fit(whole, near)
    assert is_worth_a_search(found)
    begun: list[bool] = []

    def noted(_: Misfit, near: Fit, **__: object) -> Fit:
        begun.append(bool(near.local.stepped))
        return found

    def fails(*_: object, **__: object) -> None:
        message = "it slips at rest"
        raise SolverError(message)

    monkeypatch.setattr(causes, "brief_fit", noted)
    # A fit to its end is tried, and is none where it fails.
    monkeypatch.setattr(causes, "fit", fails)
    assert causes.first_fit(whole, near, found) is found
    assert begun == [False]
    monkeypatch.setattr(causes, "continued", lambda found, *_, **__: found)
    assert causes.first_fit(whole, near, found).local.stepped
    monkeypatch.setattr(causes, "is_worth_a_search", lambda *_, **__: False)
    assert causes.first_fit(whole, near, found) is found
    assert begun == [False]


@pytest.mark.parametrize("times", [0.5, 2.0])
def test_a_round_that_misses_more_is_not_gone_on_with(
    monkeypatch: pytest.MonkeyPatch, times: float
) -> None:
    whole = misfit(averaged())
    found = brief_fit(whole, fit(whole, PARAMETERS, TRUE, rough=True))
    comparison = found.misfit.comparison
    noise = {k: replace(n, missed=times * n.missed) for k, n in comparison.noise.items()}
    comparison = replace(comparison, noise=noise, discrepancy={})
    again = replace(found, misfit=replace(found.misfit, comparison=comparison))
    monkeypatch.setattr(causes, "brief_fit", lambda *_, **__: again)
    assert causes.continued(found, whole, rounds=1) is (again if times < 1.0 else found)


def test_a_search_ends_after_its_throws_and_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("turnout.calibration.causes.MOST_THROWS", 1)
    whole = misfit(averaged())
    search = search_of(whole)
    assert search.misses
    assert search.taken == ()
    assert search.tested[0].name == "recorder filter"
    assert search.stopped >= len(whole.movements)
    *_, line = cause_lines(search.found, search)
    assert line.startswith(f"search: ended after {search.stopped} throws")


@pytest.mark.parametrize("by", [AVERAGE, FILTER], ids=["average", "filter"])
def test_what_the_map_states_is_no_cause(by: Recorder) -> None:
    whole = misfit(recorded(by, stated=by))
    found = fit(whole, PARAMETERS, TRUE)
    assert found.values["k"] == pytest.approx(TRUE["k"], rel=5e-3)
    assert with_causes(found, whole, load_panel("sb1")).tested == ()


def test_fits_in_turn_are_of_causes_that_are_not_alike() -> None:
    causes = candidate_causes(load_panel("sb1"), PARAMETERS)
    tried = [[cause_trials.TestedCause(cause=item, sizes=(), gain=1.0)] for item in causes]
    kept = [choice[0].cause for choice in one_of_alike(tried)]
    recorders = [item for item in causes if item.group == "recorder"]
    assert len(recorders) > 4
    assert [item for item in kept if item.group == "recorder"] == recorders[:1]
    assert [item for item in kept if not item.group] == [item for item in causes if not item.group]


def test_rails_that_differ_by_less_than_anybody_could_say_are_no_cause() -> None:
    """Gains that were off alone left 0.04 % for the rails, and intervals of 2 %."""
    sections = cause_of(load_panel("sb1"), "sections")
    start = sections.parameters[0].start
    assert sections.is_slight([1.0004 * start])
    assert not sections.is_slight([0.99 * start])


def test_a_mean_over_the_past_is_not_taken_for_samples_far_apart_and_a_lead_of_motors() -> None:
    # Samples far apart delay nothing: with them all movements begin half a mean later than marked.
    whole = misfit(recorded(Recorder(average=0.1), stated=Recorder()))
    near = fit(whole, PARAMETERS, TRUE, rough=True)
    before = brief_fit(whole, near)
    causes = candidate_causes(load_panel("sb1"), PARAMETERS)
    recorders = [item for item in causes if item.group == "recorder"]
    choices = cause_trials.cause_trials(before, recorders, most=1, decisive=DECISIVE)
    samples = next(item for item in choices if "samples" in item[0].text)
    fitted = _fitted_with(before, whole, samples)
    assert common_lead(fitted) == pytest.approx(0.05, abs=0.01)
    likeliest, *others = _fitted_choices(before, whole, [samples, *choices], lambda: False)
    assert common_lead(likeliest.found) == 0.0
    assert likeliest.choice[0].text.startswith("the recorder has a mean over")
    assert any(item.choice == samples for item in others)


def test_a_lead_of_the_motors_beside_samples_far_apart_stays() -> None:
    by = Recorder(rate=10.0)
    search = search_of(misfit(recorded(by, stated=Recorder(), late=0.05)))
    assert search.tested[0].text.startswith("the recorder has 10")
    assert common_lead(search.found) == pytest.approx(0.05, abs=0.005)
    assert search.found.values["k"] == pytest.approx(TRUE["k"], rel=5e-3)


def test_a_soft_bushing_has_its_stiffness_beyond_its_travel() -> None:
    panel = load_panel("sb1")
    made = soft_bushing(panel, "2", {}, travel=2e-3)
    table = panel.with_overrides(made).drive["2"]
    extension, force = (np.array(made[f"drive.2.{key}"]) for key in ("extension", "force"))
    np.testing.assert_allclose(extension, -extension[::-1])
    np.testing.assert_allclose(force, -force[::-1])
    slopes = np.diff(force) / np.diff(extension)
    assert slopes[2] == pytest.approx(np.exp(-SOFTNESS) * 810e3)
    assert slopes[3] == pytest.approx(810e3)
    assert slopes[4] == pytest.approx(1e4, rel=1e-3)
    assert table.force is not None
    assert soft_bushing(panel, "2", {}, travel=0.0) == {}


def test_a_fit_with_a_soft_bushing_begins_with_the_stretch_that_it_had() -> None:
    panel = load_panel("sb1")
    values = {item.name: item.start for item in default_plan(panel).parameters}
    cause = next(
        item
        for item in candidate_causes(panel, default_plan(panel).parameters)
        if item.drives == ("2",) and item.beside is not None
    )
    assert cause.beside is not None
    assert cause.law is not None
    sizes = (2e-3, SOFTNESS)
    beside = cause.beside(values, sizes)
    stiffness = values["drive.2.stiffness"]
    assert beside["drive.2.stiffness"] > 1.1 * stiffness
    named = {p.name: size for p, size in zip(cause.parameters, sizes, strict=True)}
    made = cause.law({**values, **beside, **named})
    force = 0.6 * values["drive.2.saturation_force"]
    stretch = np.interp(force, made["drive.2.force"], made["drive.2.extension"])
    assert stretch == pytest.approx(force / stiffness, rel=1e-6)


@pytest.mark.parametrize(("likely", "beside"), [(1.0, {}), (1.3, {"k": 1.3 * TRUE["k"]})])
def test_a_cause_is_tried_with_values_as_they_are_and_with_those_that_keep_forces(
    monkeypatch: pytest.MonkeyPatch, likely: float, beside: dict[str, float]
) -> None:
    found = fit(misfit([movement("m", rng=np.random.default_rng(0))]), PARAMETERS, TRUE, rough=True)
    found = replace(found, values=TRUE)
    made = next(c for c in candidate_causes(load_panel("sb1"), PARAMETERS) if c.beside is not None)
    cause = replace(made, beside=lambda values, _: {"k": 1.3 * values["k"]})
    monkeypatch.setattr(cause_trials, "_changed", lambda *some: some[2])
    monkeypatch.setattr(
        cause_trials, "_judged", lambda *some: abs(some[2]["k"] / TRUE["k"] - likely)
    )
    trial, least = cause_trials._tried(found, cause, found.misfit, [])
    assert least == pytest.approx(0.0, abs=1e-12)
    assert trial.beside == pytest.approx(beside)
    assert trial.sizes == (cause.tries[0], cause.parameters[1].start)


@pytest.mark.parametrize("stated", [0.0, 0.3])
def test_a_cause_that_the_end_does_not_need_is_left_out(stated: float) -> None:
    panel = load_panel("sb1")
    whole = misfit(averaged(stated=stated))
    cause = candidate_causes(panel, PARAMETERS)[0]
    assert cause.name == "recorder filter"
    first = with_cause(whole, cause)
    size, lines = cause.parameters
    values = {**TRUE, size.name: 0.3 - stated, lines.name: 0.0}
    final = fit(first, [*PARAMETERS, size], values)
    sizes = (0.3 - stated, 0.0)
    tested = cause_trials.TestedCause(cause=cause, sizes=sizes, gain=20.0, fitted=True)
    search = CauseSearch(found=final, first=first, plain=whole, taken=(tested,), misses=False)
    kept = without_needless(search, final)
    if stated:
        assert kept.taken == ()
        assert size.name not in kept.found.values
        assert kept.found.values["k"] == pytest.approx(TRUE["k"], rel=5e-3)
    else:
        assert kept is search


@pytest.mark.parametrize(("size", "without", "likely"), [(1e-3, 500.0, True), (0.1, 500.0, False)])
def test_fewer_causes_are_as_likely_where_the_others_are_trifles_or_explain_nothing(
    monkeypatch: pytest.MonkeyPatch, size: float, without: float, *, likely: bool
) -> None:
    whole = misfit([movement("m", rng=np.random.default_rng(0))])
    cause = candidate_causes(load_panel("sb1"), PARAMETERS)[0]
    found = fit(whole, PARAMETERS, TRUE, rough=True)
    its = replace(found, values={**found.values, cause.parameters[0].name: size})
    tested = cause_trials.TestedCause(cause=cause, sizes=(size,), gain=20.0)
    search = CauseSearch(found=its, first=whole, plain=whole, taken=(tested,), misses=False)
    fewer = replace(search, found=found, taken=())
    monkeypatch.setattr(causes, "evidence", lambda _, some: 100.0 if some else without)
    assert fewer.is_as_likely(found, search, its) == likely
    monkeypatch.setattr(causes, "evidence", lambda _, some: 100.0 + len(some))
    assert fewer.is_as_likely(found, search, its)


def test_every_cause_is_one_that_the_panel_can_be_thrown_with() -> None:
    panel = load_panel("sb1")
    parameters = default_plan(panel).parameters
    names = [item.name for item in candidate_causes(panel, parameters)]
    assert names.count("bushing shape") == 5
    assert names.count("clutch") == 2
    assert names.count("drive law") == 6
    assert {"recorder filter", "sections", "friction by chair"} < set(names)
    values = {item.name: item.start for item in parameters}
    for cause in candidate_causes(panel, parameters):
        for size in cause.tries:
            sizes = {item.name: size for item in cause.parameters}
            assert cause.text(list(sizes.values()))
            if cause.law is not None:
                panel.with_overrides(cause.law({**values, **sizes}))


def test_drives_that_go_elsewhere_when_open_are_a_cause_where_a_panel_has_them() -> None:
    """1 mm that no fit knows of moved a stiffness by 5 % on this panel."""
    panel = load_panel("uic60-760-1-15")
    cause = cause_of(panel, "over-travel")
    keys = [f"drive.{name}.over_travel_open" for name in panel.drive]
    assert [key for item in cause.parameters for key in item.keys] == keys
    reach = [drive.over_travel_open for drive in panel.drive.values()]
    assert cause.is_slight([size + 4e-5 for size in reach])
    assert not cause.is_slight([reach[0] + 1e-4, reach[1]])
    assert cause.text([reach[0] - 1e-3, reach[1] + 2e-4]) == (
        "drive 1 goes 1 mm less far beyond the open position and drive 2 goes 0.2 mm further "
        "beyond the open position than in the panel"
    )
    for key, size in zip(keys, cause.tries, strict=True):
        panel.with_overrides({key: size})
    # One that is fitted anyway is no cause, nor is it one of a panel without.
    free = default_plan(panel, free=keys[:1]).parameters
    names = [c.name for c in candidate_causes(panel, free)]
    sb1 = load_panel("sb1")
    names += [c.name for c in candidate_causes(sb1, default_plan(sb1).parameters)]
    assert "over-travel" not in names


def test_friction_by_chair_keeps_its_mean() -> None:
    cause = cause_of(load_panel("sb1"), "friction by chair")
    assert cause.law is not None
    # The last group is what the others differ from.
    shares = np.linspace(-1.0, 0.0, len(cause.parameters) + 1)
    names = [item.name for item in cause.parameters]
    sizes = {name: float(share) for name, share in zip(names, shares, strict=False)}
    made = cause.law({"chair.friction_coefficient": 0.4, **sizes})
    friction = np.array(list(made.values()), dtype=np.float64)
    assert friction.mean() == pytest.approx(0.4)
    assert np.ptp(friction) == pytest.approx(0.4)
    # Along the switch, from the toe to the heel.
    assert (np.diff(friction) >= 0).all()
    # Records of before have a size of the last one too: only differences count.
    before = {**{name: size + 0.2 for name, size in sizes.items()}, f"{GROUP}{len(shares)}": 0.2}
    again = cause.law({"chair.friction_coefficient": 0.4, **before})
    np.testing.assert_allclose(np.array(list(again.values()), dtype=np.float64), friction)


@pytest.fixture
def fitted_alone(monkeypatch: pytest.MonkeyPatch) -> tuple[Fit, dict[str, float], list[str]]:
    """A fit, the evidence for each choice by name, and those that were fitted."""
    found = fit(misfit([movement("m", rng=np.random.default_rng(0))]), PARAMETERS, TRUE, rough=True)
    left = {"": 100.0, "first": 60.0, "alike": 58.0, "better": 10.0, "after": 1.0}
    tried: list[str] = []

    def fitted(_: Fit, __: Misfit, choice: list[cause_trials.TestedCause]) -> Fit:
        tried.append(choice[0].name)
        moved = {**found.values, "k": found.values["k"] * (1.0 + 0.01 * len(tried))}
        return replace(found, message=choice[0].name, values=moved)

    monkeypatch.setattr(causes, "_fitted_with", fitted)
    monkeypatch.setattr(causes, "evidence", lambda fit, *_: left[fit.message])
    monkeypatch.setattr(causes, "is_worth_a_search", lambda fit, **_: left[fit.message] > 20.0)
    return replace(found, message=""), left, tried


def choices_of(*gains: float) -> list[list[cause_trials.TestedCause]]:
    return [
        [cause_trials.TestedCause(cause=Cause(name=n, text=str), sizes=(), gain=gain)]
        for n, gain in zip(("first", "alike", "better", "after"), gains, strict=False)
    ]


def test_of_several_choices_the_one_of_most_evidence_is_taken(
    fitted_alone: tuple[Fit, dict[str, float], list[str]],
) -> None:
    start, left, tried = fitted_alone

    def taken(*gains: float) -> list[str]:
        tried.clear()
        fitted = _fitted_choices(start, start.misfit, choices_of(*gains), lambda: False)
        return [item.choice[0].name for item in fitted]

    assert taken(50.0, 40.0) == ["alike", "first"]
    # None is fitted after one that leaves nothing to look for, unless it is as likely.
    assert taken(50.0, 40.0, 30.0, 20.0) == ["better", "alike", "first"]
    assert tried == ["first", "alike", "better"]
    assert taken(50.0, 40.0, 30.0, 29.0)[0] == "after"
    left |= {"first": 95.0, "alike": 99.0}
    assert taken(50.0, 40.0) == []


def test_a_choice_that_is_a_trifle_has_no_fit_with_a_lead(
    fitted_alone: tuple[Fit, dict[str, float], list[str]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its parameters were missed in the fit that went on: a KeyError of a place."""
    start, _, tried = fitted_alone

    def without_any(_: Fit, some: object, first: Misfit | None = None) -> float:
        assert first is None, some
        return 100.0

    monkeypatch.setattr(causes, "evidence", without_any)
    monkeypatch.setattr(Cause, "is_slight_in", lambda *_: True)
    assert _fitted_choices(start, start.misfit, choices_of(50.0), lambda: False) == []
    assert tried == ["first"]


@pytest.mark.parametrize("doubted", [False, True])
def test_those_alike_are_fitted_where_sizes_make_up_for_the_shape_of_another(
    fitted_alone: tuple[Fit, dict[str, float], list[str]], *, doubted: bool
) -> None:
    """6 Hz behind 20 samples a second was a mean over 73 ms, and three values were not held."""
    start, _, tried = fitted_alone
    choices = [
        [cause_trials.TestedCause(cause=replace(item, name=name), sizes=(), gain=gain)]
        for name, gain in (("better", 50.0), ("after", 10.0))
        for item in [Cause(name="", text=str, parameters=PARAMETERS[1:], group="alike")]
        for item in [replace(item, doubted=lambda _: doubted)]
    ]
    _fitted_choices(start, start.misfit, choices, lambda: False)
    assert tried == ["better", "after"][: 1 + doubted]
    recorders = candidate_causes(load_panel("sb1"), PARAMETERS)
    mean, *_ = (item for item in recorders if item.group == "recorder")
    assert [mean.doubted((0.1, square)) for square in (0.0, 0.04**2)] == [False, True]


def test_a_choice_that_explains_a_tenth_of_the_likeliest_is_not_fitted(
    fitted_alone: tuple[Fit, dict[str, float], list[str]],
) -> None:
    start, _, tried = fitted_alone
    _fitted_choices(start, start.misfit, choices_of(500.0, 51.0, 49.0), lambda: False)
    assert tried == ["first", "alike"]


def travels_of(*drives: str) -> list[list[cause_trials.TestedCause]]:
    """Causes of a group, each of some drives, that explain less and less."""
    pairs = zip(("first", "alike", "better", "after"), drives, strict=False)
    return [
        [
            cause_trials.TestedCause(
                cause=Cause(name=name, text=str, group="first travel", drives=tuple(own)),
                sizes=(),
                gain=50.0 - 10.0 * number,
            )
        ]
        for number, (name, own) in enumerate(pairs)
    ]


def test_bushings_of_other_drives_are_fitted_where_that_of_one_leaves_something(
    fitted_alone: tuple[Fit, dict[str, float], list[str]], monkeypatch: pytest.MonkeyPatch
) -> None:
    start, left, tried = fitted_alone
    monkeypatch.setattr(causes, "ATTEMPTS", 2)
    monkeypatch.setattr(causes, "_is_doubted", lambda *_: False)
    monkeypatch.setattr(causes, "missed_share", lambda fit: left[fit.message])
    fitted = _fitted_choices(start, start.misfit, travels_of("1", "2", "12"), lambda: False)
    assert fitted[0].choice[0].name == "better"
    assert tried == ["first", "alike", "better"]
    # One that leaves less than half of what was missed is not of too few drives.
    tried.clear()
    left["alike"] = 45.0
    _fitted_choices(start, start.misfit, travels_of("1", "2", "12"), lambda: False)
    assert tried == ["first", "alike"]


def test_of_causes_much_alike_each_comes_to_its_end_where_the_likeliest_is_doubted(
    fitted_alone: tuple[Fit, dict[str, float], list[str]], monkeypatch: pytest.MonkeyPatch
) -> None:
    start, left, _ = fitted_alone
    gone: list[str] = []

    def continued(found: Fit, first: Misfit, *, rounds: int) -> Fit:
        gone.append(found.message)
        return replace(found, message=f"{found.message} gone on")

    monkeypatch.setattr(causes, "continued", continued)
    monkeypatch.setattr(causes, "missed_share", lambda fit: left[fit.message])
    left |= {"": 130.0, "first": 58.0, "alike": 60.0}
    left |= {"first gone on": 40.0, "alike gone on": 15.0}
    choices = travels_of("1", "1")
    for doubted, order in ((False, ["first", "alike"]), (True, ["alike", "first"])):
        monkeypatch.setattr(causes, "_is_doubted", lambda *_, doubted=doubted: doubted)
        fitted = [
            FittedChoice(
                found=replace(start, message=choice[0].name),
                choice=choice,
                evidence=left[choice[0].name],
            )
            for choice in choices
        ]
        gone.clear()
        again = _gone_on(fitted, start, start.misfit, lambda: False)
        assert [item.choice[0].name for item in again] == order
        assert gone == ["first", "alike"][: 1 + doubted]
    # One that leaves most of what was missed lacks another cause.
    gone.clear()
    assert _gone_on(fitted, replace(start, message="first"), start.misfit, lambda: False) == fitted
    assert gone == []


def test_choices_that_are_alike_are_both_said_and_widen_the_intervals(
    fitted_alone: tuple[Fit, dict[str, float], list[str]],
) -> None:
    start, _, _ = fitted_alone
    fitted = _fitted_choices(start, start.misfit, choices_of(50.0, 40.0), lambda: False)
    (rival,) = _rivals(fitted)
    assert rival.odds == pytest.approx(np.exp(-1.0))
    assert rival.line.startswith("or first: ")
    assert "odds 1 to 2.7 beside what was fitted" in rival.line
    before, after = (spread_of(start, rivals=some).coordinate_covariance for some in ([], [rival]))
    # Both fits are one per cent of the stiffness apart.
    share = rival.odds / (1.0 + rival.odds)
    assert (after - before)[1, 1] == pytest.approx(share * 0.01**2, rel=0.05)


def test_a_rival_that_is_taken_up_later_is_none(
    fitted_alone: tuple[Fit, dict[str, float], list[str]], monkeypatch: pytest.MonkeyPatch
) -> None:
    start, left, _ = fitted_alone
    first, alike = choices_of(50.0, 40.0)
    rounds = iter([([first, alike], 60.0), ([first], 30.0), ([], 30.0)])

    def trials(*_: object, **__: object) -> list[list[cause_trials.TestedCause]]:
        choices, left["first"] = next(rounds)
        return choices

    monkeypatch.setattr(causes, "candidate_causes", lambda *_: ())
    monkeypatch.setattr(causes, "cause_trials", trials)
    monkeypatch.setattr(causes, "continued", lambda found, *_, **__: found)
    monkeypatch.setattr(causes, "explained_by", lambda *_: 0.0)
    monkeypatch.setattr(causes, "without", lambda search, *_: search)
    monkeypatch.setattr(causes.CauseSearch, "is_as_likely", lambda *_: False)
    monkeypatch.setattr(causes.CauseSearch, "ended", lambda search, _: search)
    search = causes.with_causes(start, start.misfit, load_panel("sb1"))
    assert [item.name for item in search.taken] == ["alike", "first"]
    assert search.rivals == ()


def test_movements_that_do_not_slip_keep_the_common_level() -> None:
    whole = misfit([movement("m", rng=np.random.default_rng(0))])
    found = fit(whole, PARAMETERS, TRUE)
    high = replace(found, values={**found.values, "drive.1.saturation_force": 20e3})
    assert own_levels(high, "1")["drive.1.saturation_force"] == (0.0,)
    level = float(np.abs(found.local.simulated[0].drive_force["1"]).max())
    lower = replace(found, values={**found.values, "drive.1.saturation_force": level})
    (share,) = own_levels(lower, "1")["drive.1.saturation_force"]
    assert share == pytest.approx(0.0, abs=2e-3)


@pytest.mark.parametrize(("shares", "scatters"), [((1e-3, -5e-4), False), ((0.05, -0.03), True)])
def test_a_slip_level_scatters_where_the_movements_that_know_it_say_so(
    shares: tuple[float, float], scatters: bool
) -> None:
    panel, name = load_panel("sb1"), "drive.1.saturation_force"
    whole = misfit(averaged(stated=0.3))
    final = fit(whole, PARAMETERS, TRUE)
    known = [
        replace(item, estimates={**item.estimates, name: (share, 2e-4)})
        for item, share in zip(final.frame.alignments, shares, strict=False)
    ]
    # The others say nothing of it, and keep what was expected.
    blind = [replace(item, estimates={name: (0.0, 0.05)}) for item in final.frame.alignments[2:]]
    comparison = replace(final.misfit.comparison, scatter={name: 0.05})
    seen = replace(
        final,
        misfit=replace(final.misfit, comparison=comparison),
        frame=replace(final.frame, alignments=(*known, *blind)),
    )
    cause = next(
        item
        for item in candidate_causes(panel, default_plan(panel).parameters)
        if name in item.scatter
    )
    assert is_needed(cause, seen) is scatters
