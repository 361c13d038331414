"""A panel of other numbers for known keys is the one that its whole document would give."""

import pickle
from copy import deepcopy
from typing import Any

import numpy as np
import pytest

from turnout.core.errors import PanelError
from turnout.panel.check import reads_of_checks
from turnout.panel.compiled_keys import CompiledKeys
from turnout.panel.load import LoadedPanel, load_panel
from turnout.throw.simulate import marker_inputs

FIRST: dict[str, Any] = {
    "chair.friction_coefficient": 0.2,
    "drive.1.stiffness": 8e5,
    "drive.2.saturation_force": 6e3,
    "drive.2.over_travel_closed": 3e-3,
    "rail.straight.section_scale": 0.97,
    "chair.7.friction_coefficient": 0.3,
    "movement.return.extra_time.2": 0.15,
    "rail.fit_gap.value": [1e-3 * number for number in range(12)],
    "schedule.end": 9.0,
    "gravity": 9.8,
}
SECOND = {
    key: [1.01 * item for item in value] if isinstance(value, list) else 1.01 * value
    for key, value in FIRST.items()
}


def whole(panel: LoadedPanel, changes: dict[str, Any]) -> LoadedPanel:
    """Return a changed panel whose whole document was read."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(CompiledKeys, "derive", lambda *given: None)
        return panel.with_overrides(changes)


def changed(panel: LoadedPanel, changes: dict[str, Any]) -> tuple[LoadedPanel, bool]:
    """Return a changed panel, and whether it was derived by keys that were compiled."""
    made: list[Any] = []
    derive = CompiledKeys.derive

    def noted(*given: Any) -> Any:
        made.append(derive(*given))
        return made[-1]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(CompiledKeys, "derive", noted)
        return panel.with_overrides(changes), bool(made) and made[0] is not None


def test_it_has_the_records_tables_and_overrides_of_its_whole_document() -> None:
    panel = load_panel("uic60-760-1-15").with_overrides({"drive.1.stiffness": 7e5})
    (made, quick), expected = changed(panel, SECOND), whole(panel, SECOND)
    assert quick
    assert dict(made) == dict(expected)
    assert made.matrices == expected.matrices
    assert made.document == expected.document
    assert list(made.document.given) == list(expected.document.given)
    assert list(made.overrides.items()) == list(expected.overrides.items())
    assert made.hash == expected.hash
    assert dict(made.origins) == dict(expected.origins)
    again = made.with_overrides({"gravity": 9.8})
    assert again.hash == whole(expected, {"gravity": 9.8}).hash
    unpickled = pickle.loads(pickle.dumps(made))
    assert (unpickled, unpickled.document, unpickled.hash) == (made, made.document, made.hash)


@pytest.mark.parametrize(
    "wrong",
    [
        {"drive.1.stiffness": -1.0},
        {"drive.1.stiffness": float("nan")},
        {"drive.1.stiffness": 1.0},
        {"drive.2.over_travel_closed": -10.0},
        {"drive.2.over_travel_closed": 0.02},
        {"chair.friction_coefficient": -0.1, "chair.7.friction_coefficient": 40.0},
        {"rail.straight.section_scale": 0.0},
    ],
    ids=str,
)
def test_it_is_refused_for_the_same(wrong: dict[str, float]) -> None:
    panel = load_panel("uic60-760-1-15")
    with pytest.raises(PanelError) as quick:
        panel.with_overrides(SECOND | wrong)
    with pytest.raises(PanelError) as thorough:
        whole(panel, SECOND | wrong)
    assert quick.value.problems == thorough.value.problems
    assert quick.value.problems


def test_texts_are_read_with_the_whole_document() -> None:
    panel = load_panel("uic60-760-1-15")
    changes = {"drive.1.stiffness": "81 kN/m", "chair.5.friction_coefficient": 0.3}
    made, quick = changed(panel, changes)
    assert not quick
    assert made.drive["1"].stiffness == 81e3


@pytest.mark.parametrize(
    ("field", "tables"),
    [
        (("drive", "stiffness"), ["drive"]),
        (("chair", "friction_coefficient"), []),
        (("rail", "fit_gap"), ["drive", "lock", "rail", "stock_rail"]),
        (("rail", "matrices"), ["rail"]),
        (("movement", "start"), ["schedule"]),
        (("gravity", ""), []),
    ],
    ids=str,
)
def test_checks_that_read_a_field_are_found(field: tuple[str, str], tables: list[str]) -> None:
    """Also through what is derived from it, as `has_stock_rail` is from `fit_gap`."""
    panel = load_panel("uic60-760-1-15").with_overrides({"lock.rule": "raw gap"})
    found = [name for name, read in reads_of_checks(panel.__dict__).items() if field in read]
    assert sorted({name.partition(" ")[0] for name in found}) == tables


def test_a_machine_is_valid_as_a_whole() -> None:
    panel = load_panel("uic60-760-1-15").with_overrides({"drive.1.machine": "sb3"})
    key = "machine.sb3.motor.resistance"
    value = panel.values_at(key)[key]
    made, quick = changed(panel, {key: 1.1 * value})
    assert quick
    assert dict(made) == dict(whole(panel, {key: 1.1 * value}))
    for get in (changed, whole):
        with pytest.raises(PanelError, match="resistance"):
            get(panel, {key: -1.0})


def test_panels_that_differ_in_fields_that_do_not_matter_have_one_digest() -> None:
    panel = load_panel("uic60-760-1-15")
    second, third = panel.with_overrides(FIRST), panel.with_overrides(SECOND)
    fields = frozenset(
        {("chair", "friction_coefficient"), ("drive", "stiffness"), ("drive", "saturation_force")}
        | {("drive", "over_travel_closed"), ("rail", "section_scale"), ("rail", "fit_gap")}
        | {("movement", "extra_time"), ("schedule", ""), ("gravity", "")}
    )
    of_panel = panel.digest_without(fields)
    assert second.digest_without(fields) == third.digest_without(fields) == of_panel
    assert second.digest_without(fields - {("drive", "stiffness")}) != of_panel
    assert whole(panel, SECOND).digest_without(fields) == of_panel
    assert panel.with_overrides({"chair.damping": 7.0}).digest_without(fields) != of_panel
    for again in (pickle.loads(pickle.dumps(second)), deepcopy(second), deepcopy(panel)):
        assert again.digest_without(fields) == of_panel
    copied = second.model_copy(update={"instrumented_rail": "curved"})
    assert copied.digest_without(fields) != of_panel


def reordered(panel: LoadedPanel, family: str) -> LoadedPanel:
    members = dict(reversed(list(getattr(panel, family).items())))
    return panel.model_copy(update={family: members})


def test_results_of_the_movements_are_found_for_copies_of_a_panel() -> None:
    panel, instants = load_panel("sb1"), np.linspace(0.0, 1.0, 11)
    made = marker_inputs(panel, instants)
    softer = panel.with_overrides({"drive.stiffness": 6e5, "chair.friction_coefficient": 0.3})
    for same in (softer, deepcopy(panel), pickle.loads(pickle.dumps(panel)), load_panel("sb1")):
        assert same.digest_of("movement", "schedule") == panel.digest_of("movement", "schedule")
        assert np.shares_memory(marker_inputs(same, instants.copy()), made)
    assert panel.key_of("movement", "sensor") != reordered(panel, "movement").key_of(
        "movement", "sensor"
    )
    slower = panel.with_overrides({"movement.return.duration": 2.5})
    assert slower.digest_of("movement") != panel.digest_of("movement")
    assert slower.digest_of("schedule") == panel.digest_of("schedule")
    assert not np.shares_memory(marker_inputs(slower, instants), made)


def test_positions_behind_a_lock_are_those_of_the_rail_of_each_drive() -> None:
    half = {f"rail.{rail}.stress_free": 0.5 for rail in ("straight", "curved")}
    panel = load_panel("60e1-300-1-9-clamp-lock", overrides={**half, "drive.lost_motion": "20 mm"})
    crossed = panel.with_overrides({"drive.1.rail": "curved", "drive.2.rail": "straight"})
    instants = np.linspace(0.0, 2.0, 41)
    one, other = marker_inputs(panel, instants), marker_inputs(crossed, instants)
    assert np.abs(other - one).max() > 0.019


def test_a_copy_with_other_values_has_a_hash_of_its_own() -> None:
    panel = load_panel("sb1")
    known = panel.hash
    assert reordered(panel, "movement").hash == known
    assert panel.model_copy(update={"gravity": 9.0}).hash != known


def test_panels_of_equal_values_are_equal_however_they_were_made() -> None:
    panel = load_panel("uic60-760-1-15")
    made = [panel.with_overrides({"chair.friction_coefficient": 0.3}) for _ in range(3)]
    assert made[0].hash == made[1].hash
    assert made[0] == made[1] == made[2] != panel
    assert made[0] != made[0].hash
