"""A table of numbers as throws: what keys change, and rows that cannot be thrown."""

import logging
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from tests.unit.sweeps import batch_names, here

from turnout.core.errors import MechanicsError, StudyError
from turnout.core.scheme import Scheme
from turnout.panel.load import LoadedPanel, load_panel
from turnout.study.sweep import row as sweep_row
from turnout.study.throw_table import CompiledThrows, compile_throws
from turnout.throw.simulate import simulate

FRICTION, SCALE = "chair.friction_coefficient", "rail.section_scale"
SHORT = {
    "schedule.end": 1.1,
    "movement.throw.start": 0.05,
    "movement.throw.duration": 0.3,
    "movement.return.start": 0.45,
    "movement.return.duration": 0.3,
}


@pytest.fixture(scope="module")
def panel() -> LoadedPanel:
    return load_panel("sb1").with_overrides(SHORT)


@pytest.fixture(scope="module")
def plan(panel: LoadedPanel) -> CompiledThrows:
    keys = [FRICTION, SCALE, "object.at", "object.size"]
    return compile_throws(panel, keys, channels=["drive_force"])


def test_a_row_is_a_throw_of_the_panel_with_its_values(
    panel: LoadedPanel, plan: CompiledThrows
) -> None:
    found = plan.run([[0.2, 1.0, "sleeper 6", 0.0], [0.3, 1.0, "drive 1", "3 mm"]], pool=here)
    assert found["outcome"].values.tolist() == ["complete"] * 2
    assert found.attrs["faults"] == []
    assert found["object.size"].values.tolist() == [0.0, 3e-3]
    alone = simulate(panel.with_overrides({FRICTION: 0.2}), scheme=Scheme.of("quick"))
    mine = found["drive_force"].isel(scenario=0)
    np.testing.assert_array_equal(mine, alone["drive_force"].values[:, ::2].astype(np.float32))


def test_what_a_key_changes_is_known_before_any_throw(panel: LoadedPanel) -> None:
    keys = [FRICTION, SCALE, "chair.x", "schedule.end", "object.x", "object.size", "label.cause"]
    effects = compile_throws(panel, [*keys, "temperature", "recorder.offset"]).effects
    assert effects["object.x"].places == ()
    assert effects[FRICTION].places[0] == "chair.1.friction_coefficient"
    assert len(effects[FRICTION].places) == len(panel.chair)
    assert {name: item.changes for name, item in effects.items()} == {
        FRICTION: "laws",
        SCALE: "rails in nominal shapes",
        "chair.x": "rails and their shapes",
        "schedule.end": "motion",
        "object.x": "object",
        "object.size": "object",
        "label.cause": "label",
        "temperature": "laws",
        "recorder.offset": "recorder",
    }


BAD = [
    [np.nan, 1.0, "drive 1", 0.0],
    [0.2, 9.0, "drive 1", 0.0],
    [0.2, 1.0, "drive 7", 3e-3],
    [0.2, 1.0, "drive 1", -3e-3],
    [0.2, 1.1, "drive 1", 0.0],
]
WORDS = [
    f"row 0: {FRICTION} = nan: must be a finite number",
    "row 1 ({FRICTION} = 0.2, rail.section_scale = 9, ",
    "there is no drive '7'",
    "row 3",
    "no factor for this rail",
]


def failing(real: object, *given: object, **named: object) -> object:
    """Reduce no rail whose section is scaled."""
    if given[0].rail["switch"].section_scale == 1.1:  # type: ignore[attr-defined]
        message = "no factor for this rail"
        raise MechanicsError(message)
    return real(*given, **named)  # type: ignore[operator]


def test_bad_rows_are_named_once_and_the_others_thrown(
    plan: CompiledThrows,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
    tmp_path: Path,
) -> None:
    monkeypatch.setattr(sweep_row, "plan_throw", partial(failing, sweep_row.plan_throw))
    table = pd.DataFrame([*BAD, [0.2, 1.0, "drive 1", 0.0]], columns=list(plan.variables))
    with caplog.at_level(logging.WARNING, logger="turnout"):
        found = plan.run(table, folder=tmp_path / "kept", pool=here)
    (said,) = [item.getMessage() for item in caplog.records if "gave no results" in item.message]
    assert "5 of 6 rows" in said
    faults = found.attrs["faults"]
    assert len(faults) == len(BAD)
    for text, words in zip(faults, WORDS, strict=True):
        assert words.replace("{FRICTION}", FRICTION) in text
        assert text in said
    assert found["outcome"].values.tolist() == ["invalid"] * 4 + ["failed", "complete"]
    peak = found["peak_force"].isel(drive=0, direction=0).values
    assert np.isfinite(peak).tolist() == [False] * 5 + [True]
    assert found["slipped"].values.tolist()[:5] == [-1] * 5
    names = batch_names(tmp_path / "kept")
    plan.run(table, folder=tmp_path / "kept", pool=here)  # nothing is thrown again
    assert batch_names(tmp_path / "kept") == names
    with pytest.raises(StudyError, match="(?s)row 0.*row 1") as caught:
        plan.run(BAD[:2], pool=here)
    assert len(caught.value.problems) == 2


def test_keys_and_columns_that_do_not_fit_are_refused(
    panel: LoadedPanel, plan: CompiledThrows
) -> None:
    with pytest.raises(StudyError) as caught:
        compile_throws(panel, ["chair.friction", "drive.9.stiffness", "object.size"], factors=["x"])
    for words in ("chair.friction", "drive.9.stiffness", "object.at", "x is none"):
        assert words in str(caught.value)
    with pytest.raises(StudyError, match=r"row 1 has not 4 values"):
        plan.run([BAD[0], [0.2]], pool=here)
    with pytest.raises(StudyError, match=r"has no column object\.size"):
        plan.run({FRICTION: [0.2], SCALE: [1.0], "object.at": ["drive 1"]}, pool=here)


def test_factors_multiply_what_the_panel_has(panel: LoadedPanel) -> None:
    plan = compile_throws(panel, {"softer": "drive.stiffness"}, factors=["softer"])
    (scenario,) = plan.study([[0.5]]).scenarios()
    assert scenario.overrides == {"drive.1.stiffness": 375e3, "drive.2.stiffness": 405e3}
