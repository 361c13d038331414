"""The measuring chain: newtons by hand, the way back, tare, rates, and maps that are wrong."""

from pathlib import Path

import numpy as np
import pytest

from turnout.core.channels import check_schema
from turnout.core.errors import FileError, MeasurementError
from turnout.core.toml import parse_toml
from turnout.measurement.chain.apply import (
    apply_chain,
    load_channel_map,
    map_hash,
    parse_channel_map,
    raw_from_physical,
)
from turnout.measurement.recording import RecordedChannel, Recording

# By hand, with nothing of the program. Rod: E = 210e9 Pa, W = 6.28e-6 m3, h = 0.060 m.
# 6000 N * 0.060 m = 360 N m; 360 / 6.28e-6 = 57.325e6 Pa; / 210e9 = 272.975e-6 strain.
# Full T bridge, gauge factor 2.1: 2.1 * 2 * 1.3 / 4 = 1.365; 1.365 * 272.975e-6 = 372.611e-6 V/V.
RAW = {
    "Rod 1": ("mV/V", [0.0, 0.372611, -0.186306]),  # 0, 6000 N, -3000 N
    "Rod 2": ("mV/V", [0.0621019, 0.0, 0.372611]),  # 1000 N, 0, 6000 N
    "Clamp 1": ("V", [0.0, 0.2, 1.5]),  # 100 mV/A: 0, 2 A, 15 A
    "Clamp 2": ("V", [0.01, 0.0, -0.3]),  # 0.1 A, 0, -3 A
    "Load cell": ("mV/V", [0.0, 0.05, 1.0]),  # 1 mV/V at 20 kN: 0, 1000 N, 20 000 N
}
FORCES = [[0.0, 6000.0, -3000.0], [1000.0, 0.0, 6000.0]]
CURRENTS = [[0.0, 2.0, 15.0], [0.1, 0.0, -3.0]]
OBJECT = [0.0, 1000.0, 20_000.0]

ROD = """
[drive_force.1]
column = "Rod 1"
kind = "strain bridge"
gauge_factor = 2.1
youngs_modulus = "210 GPa"
section_modulus = "6.28 cm^3"
eccentricity = "60 mm"
"""


def recorded(raw: dict[str, tuple[str, list[float]]], rate: float = 1000.0) -> Recording:
    channels = (RecordedChannel(name, unit, np.array(v), rate) for name, (unit, v) in raw.items())
    return Recording({channel.name: channel for channel in channels}, "throw.csv")


def mapped(text: str) -> object:
    return parse_channel_map(parse_toml(text, source="map.toml"))


def test_newtons_by_hand() -> None:
    dataset = apply_chain(recorded(RAW), load_channel_map("two-rods"))
    np.testing.assert_allclose(dataset["drive_force"].values, FORCES, rtol=5e-6, atol=1e-9)
    np.testing.assert_allclose(dataset["drive_current"].values, CURRENTS, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(dataset["object_force"].values, OBJECT, rtol=1e-12, atol=1e-9)
    np.testing.assert_allclose(dataset["time"].values, [0.0, 0.001, 0.002], rtol=1e-15)
    assert dataset["drive"].values.tolist() == ["1", "2"]
    check_schema(dataset)
    for name, (unit, values) in RAW.items():  # what was recorded stays beside
        column = dataset["recorded"].sel(column=name)
        np.testing.assert_array_equal(column.values, values)
        assert str(column["column_unit"].values) == unit


@pytest.mark.parametrize(
    ("unit", "extra", "reading"),
    [
        ("mV/V", "", 0.372611),
        ("uV/V", "", 372.611),
        ("um/m", "", 272.975),
        ("µm/m", "", 272.975),
        ("V", 'excitation = "10 V"\ngain = 1000.0', 3.72611),
        ("mV", 'excitation = "5 V"', 1.863055),
        ("mV/V", "sign = -1", -0.372611),
        ("mV/V", 'offset = "0.1 mV/V"', 0.472611),
        ("mV/V", 'bridge = "full bending"', 0.573248),  # 2.1 * 4 / 4 * 272.975e-6
        ("mV/V", 'bridge = "half bending"', 0.286624),
        ("mV/V", 'bridge = "quarter"', 0.143312),
        # pi * 0.04^3 / 32 = 6.283185e-6 m3 in place of 6.28e-6: 0.05 % less
        ("mV/V", 'diameter = "40 mm"', 0.372422),
    ],
)
def test_the_same_force_through_other_rods_and_electronics(
    unit: str, extra: str, reading: float
) -> None:
    rod = ROD.replace('section_modulus = "6.28 cm^3"\n', "") if "diameter" in extra else ROD
    dataset = apply_chain(recorded({"Rod 1": (unit, [reading] * 3)}), mapped(rod + extra))
    np.testing.assert_allclose(dataset["drive_force"].values, 6000.0, rtol=5e-6)
    assert np.isnan(dataset["object_force"].values).all()


@pytest.mark.parametrize("phases", ["", 'phases = ["Clamp 2"]\n'])
def test_a_dead_channel_is_missing(phases: str) -> None:
    """Warnings are errors here; that of a channel without a sample told nothing."""
    text = f'[drive_current.1]\ncolumn = "Clamp 1"\nkind = "scaled"\n{phases}'
    dead = [float("nan")] * 3
    dataset = apply_chain(recorded({"Clamp 1": ("A", dead), "Clamp 2": ("A", dead)}), mapped(text))
    assert np.isnan(dataset["drive_current"].values).all()


def test_known_loads_take_the_place_of_a_data_sheet() -> None:
    text = """
    [drive_force.2]
    column = "Rod 2"
    kind = "calibrated"
    readings = { unit = "mV/V", values = [0.1, 0.3, 0.5] }
    loads = { unit = "kN", values = [0, 4, 8] }
    """
    dataset = apply_chain(recorded({"Rod 2": ("V/V", [0.1e-3, 0.2e-3, 0.0])}), mapped(text))
    np.testing.assert_allclose(dataset["drive_force"].values, [[0, 2000, -2000]], atol=1e-8)


def test_a_column_that_was_scaled_already() -> None:
    text = '[object_force]\ncolumn = "F"\nkind = "scaled"\nsign = -1'
    dataset = apply_chain(recorded({"F": ("kN", [-1.0, 0.0, 2.0])}), mapped(text))
    np.testing.assert_allclose(dataset["object_force"].values, [1000.0, 0.0, -2000.0])
    assert "drive_force" not in dataset


def test_tare_is_the_mean_of_the_rest() -> None:
    text = ROD + 'tare = { start = "2 ms", end = "3 ms" }'
    raw = {"Rod 1": ("mV/V", [9.0, 9.0, 0.1, 0.3, 0.2 + 0.372611])}
    dataset = apply_chain(recorded(raw), mapped(text))
    assert dataset["drive_force"].values[0, 4] == pytest.approx(6000.0, rel=5e-6)
    assert "subtracted as tare" in dataset.attrs["problems"]
    late = mapped(ROD + 'tare = { start = "2 s", end = "3 s" }')
    with pytest.raises(MeasurementError, match="drive_force.1.tare: there are no samples from 2"):
        apply_chain(recorded(raw), late)


@pytest.mark.parametrize("optional", [True, False])
def test_there_and_back(optional: bool) -> None:
    """Columns under their MATLAB names are found; one that may be absent is left out again."""
    channel_map = load_channel_map("two-rods")
    raw = {name: column for name, column in RAW.items() if optional or name != "Load cell"}
    matlab = recorded({name.replace(" ", "_"): column for name, column in raw.items()})
    dataset = apply_chain(matlab, channel_map)
    assert np.isnan(dataset["object_force"].values).all() != optional
    np.testing.assert_allclose(dataset["drive_force"].values, FORCES, rtol=5e-6, atol=1e-9)
    back = raw_from_physical(dataset, channel_map)
    assert list(back.channels) == list(raw)
    for name, (unit, values) in raw.items():
        assert (back.channel(name).unit, back.channel(name).rate) == (unit, 1000.0)
        np.testing.assert_allclose(back.channel(name).values, values, rtol=1e-13, atol=1e-16)


def test_there_and_back_with_sign_offset_and_amplifier() -> None:
    channel_map = mapped(ROD + 'unit = "mV"\nsign = -1\noffset = "3 mV"\nexcitation = "5 V"\n')
    dataset = apply_chain(recorded({"Rod 1": ("mV", [3.0, 1.136945, -2.0])}), channel_map)
    # 6000 N are 0.372611 mV/V, 1.863055 mV at 5 V, here below the offset
    np.testing.assert_allclose(dataset["drive_force"][0, :2], [0, 6000], rtol=5e-6, atol=1e-9)
    back = raw_from_physical(dataset, channel_map).channel("Rod 1")
    assert back.unit == "mV"
    np.testing.assert_allclose(back.values, [3.0, 1.136945, -2.0], rtol=1e-13)


def test_a_faster_column_is_averaged_over_a_step() -> None:
    values = np.tile([0.0, 2.0], 1000)
    recording = Recording({"F": RecordedChannel("F", "N", values, 1000.0)}, "throw.csv")
    text = 'rate = "50 Hz"\n[object_force]\ncolumn = "F"\nkind = "scaled"'
    force = apply_chain(recording, mapped(text))["object_force"]
    assert force.sizes["time"] == 100
    np.testing.assert_allclose(force[1:-1], 1.0, atol=0.06)


def test_the_way_back_needs_what_the_map_names() -> None:
    dataset = apply_chain(recorded(RAW), load_channel_map("two-rods"))
    with pytest.raises(MeasurementError) as caught:
        raw_from_physical(
            dataset.drop_vars("drive_current").sel(drive=["2"]), load_channel_map("two-rods")
        )
    assert "drive_force.1: the dataset has no drive '1'; there are '2'" in str(caught.value)
    assert "drive_current.1: the dataset has no drive_current" in str(caught.value)


def test_columns_of_several_rates() -> None:
    time = np.arange(2001) / 1000
    fast = RecordedChannel("Rod 1", "mV/V", 0.1 * time, 1000.0)
    slow = RecordedChannel("Load cell", "mV/V", 0.05 * time[::10][3:], 100.0, 0.03)
    text = ROD + '[object_force]\ncolumn = "Load cell"\nkind = "load cell"\n'
    text += 'sensitivity = "1 mV/V"\ncapacity = "20 kN"\n'
    recording = Recording({"Rod 1": fast, "Load cell": slow}, "throw.h5")
    dataset = apply_chain(recording, mapped(text))
    assert dataset.sizes["time"] == 1971
    assert float(dataset["time"][0]) == pytest.approx(0.03)
    np.testing.assert_allclose(dataset["object_force"], 1000 * dataset["time"], rtol=1e-12)
    slower = apply_chain(recording, mapped('rate = "100 Hz"\n' + text))
    assert slower.sizes["time"] == 198
    # a straight line stays one through averaging and interpolation, but for the last step
    np.testing.assert_allclose(
        slower["drive_force"][0, :-1], 6000 / 0.372611 * 0.1 * slower["time"][:-1], rtol=5e-6
    )


def test_every_fault_of_a_recording_at_once() -> None:
    raw = {"Rod1": RAW["Rod 1"], "Rod 2": ("V", RAW["Rod 2"][1]), "Clamp 2": ("N", [1.0, 2.0])}
    text = ROD + ROD.replace("drive_force.1", "drive_force.2").replace("Rod 1", "Rod 2")
    text += '[drive_current.2]\ncolumn = "Clamp 2"\nkind = "clamp"\nsensitivity = "100 mV/A"'
    with pytest.raises(MeasurementError) as caught:
        apply_chain(recorded(raw), mapped(text))
    assert str(caught.value).startswith("throw.csv: 3 problems")
    for words in (
        "drive_force.1.column = \"Rod 1\": is not in the file; nearest is 'Rod1'",
        "drive_force.2 (column 'Rod 2'): the column is a voltage (V); add the bridge's excitation",
        "drive_current.2 (column 'Clamp 2'): the column is a force in N, must be a voltage (V)",
    ):
        assert words in str(caught.value)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "maps no column"),
        (ROD.replace("210 GPa", "210 mm"), 'drive_force.1.youngs_modulus = "210 mm"'),
        (ROD.replace('"60 mm"', "60"), "drive_force.1.eccentricity = 60: has no unit"),
        (ROD.replace("gauge_factor", "gage_factor"), "unknown key; nearest is 'gauge_factor'"),
        (ROD.replace("gauge_factor = 2.1", ""), "drive_force.1.gauge_factor: is missing"),
        (ROD.replace("strain bridge", "strain brige"), "nearest is 'strain bridge'"),
        (ROD.replace('kind = "strain bridge"', ""), "drive_force.1: kind is missing"),
        (ROD + 'unit = "furlong"', 'drive_force.1.unit = "furlong": "furlong" is no unit'),
        (ROD + 'offset = "3"', "drive_force.1.offset"),
        (ROD + "sign = 2", "drive_force.1.sign = 2"),
        (ROD + 'diameter = "40 mm"', "either section_modulus or diameter"),
        (ROD + 'tare = { start = "2 s", end = "1 s" }', "must be later than its start"),
        (ROD + ROD.replace("force.1", "force.2"), "is also that of drive_force.1"),
        ("[drive_forces.1]", "drive_forces: unknown key; nearest is 'drive_force'"),
        ("schema_version = 2\n" + ROD, "schema_version = 2"),
        (
            '[drive_force.1]\ncolumn = "a"\nkind = "calibrated"\n'
            'readings = { unit = "mV/V", values = [1, 1] }\n'
            'loads = { unit = "N", values = [1, 2] }',
            "all readings are the same",
        ),
    ],
)
def test_a_map_that_is_wrong(text: str, words: str) -> None:
    with pytest.raises(MeasurementError) as caught:
        mapped(text)
    assert words in str(caught.value)
    assert "map.toml" in str(caught.value)


def test_maps_by_name_and_path(tmp_path: Path) -> None:
    path = tmp_path / "own.toml"
    path.write_text("# mine\n" + ROD, encoding="utf-8")
    assert map_hash(load_channel_map(path)) == map_hash(load_channel_map(str(path)))
    assert map_hash(load_channel_map(path)) != map_hash(load_channel_map("two-rods"))
    with pytest.raises(FileError, match="'two-rod'; nearest is 'two-rods'"):
        load_channel_map("two-rod")
    with pytest.raises(FileError, match="no such file"):
        load_channel_map(tmp_path / "none.toml")
