"""A watched run gives the same forces and displacements as one whose instants are stored whole."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.unit.sweeps import variables_of

from turnout.calibration.load_study import load_study
from turnout.core.scheme import Scheme
from turnout.mechanism.mechanism import Mechanism
from turnout.panel.foreign_object import ForeignObject, resolve_objects
from turnout.panel.load import load_panel
from turnout.solver.integration import History
from turnout.solver.record import SaveAt
from turnout.study.study import Output
from turnout.study.sweep import row as sweep_row
from turnout.throw.simulate import solve_placed

QUICK = Scheme.of("quick")
ENDS = (1.0, 6.3333)


def thrown(*, laws: Sequence[int] = (), stride: int = 0) -> History:
    panel = load_panel("sb2")
    objects = resolve_objects(panel, (ForeignObject("13 mm", "x = 3.1 m"),))

    def save_at(mechanism: Mechanism) -> SaveAt:
        return SaveAt(list(laws), stride, ENDS)

    solved = solve_placed(panel, objects, scheme=QUICK, save_at=save_at if stride else None)
    return solved.history


def test_forces_and_whole_instants_are_those_of_the_whole_history() -> None:
    laws = [3, 0, 7]
    whole, few = thrown(), thrown(laws=laws, stride=3)
    assert few.watched is not None
    np.testing.assert_array_equal(few.watched.time, whole.time)
    np.testing.assert_array_equal(few.watched.inputs, whole.inputs)
    np.testing.assert_array_equal(few.watched.effort, whole.forces(laws).T)
    at = [*np.searchsorted(whole.time, np.array(ENDS) - 1e-9), whole.time.size - 1]
    for name in ("time", "inputs", "q", "g", "law_force", "friction_force", "stored", "ledger"):
        np.testing.assert_array_equal(getattr(few, name), getattr(whole, name)[at], err_msg=name)
    assert few.outcome.complete
    assert few.outcome.energy_residual <= whole.outcome.energy_residual


def test_no_scheme_with_instants_between_its_steps_is_watched() -> None:
    scheme = Scheme.of("quick", output_interval=0.005)
    panel = load_panel("sb1")
    history = solve_placed(panel, (), scheme=scheme, save_at=lambda mechanism: SaveAt([0])).history
    assert history.watched is None
    assert history.time[-1] == pytest.approx(panel.schedule.end)


@pytest.mark.parametrize("rate", [250.0, 125.0, 62.5])
def test_a_sweep_stores_the_same_of_a_watched_throw(
    rate: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With an end of the schedule that is no kept instant at the lower rates."""
    path = tmp_path / "study.toml"
    path.write_text(
        'schema_version = 1\nname = "few"\npanel = "sb2"\n[scheme]\nmode = "quick"\n'
        '[set]\n"schedule.end" = "8.412 s"\n[sampling]\ncount = 2\n'
        '[[variable]]\nkey = "chair.friction_coefficient"\ndistribution = "uniform"\n'
        "minimum = 0.1\nmaximum = 0.4\n"
        '[[variable]]\nkey = "object.size"\ndistribution = "uniform"\n'
        'minimum = "5 mm"\nmaximum = "20 mm"\n'
        '[[variable]]\nkey = "object.at"\ndistribution = "choice"\nvalues = ["x = 3.1 m"]\n',
        encoding="utf-8",
    )
    study = load_study(path)
    study = replace(study, output=Output(rate=rate, channels=study.output.channels))
    scenarios = [study.scenario(number) for number in range(2)]
    watched = sweep_row.throw_scenarios(study, scenarios)
    assert all(row.outcome == "complete" for row in watched)
    monkeypatch.setattr(sweep_row, "save_at_of", lambda study, panel: None)
    for mine, whole in zip(watched, sweep_row.throw_scenarios(study, scenarios), strict=True):
        assert variables_of(mine).keys() == variables_of(whole).keys()
        for name, (_, values) in variables_of(whole).items():
            found = variables_of(mine)[name][1]
            assert found.dtype == values.dtype
            if name in ("drive_gap", "sensor_gap", "end_gap"):
                np.testing.assert_allclose(found, values, rtol=1e-6, atol=1e-15, err_msg=name)
                np.testing.assert_allclose(found[..., -1], values[..., -1], rtol=1e-7)
            else:
                np.testing.assert_array_equal(found, values, err_msg=name)
