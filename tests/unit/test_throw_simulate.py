"""The chain from panel to dataset: what is kept, how runs end early, what is recorded."""

import json
import time
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from tests.unit.simulated import OBJECT, sb1_dataset, sb1_panel, sb2_dataset, sb2_panel

from turnout.core.channels import schema_problems
from turnout.core.errors import PanelError, ResponseError
from turnout.core.scheme import Scheme
from turnout.kernels.compiled import Kernel
from turnout.panel.foreign_object import ForeignObject
from turnout.solver import march
from turnout.solver.outcome import Code, NotConverged
from turnout.throw.compilation import must_compile
from turnout.throw.save import Save
from turnout.throw.simulate import compile_kernels, simulate

STUBBORN = Scheme(iterations=1, halvings=0, follow_path=False)


def interrupt(done: int, total: int) -> None:
    """Press Ctrl-C half-way."""
    assert total == 2500
    if done >= 1000:
        raise KeyboardInterrupt


@cache
def interrupted() -> xr.Dataset:
    return simulate(sb1_panel(), throw=False, report=interrupt)


def test_the_end_of_the_schedule_is_reached() -> None:
    dataset = sb1_dataset()
    np.testing.assert_allclose(dataset["time"][[0, -1]], [0.0, 2.5], rtol=1e-6)
    assert (dataset.attrs["complete"], dataset.attrs["outcome"]) == (True, "complete")


def test_two_runs_are_the_same_to_the_last_bit() -> None:
    again = simulate(sb1_panel())
    xr.testing.assert_identical(again.drop_attrs(), sb1_dataset().drop_attrs())


def test_what_throws_share_does_not_hide_what_differs() -> None:
    """Attributes and coordinates are kept for throws that share panel, object and scheme."""
    stiffer = {"drive.1.stiffness": 7.5e6, "lock.gap_limit": 0.004}
    panels = [sb1_panel(), sb1_panel().with_overrides(stiffer)]
    schemes = [Scheme.of("quick"), Scheme.of("quick", force_tolerance=1e-5)]
    cases = [(panel, scheme) for panel in panels for scheme in schemes]
    for panel, scheme in (*cases, *reversed(cases)):
        found = simulate(panel, scheme=scheme)
        assert found.attrs["panel_hash"] == panel.hash
        assert found.attrs["lock_gap_limit"] == panel.lock.gap_limit
        assert found.attrs["force_tolerance"] == scheme.force_tolerance
        assert found["drive_stiffness"].values[0] == panel.drive["1"].stiffness
        found.attrs["panel_hash"], found["drive_stiffness"][:] = "changed", 0.0


def test_attributes_say_what_made_the_numbers() -> None:
    attributes = sb2_dataset().attrs
    assert attributes["panel_hash"] == sb2_panel().hash
    assert "cut-off 300 Hz" in attributes["scheme"]
    placed = json.loads(attributes["foreign_objects"])
    assert placed[0]["size"] == 0.013
    assert placed[0]["place"] == "sleeper 6"
    assert placed[0]["disappears"] is None
    assert json.loads(attributes["overrides"]) == {}
    assert json.loads(sb1_dataset().attrs["overrides"])["schedule.end"] == 2.5
    rails = json.loads(attributes["superelements"])
    assert all(rail["dofs_kept"] < 0.2 * rail["dofs"] for rail in rails)


def test_an_interrupted_run_keeps_what_it_has() -> None:
    partial = interrupted()
    assert partial.attrs["complete"] is False
    assert partial.attrs["outcome"] == "interrupted"
    assert schema_problems(partial) == []
    assert 1001 <= partial.sizes["time"] < 2501
    same = sb1_dataset().isel(time=slice(0, partial.sizes["time"]))
    np.testing.assert_array_equal(partial["drive_force"], same["drive_force"])


def test_an_early_end_raises_with_the_partial_response() -> None:
    with pytest.raises(NotConverged, match=r"not converged at t = \d\.\d+ s \(step") as caught:
        simulate(sb1_panel(), scheme=STUBBORN)
    partial, outcome = caught.value.partial, caught.value.outcome
    assert isinstance(partial, xr.Dataset)
    assert outcome.code is Code.NOT_CONVERGED
    assert outcome.contacts
    assert 0 < partial.sizes["time"] == outcome.step + 1 < 2501
    assert partial.attrs["outcome_message"] == outcome.message() == str(caught.value)
    assert partial.attrs["complete"] is False
    assert schema_problems(partial) == []
    whole = sb1_dataset()["drive_force"][:, : outcome.step + 1]
    np.testing.assert_allclose(partial["drive_force"], whole, rtol=0, atol=1e-6)
    same = simulate(sb1_panel(), scheme=STUBBORN, throw=False)
    xr.testing.assert_identical(same.drop_attrs(), partial.drop_attrs())


def test_unknown_places_are_refused_before_the_run() -> None:
    with pytest.raises(PanelError, match="sleeper"):
        simulate(sb2_panel(), foreign_object=ForeignObject("13 mm", "sleeper 99"))


def test_an_object_of_the_panel_and_one_given_are_both_placed() -> None:
    panel = sb2_panel().with_overrides({"object.stone": {"size": 0.01, "at": "sleeper 9"}})
    dataset = simulate(panel, foreign_object=OBJECT, save=Save(fields=("object_force",)))
    names = [item["name"] for item in json.loads(dataset.attrs["foreign_objects"])]
    assert names == ["stone", "1"]


def test_output_interval_thins_the_same_run() -> None:
    thin = simulate(sb1_panel(), save=Save(interval=0.01))
    same = sb1_dataset().isel(time=slice(0, None, 10))
    np.testing.assert_array_equal(thin["drive_force"], same["drive_force"])
    np.testing.assert_allclose(thin["time"], same["time"], rtol=0, atol=1e-12)


def test_chosen_stations_and_fields_bring_only_their_coordinates() -> None:
    fields = Save(stations=(1.0, 2.5), interval=0.05, fields=("gap", "locked", "drive_force"))
    dataset = simulate(sb1_panel(), save=fields)
    assert set(dataset.data_vars) == {"gap", "locked", "drive_force"}
    assert "chair" not in dataset.coords
    assert "drive_x" in dataset.coords
    assert schema_problems(dataset) == []
    assert dataset["x"].values.tolist() == [1.0, 2.5]
    whole = simulate(sb1_panel(), save=Save(stations="all", interval=0.05))
    assert whole.sizes["x"] > 140
    expected = whole["gap"].interp(x=[1.0, 2.5])
    np.testing.assert_allclose(dataset["gap"], expected, rtol=0, atol=1e-12)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"fields": ("drive_forse",)}, "nearest is drive_force"),
        ({"fields": "gap"}, "tuple of channel names"),
        ({"interval": -1.0}, "must be positive"),
        ({"stations": "some"}, "places .* or 'all'"),
        ({"stations": (2.0, 1.0)}, "rising order"),
    ],
)
def test_a_wrong_choice_is_refused(given: dict[str, object], words: str) -> None:
    with pytest.raises(ResponseError, match=words):
        Save(**given)  # type: ignore[arg-type]


def test_an_interval_need_not_be_a_multiple_of_the_step() -> None:
    response = simulate(sb1_panel(), save=Save(interval=1.5e-3))
    np.testing.assert_allclose(np.diff(response["time"]), 1.5e-3)
    at_steps = simulate(sb1_panel())["drive_force"].interp(time=response["time"])
    difference = np.abs(response["drive_force"] - at_steps).max()
    assert difference < 5e-3 * np.abs(at_steps).max()


def test_compilation_is_announced_only_when_it_is_due(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert sb1_dataset().attrs["complete"]
    assert not must_compile()
    of_new_process: Any = march.march
    of_new_process = Kernel(of_new_process.py_func, loop=False, part=False)
    assert not must_compile(of_new_process)
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    assert must_compile(of_new_process)
    assert not must_compile(), "what is loaded need not be compiled again"


def test_compilation_does_not_count_as_the_time_of_a_run(monkeypatch: pytest.MonkeyPatch) -> None:
    compiled = []

    def compile_slowly() -> None:
        compiled.append(True)
        time.sleep(1.0)

    monkeypatch.setattr("turnout.throw.simulate.must_compile", lambda: True)
    monkeypatch.setattr("turnout.throw.simulate.compile_kernels", compile_slowly)
    began = time.perf_counter()
    attributes = simulate(sb1_panel()).attrs
    assert compiled == [True]
    assert attributes["wall_time"] <= time.perf_counter() - began - 1.0


def test_the_throw_that_compiles_is_a_valid_one(monkeypatch: pytest.MonkeyPatch) -> None:
    ends = []
    monkeypatch.setattr("turnout.throw.simulate.integrate", lambda *_, end, **__: ends.append(end))
    compile_kernels()
    assert ends == [0.03]
