"""A panel of other numbers for known keys is the one that its whole document would give."""

import pickle
from types import SimpleNamespace
from typing import Any

import pytest

from turnout.core.errors import PanelError
from turnout.panel import check_rails, load
from turnout.panel.check import check
from turnout.panel.load import LoadedPanel, load_panel
from turnout.panel.same_keys import derive_panel
from turnout.panel.validate import ASKED_ALONE, validate_document

FIRST = {
    "chair.friction_coefficient": 0.2,
    "drive.1.stiffness": 8e5,
    "drive.2.saturation_force": 6e3,
    "drive.2.over_travel_closed": 3e-3,
    "rail.straight.section_scale": 0.97,
    "chair.7.friction_coefficient": 0.3,
}
SECOND = {key: 1.01 * value for key, value in FIRST.items()}


def whole(panel: LoadedPanel, changes: dict[str, float]) -> LoadedPanel:
    """Return a changed panel whose whole document was read."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(load, "derive_panel", lambda *given: None)
        return panel.with_overrides(changes)


def changed(panel: LoadedPanel, changes: dict[str, Any]) -> tuple[LoadedPanel, bool]:
    """Return a changed panel, and whether it was derived from one with the same keys."""
    made: list[Any] = []

    def noted(*given: Any) -> Any:
        made.append(derive_panel(*given))
        return made[-1]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(load, "derive_panel", noted)
        return panel.with_overrides(changes), made[0] is not None


def test_it_has_the_records_tables_and_overrides_of_its_whole_document() -> None:
    panel = load_panel("uic60-760-1-15").with_overrides({"drive.1.stiffness": 7e5})
    panel.with_overrides(FIRST)
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
    panel.with_overrides(FIRST)
    with pytest.raises(PanelError) as quick:
        panel.with_overrides(SECOND | wrong)
    with pytest.raises(PanelError) as thorough:
        whole(panel, SECOND | wrong)
    assert quick.value.problems == thorough.value.problems
    assert quick.value.problems


def test_texts_and_lists_are_read_as_ever() -> None:
    panel = load_panel("uic60-760-1-15")
    changes = {"drive.1.stiffness": "80 kN/m", "chair.5.friction_coefficient": 0.3}
    panel.with_overrides(changes)
    changes |= {"drive.1.stiffness": "81 kN/m"}
    made, quick = changed(panel, changes)
    assert not quick
    assert made.drive["1"].stiffness == 81e3


def test_only_the_checks_of_what_is_asked_for_alone_ask_for_it() -> None:
    """All others pass on records without these fields."""
    draft = validate_document(load_panel("uic60-760-1-15").document)
    for family, alone in ASKED_ALONE.items():
        draft.records[family] = {
            name: SimpleNamespace(**{k: v for k, v in dict(record).items() if k not in alone})
            for name, record in draft.records[family].items()
        }
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(check_rails, "_drive_saturated", lambda *given: iter(()))
        patch.setitem(check.__globals__, "slips_at_rest", lambda draft, known: iter(()))
        assert check(draft) == []
    with pytest.raises(AttributeError, match="stiffness"):
        check(draft)


def test_panels_that_differ_in_fields_that_do_not_matter_are_alike() -> None:
    panel = load_panel("uic60-760-1-15")
    panel.with_overrides(FIRST)
    second, third = panel.with_overrides(SECOND), panel.with_overrides(SECOND)
    fields = {tuple(name.split(".")[:: len(name.split(".")) - 1]) for name in FIRST}
    assert second.reference_panel(fields) is third.reference_panel(fields)
    assert second.reference_panel(fields).drive["1"].stiffness == FIRST["drive.1.stiffness"]
    assert second.reference_panel(fields - {("drive", "stiffness")}) is second
    assert panel.reference_panel(fields) is panel
    further = second.with_overrides({"gravity": 9.8})
    assert further.reference_panel(fields) is further
    copied = second.model_copy(update={"gravity": 9.8})
    assert copied.reference_panel(fields) is copied
    again = pickle.loads(pickle.dumps(second))
    assert again.reference_panel(fields) is again
    assert second.reference_panel(fields) is third.reference_panel(fields), "pickling changed it"


def test_panels_of_equal_values_are_equal_however_they_were_made() -> None:
    panel = load_panel("uic60-760-1-15")
    made = [panel.with_overrides({"chair.friction_coefficient": 0.3}) for _ in range(3)]
    assert made[0].hash == made[1].hash
    assert made[0] == made[1] == made[2] != panel
    assert made[0] != made[0].hash
