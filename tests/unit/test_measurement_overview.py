"""The listing of a recording and the channel map that is suggested for it."""

import numpy as np
import pytest

from turnout.core.errors import MeasurementError
from turnout.core.toml import parse_toml
from turnout.measurement.chain.apply import (
    apply_chain,
    load_channel_map,
    mapped_channels,
    parse_channel_map,
)
from turnout.measurement.chain.skeleton import skeleton
from turnout.measurement.recording import RecordedChannel, Recording, overview


def recording(*columns: tuple[str, str]) -> Recording:
    channels = (
        RecordedChannel(name, unit, np.linspace(0, 1e-3, 50), 100.0) for name, unit in columns
    )
    return Recording({channel.name: channel for channel in channels}, "throw.csv")


def test_figures_of_a_channel() -> None:
    values = np.concatenate((np.zeros(50), np.full(50, 4.0), [np.nan] * 50))
    row = overview(RecordedChannel("a", "V", values, 100.0, 2.0), steps=3)
    assert (row.samples, row.missing, row.duration) == (150, 50, 1.5)
    assert (row.least, row.mean, row.largest) == (0.0, 2.0, 4.0)
    np.testing.assert_array_equal(row.course, [0.0, 1.0, np.nan])


def test_a_channel_without_values() -> None:
    row = overview(RecordedChannel("a", "V", np.full(5, np.nan), 10.0))
    assert row.missing == 5
    assert np.isnan([row.least, row.mean, row.largest]).all()
    assert np.isnan(row.course).all()


def test_the_suggested_map_reads_the_recording_it_was_made_for() -> None:
    given = recording(
        ("Rod 1", "mV/V"),
        ("Strain drive 2", "um/m"),
        ("Clamp 1", "V"),
        ("Strom 2", "A"),
        ("Load cell", "V"),
        ("GPS", "km/h"),
        ('odd "name"', ""),
    )
    text = skeleton(given)
    dataset = apply_chain(given, parse_channel_map(parse_toml(text, source="map")))
    columns = ["Rod 1", "Strain drive 2", "Clamp 1", "Strom 2", "Load cell"]
    assert dataset["column"].values.tolist() == columns
    assert dataset["drive"].values.tolist() == ["1", "2"]
    assert np.isfinite(dataset["drive_current"].values).all()
    assert '# not used: column "GPS" in km/h' in text
    assert '# not used: column "odd \\"name\\"", unit unknown' in text


def test_columns_of_the_same_number_get_drives_of_their_own() -> None:
    text = skeleton(recording(("Rod 1 a", "mV/V"), ("Rod 1 b", "mV/V"), ("Rod", "mV/V")))
    channel_map = parse_channel_map(parse_toml(text, source="map"))
    assert {n: s.column for n, s in channel_map.drive_force.items()} == {
        "1": "Rod 1 a",
        "2": "Rod 1 b",
        "3": "Rod",
    }


def test_the_last_number_of_a_name_is_the_drive() -> None:
    text = skeleton(recording(("AI 3 rod 1", "mV/V"), ("AI 4 rod 2", "mV/V")))
    channel_map = parse_channel_map(parse_toml(text, source="map"))
    assert {n: s.column for n, s in channel_map.drive_force.items()} == {
        "1": "AI 3 rod 1",
        "2": "AI 4 rod 2",
    }


def test_nothing_that_looks_like_a_sensor() -> None:
    text = skeleton(recording(("GPS", "km/h")))
    assert parse_toml(text, source="map").data == {}
    assert "No column looks like" in text


def test_currents_and_powers_of_motors_are_suggested_as_those_of_drives() -> None:
    """Three currents of one motor are its phases, two those of two drives."""
    given = recording(("I1", "A"), ("I2", "A"), ("I3", "A"), ("U12", "kV"), ("P", "W"))
    channel_map = parse_channel_map(parse_toml(skeleton(given), source="map"))
    assert channel_map.drive_current["1"].phases == ["I2", "I3"]
    dataset = apply_chain(given, channel_map)
    mean = np.mean([given.channel(name).values for name in ("I1", "I2", "I3")], axis=0)
    np.testing.assert_allclose(dataset["drive_current"].sel(drive="1").values, mean)
    np.testing.assert_array_equal(
        dataset["drive_power"].sel(drive="1").values, given.channel("P").values
    )
    two = recording(("i_1", "A"), ("i_2", "A"), ("Power 1", "kW"), ("Power 2", "kW"))
    channel_map = parse_channel_map(parse_toml(skeleton(two), source="map"))
    assert list(channel_map.drive_current) == list(channel_map.drive_power) == ["1", "2"]


@pytest.mark.parametrize(
    ("name", "largest", "key", "unit"),
    [
        ("Force 1", 6100.0, "drive_force.1", "N"),
        ("Kraft 2", 6.1, "drive_force.2", "kN"),
        ("Strom 1", 2.4, "drive_current.1", "A"),
        ("Current", 2400.0, "drive_current.1", "mA"),
        ("Power 3", 350.0, "drive_power.3", "W"),
        ("Leistung", 0.35, "drive_power.1", "kW"),
    ],
)
def test_the_range_suggests_the_unit_that_a_file_leaves_out(
    name: str, largest: float, key: str, unit: str
) -> None:
    channel = RecordedChannel(name, "", np.array([0.1 * largest, largest]), rate=25.0)
    given = Recording({name: channel}, "throw.csv")
    table = parse_toml(skeleton(given), source="map").data
    quantity, _, drive = key.partition(".")
    assert table[quantity][drive]["unit"] == unit
    assert table[quantity][drive]["kind"] == "scaled"
    assert apply_chain(given, parse_channel_map(parse_toml(skeleton(given), source="map")))


def test_a_phase_that_is_missing_is_named() -> None:
    text = '[drive_current.1]\ncolumn = "I1"\nphases = ["I2"]\nkind = "scaled"'
    channel_map = parse_channel_map(parse_toml(text, source="map"))
    with pytest.raises(MeasurementError, match="its phase 'I2' is not in the file"):
        apply_chain(recording(("I1", "A")), channel_map)


def test_powers_of_phases_are_summed_and_currents_are_not() -> None:
    """A third of the power would be taken for a machine with another circuit."""
    text = "".join(
        f'[drive_{what}.1]\ncolumn = "{x}1"\nphases = ["{x}2", "{x}3"]\nkind = "scaled"\n'
        for what, x in (("current", "I"), ("power", "P"))
    )
    columns = [(f"{x}{k}", unit) for x, unit in (("I", "A"), ("P", "W")) for k in (1, 2, 3)]
    found = apply_chain(recording(*columns), parse_channel_map(parse_toml(text, source="map")))
    current, power = (float(found[f"drive_{what}"][0, -1]) for what in ("current", "power"))
    assert power == pytest.approx(3.0 * current) == pytest.approx(3e-3)
    shifted = parse_channel_map(parse_toml(text + 'offset = "0.1 mW"\nunit = "W"\n', source="map"))
    assert float(apply_chain(recording(*columns), shifted)["drive_power"][0, 0]) == pytest.approx(
        -3e-4
    )


def test_rows_say_what_a_unit_stands_for() -> None:
    given = recording(("Rod 1", "mV/V"), ("Rod 2", "mV/V"), ("Clamp 1", "V"), ("Clamp 2", "V"))
    channel_map = load_channel_map("two-rods")
    rows = {row.key: row for row in mapped_channels(apply_chain(given, channel_map), channel_map)}
    assert list(rows) == ["drive_force.1", "drive_force.2", "drive_current.1", "drive_current.2"]
    # 6 kN is 0.372611 mV/V: 16.103 kN for each mV/V
    assert rows["drive_force.1"].sensor == "strain bridge, 1 mV/V is 16.103 kN"
    assert rows["drive_force.1"].largest == pytest.approx(0.016103, rel=1e-4)
    assert rows["drive_current.2"].sensor == "clamp, 1 V is 10 A"


def test_rows_tell_how_well_a_calibration_is_known() -> None:
    text = """
    [object_force]
    column = "F"
    kind = "calibrated"
    readings = { unit = "mV/V", values = [0, 1, 2] }
    loads = { unit = "kN", values = [0, 1, 4] }
    """
    channel_map = parse_channel_map(parse_toml(text, source="map"))
    (row,) = mapped_channels(apply_chain(recording(("F", "mV/V")), channel_map), channel_map)
    assert row.sensor == (
        "calibrated, 1 mV/V is 2 kN +- 29 %, zero at 0.1667 +- 0.34 mV/V, "
        "at most 17 % of the range off the line (3 points)"
    )


def test_one_current_for_two_machines_is_none_of_the_second() -> None:
    given = recording(("Current 1+2", "A"), ("Power 1 and 2", "W"))
    channel_map = parse_channel_map(parse_toml(skeleton(given), source="map"))
    assert list(channel_map.drive_current) == list(channel_map.drive_power) == ["1+2"]
