"""The words after a run, checked against the dataset that they are about."""

from collections.abc import Callable

import pytest
import xarray as xr
from tests.unit.simulated import sb1_dataset, sb1_panel, sb2_dataset
from tests.unit.test_throw_simulate import interrupted

from turnout.metric.summary import summary
from turnout.throw.simulate import simulate


def text_of(dataset: xr.Dataset) -> str:
    return "\n".join(f"{heading}: {text}" for heading, text in summary(dataset))


def test_the_end_state_is_reported() -> None:
    dataset, text = sb2_dataset(), text_of(sb2_dataset())
    end = dataset.isel(time=-1)
    for name in ("1", "2"):
        force = float(end["drive_force"].sel(drive=name)) / 1e3
        gap = float(end["drive_gap"].sel(drive=name)) * 1e3
        assert f"end force {force:.2f} kN; raw end gap {gap:.2f} mm" in text
    stretch = float(end["drive_force"].sel(drive="2")) / 810.0
    assert f"(bushing stretch {stretch:.2f} mm)" in text
    assert f"first touched at t = {float(dataset['contact_time']):.3f} s" in text
    assert "locked: yes" in text
    assert "TKK1 yes" in text
    assert "no drive slipped" in text
    assert "13 mm at sleeper 6 (x = 3.6 m), rail A" in text
    assert "TOO NARROW: at least 58 mm required" in text
    assert "cut-off 300 Hz" in text


def test_a_slipping_drive_is_reported_with_place_and_time() -> None:
    dataset = sb2_dataset().copy(deep=True)
    late = dataset["time"].values >= 7.5
    dataset["drive_slipping"].loc[{"drive": "2"}] = late
    dataset["locked"].values[-1] = False
    dataset["in_control"].values[:, -1] = False
    text = text_of(dataset)
    assert "drive 2 at x = 6.9 m from t = 7.500 s, in the closing movement" in text
    assert "none left closing" in text
    assert "locked: NO" in text
    assert "TKK1 NO" in text


def test_a_slip_says_whether_an_object_was_touched_before() -> None:
    dataset = sb2_dataset().copy(deep=True)
    early = (dataset["time"].values >= 3.0) & (dataset["time"].values < 3.2)
    dataset["drive_slipping"].loc[{"drive": "2"}] = early
    assert "in the opening movement, without any object touched before" in text_of(dataset)
    dataset["contact_time"] = dataset["contact_time"] * 0.0 + 2.5
    assert "in the opening movement, after an object was touched" in text_of(dataset)


@pytest.mark.parametrize(
    ("dataset", "words"),
    [
        (interrupted, "NOT COMPLETE: interrupted at t = "),
        (sb1_dataset, "object: none"),
        (sb1_dataset, "schedule.end = 2.5"),
        (lambda: sb2_dataset().assign(object_touched=False), "never touched"),
    ],
)
def test_what_is_special_of_a_run_is_said(dataset: Callable[[], xr.Dataset], words: str) -> None:
    assert words in text_of(dataset())


@pytest.mark.parametrize("kept", [["drive_force"], ["gap"], ["locked"]])
def test_what_was_not_kept_is_left_out(kept: list[str]) -> None:
    assert "panel: sb2" in text_of(sb2_dataset()[kept])


def test_a_run_without_equilibrium_has_little_to_tell() -> None:
    nothing = sb2_dataset().isel(time=slice(0, 0)).assign_attrs(complete=False)
    assert [heading for heading, _ in summary(nothing)] == ["panel", "object", "run"]


def test_a_scheme_that_makes_energy_is_warned_of() -> None:
    dataset = sb2_dataset().copy(deep=True)
    assert "WARNING" not in text_of(dataset)
    scale = dataset.attrs["energy_scale"]
    dataset["energy_numerical"][-1] = -0.03 * scale
    assert "WARNING: the time stepping itself MADE 3 % of the energy" in text_of(dataset)
    dataset["energy_numerical"][-1] = 0.05 * scale
    assert "itself lost 5 % of the energy, more than 2 %; take a smaller step" in text_of(dataset)


def test_a_tabulated_bushing_has_no_one_stiffness() -> None:
    """Force over the panel's stiffness would be 0.9 mm; the table stretches by 4.1 mm and more."""
    table = {"extension": [-0.02, 0.0, 0.02], "force": [-4000.0, 0.0, 4000.0]}
    given = {f"drive.1.{key}": value for key, value in table.items()}
    dataset = simulate(sb1_panel().with_overrides(given))
    texts = dict(line for line in summary(dataset) if line[0].startswith("drive"))
    assert "(bushing stretched as its table says)" in texts["drive 1"]
    assert "(bushing stretch " in texts["drive 2"]


def test_a_rail_without_stock_rail_has_no_gap_to_tell() -> None:
    bare = sb2_dataset().copy(deep=True)
    bare["end_gap"].loc[{"drive": "1"}] = float("nan")
    text = text_of(bare)
    assert "nan" not in text
    assert "no gap known, as the rail has no stock rail" in text
    assert "raw end gap" in text


def test_a_force_of_nothing_has_no_sign() -> None:
    tiny = sb2_dataset().copy(deep=True)
    tiny["drive_force"].values[0, -1] = -1.0
    assert "end force 0.00 kN" in text_of(tiny)
    assert "-0.00" not in text_of(tiny)
