"""Text files as DewesoftX, MATLAB and Excel write them, and as they arrive when something broke."""

from pathlib import Path

import numpy as np
import pytest

from turnout.core.errors import FileError, MeasurementError
from turnout.measurement.chain.skeleton import skeleton
from turnout.measurement.formats.file_format import read_recording
from turnout.measurement.formats.text_table import csv_bytes
from turnout.measurement.recording import RecordedChannel, Recording

DEWESOFT = (
    "Data file\tD:\\throw.dxd\r\nStart time:\t2025-11-03 10:12:33.250\r\n"
    "Sample rate:\t1000 Hz\r\n\r\n"
    "Time (s)\tRod 1 (mV/V)\tStrain (µm/m)\r\n0\t0,1\t1\r\n0,001\t0,2\t\r\n0,002\t-3e-1\t3,5\r\n"
)
EXCEL = (
    "sep=;\r\nTime;Rod 1;Strain\r\ns;mV/V;µm/m\r\n0,000;0,1;1\r\n0,001;0,2;\r\n0,002;-0,3;3,5\r\n"
)
PLAIN = 'Time [ms],"Rod 1 [mV/V]",Strain [um/m]\n0,0.1,1\n1,0.2,\n2,-0.3,3.5\n'
MATLAB = (
    "# t, Rod 1 (mV/V), Strain (µm/m)\n 0.0e+00, 1e-1, 1\n 1.0e-03, 2.0e-01, NaN\n .002, -.3, 3.5"
)
TAKEN = "column 1 rises evenly and is taken for the time [s]"


def written(folder: Path, content: str | bytes, encoding: str = "utf-8") -> Path:
    path = folder / "throw.csv"
    path.write_bytes(content if isinstance(content, bytes) else content.encode(encoding))
    return path


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "latin-1"])
@pytest.mark.parametrize("text", [DEWESOFT, EXCEL, PLAIN, MATLAB])
def test_the_same_numbers_however_they_are_written(
    tmp_path: Path, text: str, encoding: str
) -> None:
    recording = read_recording(written(tmp_path, text, encoding))
    assert list(recording.channels) == ["Rod 1", "Strain"]
    rod, strain = recording.channels.values()
    assert (rod.unit, strain.unit) == ("mV/V", "um/m")
    assert (rod.rate, rod.start) == (1000.0, 0.0)
    np.testing.assert_allclose(rod.values, [0.1, 0.2, -0.3], rtol=1e-15)
    np.testing.assert_array_equal(strain.values, [1.0, np.nan, 3.5])
    assert recording.problems == ("channel 'Strain': 1 cell is empty, taken as missing",)


@pytest.mark.parametrize(
    ("text", "rate", "columns", "problems"),
    [
        # The lines above the table tell start and rate.
        ("Start time: 2025-11-03 10:12:33\nSample rate (kHz): 2,5\nA [V];B [-]\n1;2\n3;4\n",
         2500.0, {"A": [1.0, 3.0], "B": [2.0, 4.0]}, ()),
        # White space, as `save -ascii` writes it; the first column rises evenly: time.
        (" 0.0  1e0 5\n 1.0e-3  2 6\n 2.0e-03  3 7\n",
         1000.0, {"column 2": [1, 2, 3], "column 3": [5, 6, 7]}, (TAKEN,)),
        # The line that tells Excel the separator is no heading.
        ("sep=;\n0;1\n0,1;2\n0,2;3\n", 10.0, {"column 2": [1, 2, 3]}, (TAKEN,)),
        ("t,a,b\n0,1,2\n0.1,3,4\n0.2,5",
         10.0, {"a": [1, 3], "b": [2, 4]}, ("the last line is cut off and left out",)),
    ],
    ids=["lines above", "numbers alone", "separator", "cut off"],
)  # fmt: skip
def test_tables_without_a_usual_heading_or_end(
    tmp_path: Path, text: str, rate: float, columns: dict[str, list[float]],
    problems: tuple[str, ...],
) -> None:  # fmt: skip
    recording = read_recording(written(tmp_path, text))
    assert recording.start_time == ("2025-11-03 10:12:33" if "Start" in text else None)
    assert recording.problems == problems
    assert list(recording.channels) == list(columns)
    for name, values in columns.items():
        np.testing.assert_array_equal(recording.channel(name).values, values)
        assert recording.channel(name).rate == pytest.approx(rate)


@pytest.mark.parametrize(
    "stamps",
    [
        ("23:59:59.999", "00:00:00.000", "00:00:00.001"),
        ("2025-11-03 23:59:59.999", "2025-11-04 00:00:00.000", "2025-11-04 00:00:00.001"),
        # zones; the end of summer time; a second without digits behind it
        ("23:59:59.999-05:00", "00:00:00.000-05:00", "00:00:00.001-05:00"),
        *(
            (
                "2026-10-25T02:59:59.999+02:00",
                f"2026-10-25T02:00:00{digits}+01:00",
                "2026-10-25T02:00:00,001+01:00",
            )
            for digits in (".000", "")
        ),
        ("2026-11-23T09:59:59.999Z", "2026-11-23T10:00:00Z", "2026-11-23T10:00:00.001Z"),
    ],
)
def test_clock_times_over_midnight(tmp_path: Path, stamps: tuple[str, ...]) -> None:
    rows = "".join(f"{stamp};{value}\n" for value, stamp in enumerate(stamps))
    recording = read_recording(written(tmp_path, "Time;A (V)\n" + rows))
    assert recording.channel("A").rate == pytest.approx(1000.0, rel=1e-6)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "the file is empty"),
        (b" \n\n", "the file is empty"),
        (b"hello\nworld\n", "no rows of numbers in it (it begins with: hello)"),
        (bytes(range(256)) * 10, "no text file"),
        (b"PK\x03\x04 and more", "an archive; unpack it"),
        (b"t,a,b\n0,1,2\n0.1,x7,4\n0.2,5,6\n", "line 3, column 'a': 'x7' is not a number"),
        (b"t,a\n0,1\n0.1,3\n\n0.2,oops\n", "line 5, column 'a': 'oops' is not a number"),
        (b"t;a\n0;1,5\n0,1;3.5\n0,2;4,5\n", "line 3, column 'a': '3.5' is not a number"),
        (b"Time,a\n10:00:00.1,1\n10:00:00.2,x\n10:00:00.3,3\n", "line 3, column 'a': 'x'"),
        (b"t,a,b\n0,1,2\n0.1,3,4\n0.2,5,6,7\n", "line 4, saw 4"),
        (b't,a\n0,1\n0.1,2\n0.2,5\n0.3,"', "quotation mark"),
        (b"t,a\n0,1\n0.1,2\x1c7\n0.2,1\n", "'2 7' is not a number"),
        (b"Time (kg),a\n0,1\n1,2\n", "column 'Time': 'kg' is no unit of time"),
        (b"t,a\n0,1\n2,2\n1,3\n", "time must rise; it goes from 2 to 1 s"),
        (b"a (V),b (V)\n1,2\n3,4\n", "'a', 'b' are left out: neither times nor a sample rate"),
    ],
)
def test_what_cannot_be_read_is_one_message(tmp_path: Path, content: bytes, words: str) -> None:
    path = written(tmp_path, content)
    with pytest.raises(FileError) as caught:
        read_recording(path)
    assert words in str(caught.value)
    assert str(path) in str(caught.value)
    assert len(str(caught.value).splitlines()) == 1


def test_a_fault_far_down_is_found(tmp_path: Path) -> None:
    rows = [f"{number / 1000:.3f},{number}\n" for number in range(30_000)]
    rows[25_000] = "25.000,x7\n"
    with pytest.raises(FileError, match="line 25002, column 'a': 'x7' is not a number"):
        read_recording(written(tmp_path, "t,a\n" + "".join(rows)))


def test_a_table_has_one_time() -> None:
    slow, fast = (
        RecordedChannel(n, "V", np.zeros(4), rate=r) for n, r in (("slow", 10.0), ("fast", 20.0))
    )
    with pytest.raises(MeasurementError, match="'fast' and 'slow' have different times"):
        csv_bytes(Recording({"slow": slow, "fast": fast}, "test"))


@pytest.mark.parametrize(("place", "said"), [(1, False), (3, True), (6, False)])
def test_empty_lines_that_may_be_samples_are_said(tmp_path: Path, place: int, said: bool) -> None:
    """A rate gives the time: a line that is lost would shift all samples behind it."""
    lines = ["Sample rate: 25 Hz", "A (V),B (V)", "1.5,2", "2.5,3", "3.5,4", "4.5,5"]
    lines.insert(place, "")
    recording = read_recording(written(tmp_path, "\n".join(lines) + "\n"))
    assert recording.problems == (("check the time: 1 empty line is left out",) if said else ())


@pytest.mark.parametrize(
    ("heading", "mark", "expected"),
    [
        ("t [s] F [N] I1 [A]", " ", {"F": "N", "I1": "A"}),
        ("t (s) F (N) I1 (A)", " ", {"F": "N", "I1": "A"}),
        ("t F I1\n[s] [N] [A]", " ", {"F": "N", "I1": "A"}),
        ("Zeit/s;Kraft 1/kN;Rod 2 mV/V", ";", {"Kraft 1": "kN", "Rod 2": "mV/V"}),
        ("Zeit/s;Kraft/kN;Strom/A", ";", {"Kraft": "kN", "Strom": "A"}),
        # The last letter of I_A may be a phase.
        ("t_s,F_N,I_A", ",", {"F_N": "N", "I_A": ""}),
        ("t_s,force_kN,current_A", ",", {"force_kN": "kN", "current_A": "A"}),
    ],
)
def test_units_at_the_end_of_a_name(
    tmp_path: Path, heading: str, mark: str, expected: dict[str, str]
) -> None:
    rows = [mark.join(f"{value:.3f}" for value in (0.01 * n, n**0.5, 2.0)) for n in range(20)]
    recording = read_recording(written(tmp_path, "\n".join([heading, *rows, ""])))
    found = {name: channel.unit for name, channel in recording.channels.items()}
    assert found == expected
    assert {channel.rate for channel in recording.channels.values()} == {100.0}
    force, unit = next(iter(expected.items()))
    assert f'column = "{force}"\nunit = "{unit}"\nkind = "scaled"' in skeleton(recording)


def test_a_decimation_beside_a_rate_is_refused_by_name(tmp_path: Path) -> None:
    path = tmp_path / "throw.csv"
    path.write_text("Sample rate: 25 Hz\nDecimation: 4\nForce\n" + "1\n2\n" * 9, encoding="utf-8")
    with pytest.raises(FileError, match=r"'Decimation: 4' is stated beside a sample rate of 25 Hz"):
        read_recording(path)


@pytest.mark.parametrize(
    ("edge", "rule"),
    [
        ("| {} |", "|---|---:|:---:|"),
        ("{}", "--- | --- | ---"),
        ("|{}|", "+-----+-----+-----+"),
    ],
)
@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_tables_with_lines_between_rows(tmp_path: Path, edge: str, rule: str, end: str) -> None:
    rows = [f"{n * 0.04:.2f} | {n * n % 7} | {n / 8}" for n in range(20)]
    head, *lines = (edge.format(row) for row in ("Time (s) | Rod 1 (kN) | I (A)", *rows))
    drawn = [rule] if rule.startswith("+") else []
    path = tmp_path / "throw.md"
    path.write_text(end.join(["Drive 1", *drawn, head, rule, *lines, *drawn, ""]), newline="")
    recording = read_recording(path)
    assert [(item.name, item.unit) for item in recording.channels.values()] == [
        ("Rod 1", "kN"),
        ("I", "A"),
    ]
    rod = recording.channel("Rod 1")
    assert (rod.rate, rod.values.tolist()) == (25.0, [float(n * n % 7) for n in range(20)])
    assert recording.problems == ()


def test_a_row_of_units_without_one_of_the_time(tmp_path: Path) -> None:
    rows = "".join(f"{n * 0.04:.3E},{n * n % 7:.3E},2.0E+00\n" for n in range(20))
    text = f'"HIOKI 8860"\n"Interval","40ms"\n"CH1-1","1-2"\n"V","A"\n"Time","CH1","CH2"\n{rows}'
    recording = read_recording(written(tmp_path, text))
    assert [item.unit for item in recording.channels.values()] == ["V", "A"]
    assert recording.channel("CH1").rate == 25.0


@pytest.mark.parametrize("separator", ["\t", " | "])
def test_blanks_within_cells_part_no_columns(tmp_path: Path, separator: str) -> None:
    rows = [("Time", "I A"), *((f"28.11.2026 08:14:{n:02d},500", "2,5") for n in range(20))]
    text = "".join(separator.join(row) + "\n" for row in rows)
    assert list(read_recording(written(tmp_path, text)).channels) == ["I A"]


@pytest.mark.parametrize("mark", ["# ", "! ", "// ", "%"])
def test_marks_of_comments_are_no_names(tmp_path: Path, mark: str) -> None:
    for comma in (",", " "):
        rows = "".join(f"{n * 0.04:.2f}{comma}{n * n % 7}\n" for n in range(20))
        head = f"{mark}Sample interval: 40 ms\n{mark}time{comma}force\n"
        recording = read_recording(written(tmp_path, head + rows))
        assert list(recording.channels) == ["force"]
        assert recording.problems == ()


@pytest.mark.parametrize(
    "line",
    [
        "Intervalle d'échantillonnage : 40 ms",
        "Intervalo de muestreo: 40 ms",
        "Intervallo di campionamento: 40 ms",
        "Bemonsteringsinterval: 40 ms",
        "Okres próbkowania: 40 ms",
    ],
)
def test_intervals_in_other_languages(tmp_path: Path, line: str) -> None:
    text = f"{line}\nF;I\n" + "1,5;2,5\n2,5;3,5\n" * 9
    assert read_recording(written(tmp_path, text)).channel("F").rate == 25.0


def test_numbered_statements_and_repeated_numbers_are_no_names(tmp_path: Path) -> None:
    rows = "1.5,2.5\n2.5,3.5\n" * 9
    text = f"[Header]\nSampleRate=25\n[Channels]\n1=Force,kN\n2=Current,A\n[Data]\n{rows}"
    assert list(read_recording(written(tmp_path, text)).channels) == ["column 1", "column 2"]
    rows = "".join(f"{n};1,5;2,5\n" for n in range(9))
    text = f"Channel;Force;Current\nSample rate [Hz];25;25\nOffset;0;0\n{rows}"
    with pytest.raises(FileError, match="line 3: 'Offset' is not a number, in a row of numbers"):
        read_recording(written(tmp_path, text))


@pytest.mark.parametrize("end", ["2,49", "2,", "2,490", "2,49\n"])
def test_a_last_number_that_was_cut_off(tmp_path: Path, end: str) -> None:
    rows = "".join(f"0,{n:02d};1,5;2,500\n" for n in range(9))
    recording = read_recording(written(tmp_path, f"Zeit (s);F;I\n{rows}0,09;1,5;{end}"))
    kept = end == "2,490" or end.endswith("\n")
    assert recording.channel("I").values.size == 9 + kept
    assert recording.problems == (() if kept else ("the last line is cut off and left out",))


@pytest.mark.parametrize(
    ("cells", "end", "words"),
    [
        ([f"1,{n % 8 + 1}" for n in range(9)], "2", "check the last line: '2' has fewer digits"),
        ([f"1,{n}1" for n in range(9)], "1,9", "check the last line: '1,9' has fewer digits"),
        ([f"1,{n}0" for n in range(9)], "2", "check the last line: '2' has fewer digits"),
        ([f"1,{n}1" for n in range(9)], "OVL", "channel 'I': 1 cell is overload"),
    ],
)
def test_a_last_number_that_may_be_whole_is_kept(
    tmp_path: Path, cells: list[str], end: str, words: str
) -> None:
    lines = [f"0,{n:02d};{n}1,5;{cell}" for n, cell in enumerate([*cells, end])]
    recording = read_recording(written(tmp_path, "\n".join(["Zeit (s);F;I", *lines])))
    assert recording.channel("I").values.size == 10
    assert len(recording.problems) == 1
    assert recording.problems[0].startswith(words)


def test_names_of_digits_alike_behind_a_time_and_marks_as_names(tmp_path: Path) -> None:
    lines = [f"0,{n:02d};{n};{n}1,5" for n in range(9)]
    recording = read_recording(written(tmp_path, "\n".join(["Time (s);418;418", *lines, ""])))
    assert list(recording.channels) == ["418", "418 (2)"]
    recording = read_recording(written(tmp_path, "\n".join(["Time (s);%;F", *lines, ""])))
    assert list(recording.channels) == ["%", "F"]
    recording = read_recording(written(tmp_path, "\n".join(["Time (s);#;F", *lines, ""])))
    assert list(recording.channels) == ["F"]
