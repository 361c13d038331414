"""A folder of recordings becomes one dataset; what is excluded or odd is said, never dropped."""

import json
import zipfile
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr
from tests.unit.campaigns import copied, edited, made
from tests.unit.recorded import clean
from tests.unit.simulated import sb2_panel

from turnout.calibration.measured_movements import observe
from turnout.core.channels import schema_problems
from turnout.core.errors import MeasurementError
from turnout.measurement.campaign import recorded_throw
from turnout.measurement.campaign.build_campaign import (
    BuiltCampaign,
    build_campaign_dataset,
    slipped_movements,
    stack_movements,
)
from turnout.measurement.campaign.find_throws import FoundThrow
from turnout.measurement.campaign.recorded_throw import RecordedThrow
from turnout.measurement.campaign.run_sheet import SheetRow, find_sheet, read_sheet
from turnout.measurement.campaign.sheet_checks import (
    RodCheck,
    check_rods,
    order_remarks,
    series_remarks,
)
from turnout.measurement.chain.recorder import (
    LowPass,
    Recorder,
    stated_recorder,
)
from turnout.measurement.formats import file_format
from turnout.measurement.formats.file_format import WRITERS, read_recording
from turnout.measurement.recording import Recording


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> BuiltCampaign:
    return build_campaign_dataset(copied(tmp_path_factory.mktemp("campaign"), built=False))


def test_all_movements_are_in_one_dataset(built: BuiltCampaign) -> None:
    dataset = built.dataset
    assert dataset is not None
    assert (built.excluded, built.reused) == ((), 0)
    assert dataset.sizes["movement"] == 9
    assert dataset["drive_force"].dims == ("movement", "drive", "time")
    assert schema_problems(dataset) == []
    assert dataset.attrs["kind"] == "synthetic measurement"
    assert "not measured" in dataset.attrs["synthetic"]


def test_coordinates_say_what_was_thrown(built: BuiltCampaign) -> None:
    dataset = built.dataset
    assert dataset is not None
    last = dataset.isel(movement=-1)
    assert (str(last["place"].values), float(last["size"])) == ("sleeper 6", 0.031)
    assert str(last["direction"].values) == "closing"
    assert bool(last["slipped"])
    assert dataset["repeat"].values.tolist() == [1, 2, 3, 1, 2, 3, 1, 1, 1]


def test_no_load_cell_no_object_force(built: BuiltCampaign) -> None:
    dataset = built.dataset
    assert dataset is not None
    measured = np.isfinite(dataset["object_force"]).any("time").values
    np.testing.assert_array_equal(measured, dataset["size"].values >= 0.013)


def test_time_is_zero_at_the_onset(built: BuiltCampaign) -> None:
    dataset = built.dataset
    assert dataset is not None
    current = dataset["drive_current_unfiltered"].max("drive")
    starts = current["time"].values[(current.values > 1.0).argmax(axis=1)]
    assert np.abs(starts).max() <= 0.002


def changed_bit(stored: Path, part: str) -> None:
    """Change a piece so that its zip checksum fits: it is rewritten as a whole."""
    with zipfile.ZipFile(stored) as archive:
        members = {name: bytearray(archive.read(name)) for name in archive.namelist()}
    # The last byte is of a number or, in Unicode of 4 bytes, of a character; 8 keeps both legal.
    members[part][-4 if part == "described.npy" else -1] ^= 8
    with zipfile.ZipFile(stored, "w") as archive:
        for name, content in members.items():
            archive.writestr(name, bytes(content))


def test_a_damaged_piece_is_cut_again_and_the_others_are_taken_up(
    tmp_path: Path, built: BuiltCampaign
) -> None:
    folder = copied(tmp_path)
    stored = sorted((folder / ".turnout").glob("*.npz"))
    stored[0].write_bytes(b"PK\x03\x04 and then nothing")
    for path, part in zip(stored[1:], ("time", "drive_force", "described"), strict=False):
        changed_bit(path, f"{part}.npy")
    again = build_campaign_dataset(folder)
    assert again.reused == 5
    assert built.dataset is not None
    assert again.dataset is not None
    assert built.dataset.identical(again.dataset.assign_attrs(built.dataset.attrs))


def test_a_file_of_several_movements_is_read_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = edited(copied(tmp_path, built=False), "none_closing_2.csv,", "none_closing_1.csv,2,")
    edited(folder, "file,", "file,movement,")
    sheet = folder / "runs.csv"
    lines = [
        line
        if line.startswith(("#", "file")) or ",2,closing" in line
        else line.replace(",", ",,", 1)
        for line in sheet.read_text(encoding="utf-8").splitlines()
    ]
    sheet.write_text("\n".join(lines), encoding="utf-8")
    read: list[str] = []

    def counted(path: Path, *, allow_outside: bool) -> Recording:
        read.append(path.name)
        return read_recording(path, allow_outside=allow_outside)

    monkeypatch.setattr(recorded_throw, "read_recording", counted)
    campaign = build_campaign_dataset(folder)
    assert [item.run.name for item in campaign.excluded] == ["none_closing_1#2"]
    assert sorted(read) == sorted({run.file for run in campaign.sheet.runs})
    read.clear()
    assert build_campaign_dataset(folder).reused == 8
    assert read == ["none_closing_1.csv"]


def test_what_several_recordings_say_is_said_once(tmp_path: Path) -> None:
    folder = copied(tmp_path)
    for number in (1, 2):
        path = folder / f"none_closing_{number}.csv"
        lines = path.read_text(encoding="utf-8").splitlines()
        # A second row of the same time, as some recorders write.
        cells, before = lines[200].split(","), lines[199].split(",")
        lines[200] = ",".join([before[0], *cells[1:]])
        path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    said = [text for text in build_campaign_dataset(folder).remarks if "times repeat" in text]
    assert len(said) == 1
    assert "none_closing_1 and 1 more: channels 'Rod 1'" in said[0]


@pytest.mark.parametrize("quantity", ["drive_current", "drive_power"])
def test_a_campaign_without_rod_forces(tmp_path: Path, quantity: str) -> None:
    """Currents or powers alone, 25 a second from the contactor on."""
    unit, factor = ("A", 1.0) if quantity == "drive_current" else ("W", 150.0)
    time = np.arange(0.0, 6.0, 0.04)
    for number in range(1, 5):
        run = np.where(time < 5.0 + 0.02 * number, 2.3 + 4.0 * np.exp(-time / 0.08), 0.0)
        lines = "".join(f"{factor * value:.3f}\n" for value in run)
        (tmp_path / f"t{number}.csv").write_text(f"Sample rate: 25 Hz\nM 1 ({unit})\n{lines}")
    rows = "".join(f"t{n}.csv,closing,0,none,{n}\n" for n in range(1, 5))
    (tmp_path / "runs.csv").write_text("file,direction,size [mm],place,repeat\n" + rows)
    (tmp_path / "channels.toml").write_text(f'[{quantity}.1]\ncolumn = "M 1"\nkind = "scaled"\n')
    campaign = build_campaign_dataset(tmp_path, strict=True)
    assert campaign.dataset is not None
    assert "drive_force" not in campaign.dataset
    stacked = campaign.dataset[f"{quantity}_unfiltered"]
    assert stacked.sizes["movement"] == 4
    assert float(stacked.max()) == pytest.approx(factor * 6.3)


def test_a_campaign_in_one_table(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A throw per number in a column, read once for all; one that is missing is named."""
    time = np.arange(0.0, 6.0, 0.04)
    lines = ["throw,t [s],P 1 [W]"]
    for number in range(417, 421):
        power = np.where(time < 5.0, 330.0 + 600.0 * np.exp(-time / 0.08), 0.0)
        lines += [f"{number},{t:.2f},{p:.1f}" for t, p in zip(time, power, strict=True)]
    (tmp_path / "throws.csv").write_text("\n".join(lines) + "\n")
    rows = "".join(f"throws.csv,{n},closing,0,none\n" for n in (417, 418, 419, 420, 500))
    (tmp_path / "runs.csv").write_text("file,throw,direction,size [mm],place\n" + rows)
    (tmp_path / "channels.toml").write_text('[drive_power.1]\ncolumn = "P 1"\nkind = "scaled"\n')
    tables = []
    read = file_format.text_table
    monkeypatch.setattr(
        file_format, "text_table", lambda content, **of: tables.append(of) or read(content, **of)
    )
    campaign = build_campaign_dataset(tmp_path)
    assert campaign.dataset is not None
    names = [f"throws@{number}" for number in range(417, 421)]
    assert campaign.dataset["movement"].values.tolist() == names
    assert campaign.dataset["repeat"].values.tolist() == [1, 2, 3, 4]
    (item,) = campaign.excluded
    assert "no throw '500'; there are 4 throws in one table" in item.reasons[0]
    assert len(tables) == 1
    assert build_campaign_dataset(tmp_path).reused == 4


def test_an_interrupted_build_keeps_what_it_has(tmp_path: Path) -> None:
    folder = copied(tmp_path, built=False)

    def stop(done: int, total: int) -> None:
        if done == 4:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        build_campaign_dataset(folder, report=stop)
    assert len(list((folder / ".turnout").glob("*.npz"))) == 4


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("sleeper 6,1,yes", "sleeper 6,1,no", ["the currents say one did"]),
        (
            "13,sleeper 6,1,no",
            "33,sleeper 6,1,no",
            ["comes after 33 mm", "are sizes mixed up?"],
        ),
    ],
)
def test_a_sheet_that_contradicts_the_recordings_is_remarked(
    old: str, new: str, words: list[str], tmp_path: Path
) -> None:
    campaign = build_campaign_dataset(edited(copied(tmp_path), old, new))
    for part in words:
        assert any(part in remark for remark in campaign.remarks), campaign.remarks


def test_a_turned_direction_excludes(tmp_path: Path) -> None:
    folder = edited(copied(tmp_path), "3.csv,closing,0,none,3", "3.csv,opening,0,none,9")
    (excluded,) = build_campaign_dataset(folder).excluded
    assert "the sheet says opening, the rod forces closing" in excluded.reasons[0]


def test_an_extra_file_and_a_series_without_slip_are_remarked(tmp_path: Path) -> None:
    folder = copied(tmp_path)
    sheet = folder / "runs.csv"
    lines = sheet.read_text(encoding="utf-8").splitlines()
    sheet.write_text("\n".join(lines[:-1]) + "\n", encoding="utf-8")
    remarks = build_campaign_dataset(folder).remarks
    assert any("sleeper-6_31mm_1.mat: is in no line" in remark for remark in remarks)
    assert any("no drive slipped up to 13 mm" in remark for remark in remarks)


def test_lines_against_the_clock_are_remarked(tmp_path: Path) -> None:
    runs = read_sheet(find_sheet(made())).runs[:3]
    times = ["2025-01-01T08:00:00", "2025-01-01T08:04:00", "2025-01-01T08:02:00"]
    (remark,) = order_remarks(runs, times)
    assert runs[2].file in remark
    assert order_remarks(runs, ["", "", ""]) == []
    # 08:04 in Stockholm is before 08:00 in London.
    zones = ["2025-01-01T08:00:00+00:00", "2025-01-01T08:04:00+01:00", ""]
    assert len(order_remarks(runs, zones)) == 1
    assert order_remarks(runs, ["2025-01-01T08:00:00", "2024-01-01T08:04:00+01:00", ""]) == []
    assert order_remarks(runs, ["31.12.2024 08:00", "01.01.2025 08:00", ""]) == []


def test_a_movement_that_is_not_there_says_how_many_are(tmp_path: Path) -> None:
    folder = copied(tmp_path)
    edited(folder, "file,direction", "file,movement,direction")
    text = (folder / "runs.csv").read_text(encoding="utf-8")
    rows = [
        line if line.startswith(("#", "file")) else line.replace(",", ",2,", 1)
        for line in text.splitlines()
    ]
    (folder / "runs.csv").write_text("\n".join(rows), encoding="utf-8")
    campaign = build_campaign_dataset(folder)
    assert campaign.dataset is None
    assert (
        "movement 2 is not in the recording: it holds one throw" in campaign.excluded[0].reasons[0]
    )


@pytest.mark.parametrize("slips", [4, 16])
def test_slips_are_found_where_most_movements_slip(slips: int) -> None:
    """One movement of 17 without a slip shows how long a motor runs."""
    ends = [(5.0, 5.2), *[(10.0, 10.0)] * slips]
    pieces = [SimpleNamespace(throw=SimpleNamespace(onset=2.0, drive_ends=pair)) for pair in ends]
    assert slipped_movements(pieces) == [False, *[True] * slips]  # type: ignore[arg-type]


def test_movements_cut_at_different_times_are_aligned() -> None:
    runs = [run for run in read_sheet(find_sheet(made())).runs if run.size == 0.013] * 2
    pieces = []
    for start, stop in ((1.0, 6.0), (1.7, 6.5)):
        kept = clean(0.013).sel(time=slice(start, stop))
        throw = FoundThrow(0, kept.sizes["time"], 2.0, 5.4, (5.2, 5.4), "current", "closing")
        pieces.append(RecordedThrow(kept.drop_attrs(), throw, "", ()))
    dataset = stack_movements(list(zip(runs, pieces, strict=True)), [False, False])
    force = dataset["drive_force_unfiltered"]
    assert (float(force["time"][0]), float(force["time"][-1])) == (-1.0, 4.5)
    both = force.sel(time=slice(-0.29, 3.9))
    np.testing.assert_array_equal(both[0], both[1])
    assert np.isfinite(both).all()
    assert np.isnan(force[1].sel(time=slice(None, -0.31))).all()
    assert np.isnan(force[0].sel(time=slice(4.01, None))).all()


@pytest.mark.parametrize(
    ("last", "said"), [(5000.0, "no drive slipped up to 16 mm"), (4020.0, "no longer grows")]
)
def test_no_slip_is_said_only_where_no_force_saturates(
    tmp_path: Path, last: float, said: str
) -> None:
    sheet = tmp_path / "runs.csv"
    rows = [f"{n}.csv,closing,{size},drive 1,no" for n, size in enumerate((5, 13, 16))]
    sheet.write_text("\n".join(["file,direction,size [mm],place,slip", *rows]), encoding="utf-8")
    forces = [np.array([value, 900.0]) for value in (1000.0, 4000.0, last)]
    (remark,) = series_remarks(read_sheet(sheet).runs, [None] * 3, forces)
    assert said in remark


def silenced(folder: Path, column: str, names: str) -> Path:
    """Write recordings again in which a column is silent."""
    for path in sorted(folder.glob(names)):
        recording = read_recording(path)
        channel = recording.channels[column]
        still = replace(channel, values=0.0 * channel.values)
        changed = replace(recording, channels={**recording.channels, column: still})
        path.write_bytes(WRITERS[path.suffix](changed))
    return folder


def test_a_dead_rod_does_not_discard_its_movements(tmp_path: Path) -> None:
    """Six movements of nine were discarded, though rod 1 was measured in all."""
    built = build_campaign_dataset(silenced(copied(tmp_path), "Rod 2", "none_*.csv"))
    assert built.excluded == ()
    assert built.dataset is not None
    known = np.isfinite(built.dataset["drive_force"]).any("time")
    assert known.sel(drive="1").all()
    assert known.sel(drive="2").values.tolist() == [False] * 6 + [True] * 3
    (remark,) = [text for text in built.remarks if "dead channel of drive_force 2" in text]
    assert "and 5 more" in remark
    assert "the movement is kept" in remark


def test_the_map_states_gains_and_the_recorder(tmp_path: Path) -> None:
    folder = copied(tmp_path)
    path = folder / "channels.toml"
    text = path.read_text(encoding="utf-8")
    text = text.replace('column = "Rod 1"', 'column = "Rod 1"\ngain_uncertainty = 0.002')
    keys = (
        'clock_uncertainty = 1e-5\nrecorded_average = "0.1 s"\nrecorded_rate = "20 Hz"\n'
        'recorded_filter = { kind = "bessel", order = 4, corner = "6 Hz" }\n'
    )
    path.write_text(keys + text, encoding="utf-8")
    built = build_campaign_dataset(folder)
    assert built.dataset is not None
    assert built.dataset.attrs["gain_uncertainty"] == '{"drive_force.1": 0.002}'
    assert built.dataset.attrs["clock_uncertainty"] == 1e-5
    assert stated_recorder(built.dataset.attrs) == Recorder(
        average=0.1, low_pass=LowPass(kind="bessel", order=4, corner=6.0), rate=20.0
    )


def loaded(*names: str, turned: bool = False) -> xr.Dataset:
    """Return two free movements and one with an object at each place: its rod rises at once."""
    time = np.linspace(-1.0, 4.0, 101)
    free = 6e3 * np.clip(time / 3.0, 0.0, 1.0) ** 3
    early = 6e3 * np.clip(time / 1.5, 0.0, 1.0)
    rows = [[free, free]] * 2
    for place in names:
        rows.append([early, 1.05 * free] if (place == "drive 1") != turned else [free, early])
    return xr.Dataset(
        {"drive_force": (("movement", "drive", "time"), np.array(rows))},
        {
            "time": time,
            "drive": ["1", "2"],
            "size": ("movement", [0.0, 0.0, *[0.013] * len(names)]),
            "place": ("movement", ["none", "none", *names]),
            "direction": ("movement", ["closing"] * (2 + len(names))),
        },
    )


def test_rods_that_are_exchanged_are_noticed_by_the_force_at_the_object() -> None:
    """All forces end at the slip level, as on panel sb1; only when they rise differs."""
    assert check_rods(loaded("drive 1", "drive 2")) == RodCheck(checked=True)
    assert check_rods(loaded("drive 1", "drive 2", turned=True)) == RodCheck(("1", "2"), True)
    # A single movement says nothing.
    assert check_rods(loaded("drive 1", turned=True)) == RodCheck()
    assert check_rods(loaded("sleeper 6", "sleeper 7", turned=True)) == RodCheck()


def test_a_rod_that_some_recordings_lack_costs_that_rod_alone(tmp_path: Path) -> None:
    folder = copied(tmp_path)
    path = folder / "none_closing_1.csv"
    path.write_text(path.read_text(encoding="utf-8").replace("Rod 2", "spare"), encoding="utf-8")
    (out,) = build_campaign_dataset(folder).excluded
    assert out.reasons[0].startswith('drive_force.2.column = "Rod 2": is not in the file; there')
    assert out.reasons[0].endswith("where recordings may lack it, say optional = true")
    channels = folder / "channels.toml"
    text = channels.read_text(encoding="utf-8")
    channels.write_text(
        text.replace('column = "Rod 2"', 'column = "Rod 2"\noptional = true'), encoding="utf-8"
    )
    built = build_campaign_dataset(folder)
    assert built.excluded == ()
    assert any("dead channel of drive_force 2: it was not recorded" in t for t in built.remarks)
    assert not any("missing samples" in text for text in built.remarks)


def test_one_current_of_two_machines_is_named_as_such(tmp_path: Path) -> None:
    folder = copied(tmp_path)
    channels = folder / "channels.toml"
    text = channels.read_text(encoding="utf-8")
    assert "[drive_current.2]" in text
    head, _, second = text.partition("[drive_current.2]")
    rest = second[second.index("[") :]
    text = head.replace("[drive_current.1]", '[drive_current."1+2"]') + rest
    channels.write_text(text, encoding="utf-8")
    built = build_campaign_dataset(folder)
    assert built.excluded == ()
    assert not any("drive_current" in text or "1+2" in text for text in built.remarks)
    assert built.dataset is not None
    assert json.loads(built.dataset.attrs["together"]) == {"1+2": ["1", "2"]}
    assert bool(built.dataset["drive_current"].sel(drive="1+2").notnull().any())
    assert observe(built.dataset, sb2_panel())
    channels.write_text(text.replace("drive_force.1]", 'drive_force."1+3"]'), encoding="utf-8")
    with pytest.raises(MeasurementError, match=r"drive_force\.1\+3: .* a force is of one drive"):
        build_campaign_dataset(folder)


def test_a_unit_that_file_and_map_state_otherwise_is_remarked_upon(tmp_path: Path) -> None:
    folder = copied(tmp_path)
    path = folder / "none_closing_1.csv"
    text = path.read_text(encoding="utf-8")
    assert "Rod 1 [mV/V]" in text
    path.write_text(text.replace("Rod 1 [mV/V]", "Rod 1 [kN]"), encoding="utf-8")
    (remark,) = [text for text in build_campaign_dataset(folder).remarks if "the file says" in text]
    assert "drive_force.1 (column 'Rod 1'): the file says kN, the channel map mV/V" in remark


def test_a_rod_and_the_load_cell_that_are_exchanged_are_named_once(tmp_path: Path) -> None:
    folder = copied(tmp_path)
    channels = folder / "channels.toml"
    text = channels.read_text(encoding="utf-8")
    for old, new in (("Rod 2", "other"), ("Load cell", "Rod 2"), ("other", "Load cell")):
        text = text.replace(f'column = "{old}"', f'column = "{new}"')
    channels.write_text(text, encoding="utf-8")
    built = build_campaign_dataset(folder)
    assert built.dataset is not None
    assert built.dataset.attrs["swapped_cell"] == "2"
    assert built.remarks[0].startswith(
        "swapped channels of drive_force 2 and object_force: without"
    )
    (dead,) = [text for text in built.remarks if "dead channel of drive_force 2" in text]
    assert "more: dead channel" in dead
    with pytest.raises(
        MeasurementError, match="swapped channels of drive_force 2 and object_force"
    ):
        observe(built.dataset, sb2_panel())


def test_a_series_may_go_on_after_a_slip_until_a_load_cell_fits() -> None:
    """`campaign virtual` throws up to 13 mm so that the cell measures; it complained of itself."""
    sizes = (0.005, 0.010, 0.013)
    runs = [row(size=size, load_cell=size >= 0.013) for size in sizes]
    forces = [np.array([1e3, 1e3])] * 4
    assert series_remarks(runs, [True] * 3, forces[:3]) == []
    runs.append(row(size=0.016, load_cell=True))
    (remark,) = series_remarks(runs, [True] * 4, forces)
    assert remark.endswith("yet 1 movement of that series follows")


def row(*, size: float, load_cell: bool) -> SheetRow:
    return SheetRow(
        where="line 2",
        file="a.csv",
        movement=1,
        direction="closing",
        size=size,
        place="sleeper 6",
        repeat=1,
        slip=None,
        load_cell=load_cell,
        remark="",
    )
