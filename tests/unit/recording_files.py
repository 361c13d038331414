"""Recordings of many kinds of files, written here: the samples of `recording_kinds` in each."""

import importlib
import json
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import xarray as xr
from scipy.io import netcdf_file, savemat
from tests.unit.recording_kinds import BOTH, COUNT, CURRENT, FORCE, STEP, Read

Write = Callable[[Path], object]
File = tuple[str, str, Write, Read | tuple[str, ...]]
"""Name, suffix, function that writes it, and what must come out."""
TIME = np.arange(COUNT) * STEP
MOMENTS = np.datetime64("2026-11-28T08:14:00", "us") + (TIME * 1e6).astype("timedelta64[us]")
LISTS: dict[str, Any] = {"Force": FORCE.tolist(), "Current": CURRENT.tolist()}


def optional(package: str) -> Any:
    pytest.importorskip(package.split(".")[0], reason=f"{package} is not installed")
    return importlib.import_module(package)


def as_json(content: Any) -> Write:
    return lambda path: path.write_text(json.dumps(content), encoding="utf-8")


def records(**more: Any) -> list[dict[str, Any]]:
    return [
        {**{k: v[n] for k, v in more.items()}, "Force": f, "Current": c}
        for n, (f, c) in enumerate(zip(LISTS["Force"], LISTS["Current"], strict=True))
    ]


JSON: list[File] = [
    ("JSON rows", ".json", as_json(records(**{"time [s]": TIME.tolist()})), BOTH),
    ("JSON lists", ".json", as_json({"sample_rate": 25, **LISTS}), BOTH),
    ("JSON, a list of objects a channel", ".json", as_json({
        name: [{"ts": 40 * n, "value": v} for n, v in enumerate(values)]
        for name, values in LISTS.items()}), ("holds no table, or more than one",)),
    ("JSON, channels that start at different moments", ".json", as_json({"channels": [
        {"name": name, "rate": 25, "start": f"2026-11-28T08:14:0{at}.500", "data": values.tolist()}
        for name, values, at in (("Force", FORCE, 0), ("Current", CURRENT, 1))]}),
     {"Force": (25.0, 0.0), "Current": (25.0, 1.0)}),
    ("JSON, a unit beside the interval", ".json", as_json({"dt": 40, "dt_unit": "ms", **LISTS}),
     BOTH),
    ("JSON rate as text", ".json", as_json({"meta": {"fs": "25 Hz"}, "data": LISTS}), BOTH),
    ("JSON, a shaft's rate", ".json", as_json({"shaft": {"rate": 7}, **LISTS}), ("neither times",)),
    ("JSON split", ".json",
     as_json({"columns": ["t_ms", "Force", "Current"],
              "data": [[n * 40, f, CURRENT[n]] for n, f in enumerate(LISTS["Force"])]}), BOTH),
    ("JSON channels", ".json",
     as_json({"channels": [{"name": k, "dt": STEP, "values": v} for k, v in LISTS.items()]}), BOTH),
    ("JSON of pandas", ".json",
     as_json({k: {str(n): x for n, x in enumerate(v)}
              for k, v in {"time": TIME.tolist(), **LISTS}.items()}), BOTH),
    ("JSON of pandas, stamps", ".json",
     as_json({k: {str(n): x for n, x in enumerate(v)}
              for k, v in {"time": [str(m) for m in MOMENTS], **LISTS}.items()}), BOTH),
    ("JSON of pandas beside a rate", ".json", as_json(
        {"fs": 25, **{k: {str(n): x for n, x in enumerate(v)} for k, v in LISTS.items()}}), BOTH),
    ("JSON, names in the first row beside a rate", ".json",
     as_json({"fs": 25, "rows": [list(LISTS), *map(list, zip(*LISTS.values(), strict=True))]}),
     BOTH),
    ("JSON lines", ".jsonl", lambda path: path.write_text(
        "".join(json.dumps(row) + "\n" for row in records(time=TIME.tolist())), "utf-8"), BOTH),
    ("JSON stamps", ".json", as_json(records(time=[str(m) for m in MOMENTS])), BOTH),
    ("JSON Unix ms", ".json",
     as_json(records(time=[1_795_853_640_000 + 40 * n for n in range(COUNT)])), BOTH),
    ("JSON throws", ".json",
     as_json([{"throw": k, "power": LISTS["Current"]} for k in (1, 2)]), ("2 throws",)),
    ("JSON throw with its interval", ".json",
     as_json([{"id": 7, "interval_ms": 40, "Force": LISTS["Force"]}]), {"Force": (25.0, 0.0)}),
    ("JSON throw with times in ms", ".json",
     as_json([{"time_ms": [40 * n for n in range(COUNT)], "Force": LISTS["Force"]}]),
     {"Force": (25.0, 0.0)}),
    ("JSON throw with an index", ".json",
     as_json([{"time": list(range(COUNT)), "Force": LISTS["Force"]}]), ("may be an index",)),
    ("JSON, pairs of a time and a value", ".json",
     as_json({"name": "Force", "data": np.column_stack((TIME, FORCE)).tolist()}),
     ("its cells hold pairs of numbers",)),
    ("JSON, different lengths", ".json", as_json({"time": TIME.tolist(), "Force": [1.0, 2.0]}),
     ("different lengths (time 40, Force 2)",)),
    ("JSON, decimal commas", ".json", as_json({
        k: [f"{v:.3f}".replace(".", ",") for v in values]
        for k, values in (("time", TIME), ("Force", FORCE), ("Current", CURRENT))}), BOTH),
    ("JSON, commas before three digits", ".json", as_json({
        "fs": 25, "Current": [f"{v:.3f}".replace(".", ",") for v in CURRENT]}),
     {"Current": (25.0, 0.0)}),
    ("JSON rows without names", ".json",
     as_json(np.column_stack((TIME, FORCE, CURRENT)).tolist()),
     {"column 2": (25.0, 0.0), "column 3": (25.0, 0.0)}),
    ("JSON without a time", ".json", as_json(LISTS), ("neither times nor a sample rate",)),
    ("JSON cut off", ".json", lambda path: path.write_text('{"time": [1, 2', "utf-8"),
     ("is no JSON",)),
]  # fmt: skip


def html(path: Path) -> None:
    cells = "".join(
        f"<tr><td>{n * STEP:.2f}</td><td>{f}</td><td>{CURRENT[n]}</td></tr>\n"
        for n, f in enumerate(FORCE)
    )
    head = "<tr><th>Time (s)</th><th>Force [kN]</th><th>Current [A]</th></tr>"
    path.write_text(f"<html><body><table>{head}{cells}</table></body></html>", encoding="utf-8")


def xlsx(rows: list[list[Any]], *, first: str = "General") -> Write:
    """Return a function that writes the smallest workbook; `first` formats its first column."""
    names = "http://schemas.openxmlformats.org"
    package, sheet = f"{names}/package/2006", f"{names}/spreadsheetml/2006/main"
    office = f"{names}/officeDocument/2006/relationships"

    def cell(value: Any, place: int) -> str:
        if isinstance(value, str):
            return f'<c t="inlineStr"><is><t>{value}</t></is></c>'
        return f'<c s="{int(place == 0)}"><v>{value!r}</v></c>'

    lines = "".join(
        f"<row>{''.join(cell(value, place) for place, value in enumerate(row))}</row>"
        for row in rows
    )
    parts = {
        "[Content_Types].xml": f'<Types xmlns="{package}/content-types"/>',
        "_rels/.rels": f'<Relationships xmlns="{package}/relationships"><Relationship Id="r1" '
        f'Type="{office}/officeDocument" Target="xl/workbook.xml"/></Relationships>',
        "xl/_rels/workbook.xml.rels": f'<Relationships xmlns="{package}/relationships">'
        f'<Relationship Id="r1" Type="{office}/worksheet" Target="worksheets/s.xml"/>'
        f'<Relationship Id="r2" Type="{office}/styles" Target="styles.xml"/></Relationships>',
        "xl/styles.xml": f'<styleSheet xmlns="{sheet}"><numFmts count="1"><numFmt numFmtId="164" '
        f'formatCode="{first}"/></numFmts><cellXfs count="2"><xf numFmtId="0"/>'
        '<xf numFmtId="164" applyNumberFormat="1"/></cellXfs></styleSheet>',
        "xl/workbook.xml": f'<workbook xmlns="{sheet}" xmlns:r="{office}"><sheets>'
        '<sheet name="Throw" sheetId="1" r:id="r1"/></sheets></workbook>',
        "xl/worksheets/s.xml": f'<worksheet xmlns="{sheet}"><sheetData>{lines}</sheetData>'
        "</worksheet>",
    }

    def write(path: Path) -> None:
        optional("python_calamine")
        with zipfile.ZipFile(path, "w") as archive:
            for name, text in parts.items():
                archive.writestr(name, text)

    return write


SHEETS: list[File] = [
    ("HTML named .xls", ".xls", html, BOTH),
    ("workbook", ".xlsx", xlsx([["Time (s)", "Force [kN]", "Current [A]"],
        *([n * STEP, f, float(CURRENT[n])] for n, f in enumerate(FORCE.tolist()))]), BOTH),
    *((f"workbook, {name}", ".xlsx", xlsx([["Time", "Force [kN]", "Current [A]"],
        *([begin + n * STEP / 86_400, f, float(CURRENT[n])] for n, f in enumerate(FORCE.tolist()))],
        first=first), BOTH)
      for name, begin, first in (("dates", 46_354.343, "yyyy\\-mm\\-dd hh:mm:ss.000"),
        ("times of day", 0.343, "hh:mm:ss.000"), ("durations", 0.0, "[h]:mm:ss.000"),
        ("days", 46_354.343, "General"))),
    ("workbook, rate above", ".xlsx", xlsx([["Sample interval", "40 ms"], ["Force", "Current"],
        *([f, float(CURRENT[n])] for n, f in enumerate(FORCE.tolist()))]), BOTH),
    ("workbook, German texts", ".xlsx", xlsx([["Zeit (s)", "Force", "Current"],
        *([f"{a:.2f}".replace(".", ","), f"{b:.3f}".replace(".", ","), f"{c}".replace(".", ",")]
          for a, b, c in zip(TIME, FORCE, CURRENT, strict=True))]), BOTH),
    ("workbook, curves with ids from 0", ".xlsx", xlsx([["id", "power"],
        *[[n, ",".join(map(str, FORCE))] for n in range(3)]]),
     ("3 throws in one table", "'0', '1', '2'")),
    ("workbook, curves in cells", ".xlsx", xlsx([["id", "power"],
        *([k, ",".join(f"{c:.1f}" for c in CURRENT)] for k in (1, 2, 3))]),
     ("3 throws in one table",)),
    ("workbook, index", ".xlsx", xlsx([["", "Force"],
        *([n, f] for n, f in enumerate(FORCE.tolist()))]), ("neither times nor",)),
]  # fmt: skip


def comtrade(
    *, binary: bool = False, data: bool = True, rate: str = "25", later: float = STEP
) -> Write:
    def write(path: Path) -> None:
        kind = "BINARY" if binary else "ASCII"
        channels = (
            "1,Force,,,kN,0.001,0,0,-32767,32767,1,1,P\n2,Current,,,A,0.001,0,0,0,32767,1,1,P\n"
        )
        rates = f"1\n{rate},{COUNT}\n"
        if later != STEP:
            rates = f"2\n{rate},{COUNT // 2}\n{1 / later:g},{COUNT}\n"
        text = f"Station,1,1999\n2,2A,0D\n{channels}50\n{rates}"
        begin = "28/11/2026,08:14:00.000000\n"
        path.write_text(text + begin + begin + f"{kind}\n1.0\n", "utf-8")
        counts = np.rint(np.column_stack((FORCE, CURRENT)) * 1000).astype("<i2")
        if not data:
            return
        if binary:
            row = np.dtype([("n", "<u4"), ("t", "<u4"), ("v", "<i2", (2,))])
            held = np.zeros(COUNT, row)
            held["n"], held["t"], held["v"] = np.arange(COUNT) + 1, np.rint(TIME * 1e6), counts
            path.with_suffix(".dat").write_bytes(held.tobytes())
            return
        steps = np.repeat([STEP, later], COUNT // 2)
        stamps = np.rint((np.cumsum(steps) - steps) * 1e6).astype(int)
        lines = (f"{n + 1},{stamps[n]},{a},{b}\r\n" for n, (a, b) in enumerate(counts))
        path.with_suffix(".dat").write_text("".join(lines), "utf-8")

    return write


def uff(path: Path) -> None:
    pyuff = optional("pyuff")
    for name, values in (("Force", FORCE), ("Current", CURRENT)):
        item = pyuff.prepare_58(
            binary=0, func_type=1, rsp_node=1, rsp_dir=1, ref_dir=1, ref_node=1, data=values,
            x=TIME, id1=name, rsp_ent_name="a", ref_ent_name="b", abscissa_spacing=1,
            abscissa_spec_data_type=17, ordinate_spec_data_type=13, orddenom_spec_data_type=0,
        )  # fmt: skip
        pyuff.UFF(str(path)).write_sets(item, mode="add")


TEXTUAL: list[File] = [
    ("COMTRADE", ".cfg", comtrade(), BOTH),
    ("COMTRADE, binary", ".cfg", comtrade(binary=True), BOTH),
    ("COMTRADE, times only", ".cfg", comtrade(rate="0"), BOTH),
    ("COMTRADE, two rates", ".cfg", comtrade(later=0.02),
     ("its step is 0.04 s up to 0.8 s and 0.02 s behind it",)),
    ("COMTRADE, no data", ".cfg", comtrade(data=False), (".dat file is not beside it",)),
    ("UFF", ".uff", uff, BOTH),
    ("UFF without histories", ".unv", lambda path: path.write_text(
        "    -1\n   151\nmodel\n    -1\n", "utf-8"), ("no time histories (data set 58)",)),
    ("imc FAMOS", ".raw", lambda path: path.write_bytes(b"|CF,2,1,1;|CK,1,3,1,1;" + bytes(99)),
     ("imc FAMOS", "export it as ASCII or MDF")),
]  # fmt: skip


def hdf5(
    *, file: dict[str, Any] | None = None, each: dict[str, Any] | None = None,
    time: tuple[Any, dict[str, Any]] | None = None, group: str = "",
) -> Write:  # fmt: skip
    def write(path: Path) -> None:
        with h5py.File(path, "w") as opened:
            place = opened.create_group(group) if group else opened
            place.attrs.update(file or {})
            for name, values in (("Current", CURRENT), ("Force", FORCE)):
                place.create_dataset(name, data=values).attrs.update(each or {})
            if time is not None:
                place.create_dataset("time", data=time[0]).attrs.update(time[1])

    return write


def stamped(path: Path) -> None:
    with h5py.File(path, "w") as opened:
        opened.create_dataset("time", data=np.array([str(m) for m in MOMENTS], dtype="S32"))
        for name, values in (("Current", CURRENT), ("Force", FORCE)):
            opened.create_dataset(name, data=values)


def starts(path: Path) -> None:
    with h5py.File(path, "w") as opened:
        for name, values, begin in (("Current", CURRENT, "01.5"), ("Force", FORCE, "00.0")):
            item = opened.create_dataset(name, data=values)
            item.attrs.update(fs=25.0, start_time=f"2026-11-28T08:14:{begin}")


def compound(path: Path) -> None:
    table = np.zeros(COUNT, [("time", "f8"), ("Force", "f4"), ("Current", "f8"), ("state", "S4")])
    table["time"], table["Force"], table["Current"], table["state"] = TIME, FORCE, CURRENT, b"ON"
    with h5py.File(path, "w") as opened:
        opened.create_dataset("throw", data=table.astype(table.dtype))


def packed(path: Path) -> None:
    with h5py.File(path, "w") as opened:
        opened.attrs["SampleRate"] = "25 Hz"
        for name, values in (("Current", CURRENT), ("Force", FORCE)):
            item = opened.create_dataset(name, data=np.rint((values - 1.0) * 1000).astype("i2"))
            item.attrs.update(scale_factor=0.001, add_offset=1.0)


def mat73(path: Path) -> None:
    """Lay a file out as MATLAB 7.3 does, without its head."""
    with h5py.File(path, "w") as opened:
        for name, values in (("t", TIME), ("Force", FORCE), ("Current", CURRENT)):
            item = opened.create_dataset(name, data=values[None, :])
            item.attrs["MATLAB_class"] = np.bytes_("double")


ARRAYS = {"Force": FORCE, "Current": CURRENT}
SWAPPED: Read = dict(reversed(BOTH.items()))


def series(values: Any, unit: str, **clock: Any) -> dict[str, Any]:
    """Return what MATLAB makes of a time series that becomes a structure."""
    return {"Data": values, "DataInfo": {"Units": unit}, "Time": [], "TimeInfo": {}, **clock}


def signals(**columns: Any) -> dict[str, Any]:
    """Return a structure with time of Simulink."""
    held = np.zeros(len(columns), [("values", object), ("label", object)])
    for place, (name, values) in enumerate(columns.items()):
        held[place] = values.reshape(1, 1, -1), name
    return {"time": TIME[:, None], "signals": held, "blockName": "model/Scope"}


def netcdf3(
    *, time: tuple[Any, str] | None = None, rate: float | None = None, packed: bool = False
) -> Write:
    def write(path: Path) -> None:
        with netcdf_file(path, "w", version=2 if packed else 1) as opened:
            opened.createDimension("time", COUNT)
            if rate is not None:
                opened.sample_rate = rate
            if time is not None:
                opened.createVariable("time", "d", ("time",))[:] = time[0]
                opened.variables["time"].units = time[1]
            for name, values in ARRAYS.items():
                item = opened.createVariable(name, "h" if packed else "d", ("time",))
                item[:] = np.rint(values * 1000) if packed else values
                if packed:
                    item.scale_factor = np.float64(0.001)

    return write


def dimensions(engine: Any, *, over: str = "time2") -> Write:
    """Write a force over the time and a current over another dimension of the same length."""

    def write(path: Path) -> None:
        held = {"Force": ("time", FORCE), "Current": (over, CURRENT)}
        places = {"time": TIME, "time2": TIME * 2 + 0.5, "freq": TIME}
        units = {"time": "s", "time2": "s", "freq": "Hz"}
        coordinates = {
            name: (name, places[name], {"units": units[name]})
            for name in ("time", over)
            if name in places
        }
        xr.Dataset(held, coordinates).to_netcdf(path, engine=engine)

    return write


def mat(content: dict[str, Any], **options: Any) -> Write:
    return lambda path: savemat(path, content, **options)


NAMED: list[File] = [
    *((f"netCDF by {engine}, two dimensions", ".nc", dimensions(engine),
       {"Force": (25.0, 0.0), "Current": (12.5, 0.5)}) for engine in ("h5netcdf", "scipy")),
    *((f"netCDF by {engine}, over {over}", ".nc", dimensions(engine, over=over),
       {"Force": (25.0, 0.0)}) for engine in ("h5netcdf", "scipy") for over in ("freq", "sample")),
    ("HDF5, sr of the file", ".h5", hdf5(file={"sr": 25.0}), SWAPPED),
    ("HDF5, rate as text", ".h5", hdf5(each={"SampleRate": "25 Hz"}), SWAPPED),
    ("HDF5, rate of a group", ".h5", hdf5(file={"fs": 25.0}, group="throw"),
     {"throw/Current": (25.0, 0.0), "throw/Force": (25.0, 0.0)}),
    ("HDF5, interval", ".h5", hdf5(each={"dt": STEP, "start": 0.5}),
     dict.fromkeys(SWAPPED, (25.0, 0.5))),
    ("HDF5, CF time", ".nc",
     hdf5(time=(np.arange(COUNT) * 40, {"units": "milliseconds since 2026-11-28 08:14:00"})),
     SWAPPED),
    ("HDF5, time in ms", ".h5", hdf5(time=(TIME * 1e3, {"units": "ms"})), SWAPPED),
    ("HDF5, index", ".h5", hdf5(time=(np.arange(COUNT), {})), ("may be an index",)),
    ("HDF5, a shaft's rate", ".h5", hdf5(file={"rate": 25.0}, group="shaft"),
     ("neither times nor a sample rate",)),
    ("HDF5, starts", ".h5", starts, {"Current": (25.0, 1.5), "Force": (25.0, 0.0)}),
    ("HDF5, two rates", ".h5", hdf5(each={"fs": 25.0, "dt": 0.001}), ("two clocks",)),
    ("HDF5, time stamps", ".h5", stamped, SWAPPED),
    ("HDF5, table", ".h5", compound, BOTH),
    ("HDF5, packed", ".h5", packed, SWAPPED),
    ("MATLAB 7.3 by its classes", ".h5", mat73, SWAPPED),
    ("MATLAB 4 of PicoScope", ".mat",
     mat({**ARRAYS, "Tstart": 0.0, "Tinterval": STEP, "Length": COUNT}, format="4"), BOTH),
    ("MATLAB, a shaft's rate", ".mat",
     mat({"bearing": {"sr": 25.0, "rate": 7.0, "Force": FORCE}}), {"bearing.Force": (25.0, 0.0)}),
    ("MATLAB, a rate alone", ".mat", mat({"rate": 25.0, "Force": FORCE}), ("neither times nor",)),
    ("MATLAB, T is no time", ".mat", mat({"fs": 25.0, "T": TIME * 7.0 + 2.0, "Force": FORCE}),
     {"T": (25.0, 0.0), "Force": (25.0, 0.0)}),
    ("MATLAB days", ".mat", mat({"t": 739_949.343 + TIME / 86_400, **ARRAYS}), BOTH),
    ("MATLAB, t counts", ".mat", mat({"t": np.arange(COUNT), **ARRAYS}), ("may be an index",)),
    ("MATLAB, t in ms", ".mat", mat({"time_ms": np.arange(COUNT) * 40.0, **ARRAYS}), BOTH),
    ("MATLAB, seconds of LabVIEW", ".mat",
     mat({"t": 3_878_698_440.0 + TIME, **ARRAYS}), BOTH),
    ("MATLAB, time stamps", ".mat",
     mat({"time": np.array([str(m) for m in MOMENTS], dtype=object), **ARRAYS}), BOTH),
    ("MATLAB, numbered times", ".mat",
     mat({"time_1": TIME, "rod_1": FORCE, "time_2": TIME + 1.5, "rod_2": CURRENT}),
     {"rod_1": (25.0, 0.0), "rod_2": (25.0, 1.5)}),
    ("MATLAB, numbered times alone", ".mat",
     mat({"time_1": TIME, "time_2": TIME + 1.5, "Force": FORCE}), ("neither times nor",)),
    ("MATLAB, numbered times beside one without", ".mat",
     mat({"time": TIME, "time_1": TIME + 1.5, "time_2": TIME + 3.0, "Force": FORCE,
          "rod_1": CURRENT}), {"Force": (25.0, 0.0), "rod_1": (25.0, 1.5)}),
    ("MATLAB, a numbered time is a channel", ".mat",
     mat({"time": TIME, "tempo_1": CURRENT, "Force": FORCE}),
     {"tempo_1": (25.0, 0.0), "Force": (25.0, 0.0)}),
    ("MATLAB, structures", ".mat",
     mat({"a": {"t": TIME, "Force": FORCE}, "b": {"t": TIME + 1.0, "Current": CURRENT}}),
     {"a.Force": (25.0, 0.0), "b.Current": (25.0, 1.0)}),
    ("Simulink, structure with time", ".mat", mat({"scope": signals(**ARRAYS)}), BOTH),
    ("MATLAB, complex numbers", ".mat", mat({"t": TIME, "Force": FORCE + 1j}),
     ("'Force' is left out: its numbers are complex",)),
    ("Simulink, tout", ".mat", mat({"tout": TIME[:, None], "Force": FORCE}),
     {"Force": (25.0, 0.0)}),
    ("time series in ms", ".mat",
     mat({"Force": series(FORCE, "kN", Time=TIME * 1e3, TimeInfo={"Units": "milliseconds"}),
          "Current": series(CURRENT, "A", Time=TIME, TimeInfo={"Units": "seconds"})}), BOTH),
    ("time series, even", ".mat",
     mat({"a": {**series(FORCE, "kN", TimeInfo={"Units": "milliseconds", "Start": 0.0,
                                               "Increment": 40.0}), "Name": "Force"}}),
     {"Force": (25.0, 0.0)}),
    ("time series over frames", ".mat",
     mat({"a": series(FORCE, "kN", Time=TIME, TimeInfo={"Units": "frames"})}),
     ("'frames' is no unit of time",)),
    ("netCDF 3", ".nc", netcdf3(time=(TIME, "s")), BOTH),
    ("netCDF 3, CF time", ".nc",
     netcdf3(time=(np.arange(COUNT) * 40.0, "milliseconds since 2026-11-28 08:14:00")), BOTH),
    ("netCDF 3, packed", ".nc", netcdf3(rate=25.0, packed=True), BOTH),
    ("netCDF 3, no time", ".nc", netcdf3(), ("neither times nor a sample rate",)),
]  # fmt: skip


def tdms(
    *, file: dict[str, Any] | None = None, group: dict[str, Any] | None = None,
    first: dict[str, Any] | None = None, second: dict[str, Any] | None = None,
    time: tuple[str, Any] | None = None, later: Any = None,
) -> Write:  # fmt: skip
    def write(path: Path) -> None:
        nptdms = optional("nptdms")
        objects = [nptdms.RootObject(file or {}), nptdms.GroupObject("g", group or {})]
        if time is not None:
            objects.append(nptdms.ChannelObject("g", *time))
        objects.append(nptdms.ChannelObject("g", "Force", FORCE, first or {}))
        if later is not None:
            objects.append(nptdms.ChannelObject("g", "Time 2", later))
        objects.append(nptdms.ChannelObject("g", "Current", CURRENT, second or first or {}))
        with nptdms.TdmsWriter(path) as opened:
            opened.write_segment(objects)

    return write


def mat_objects(*, timetable: bool, version: str = "v7", stated: bool = False) -> Write:
    def write(path: Path) -> None:
        matio = optional("matio")
        import pandas as pd

        index = pd.to_datetime(MOMENTS) if timetable else None
        table = pd.DataFrame(ARRAYS, index=index)
        matio.save_to_mat(str(path), {"T": table, **({"fs": 25.0} if stated else {})}, version)

    return write


def time_series(*, version: str = "v7", kind: str = "timeseries", **clock: Any) -> Write:
    """Return a function that saves time series as objects, as MATLAB does."""

    def text(value: str) -> Any:
        return np.array([value])

    def write(path: Path) -> None:
        matio, opaque = optional("matio"), optional("matio.utils.matclass").MatlabOpaque
        held = {}
        for name, values in ARRAYS.items():
            info = {"Units": text("milliseconds"), **clock}
            parts = {
                "Name": text(name),
                "Data_": values[:, None],
                "Time_": np.zeros((0, 0)) if clock else TIME[:, None] * 1e3,
                "TimeInfo": opaque(info, "tsdata.timemetadata"),
                "DataInfo": opaque({"Units": text("kN")}, "tsdata.datametadata"),
            }
            held[f"series_{name}"] = opaque(parts, kind)
        matio.save_to_mat(str(path), held, version)

    return write


BEGIN = np.datetime64("2026-11-28T08:14:00", "us")
WAVE = {"wf_increment": STEP, "wf_start_time": BEGIN}


def mdf(*, sync: int | None = None, later: float = 0.0, unit: str = "s") -> Write:
    def write(path: Path) -> None:
        asammdf = optional("asammdf")
        with asammdf.MDF() as opened:
            opened.append([asammdf.Signal(FORCE, TIME, name="Force", unit="kN")])
            opened.append([asammdf.Signal(CURRENT, TIME + later, name="Current", unit="A")])
            for group in opened.groups:
                group.channels[0].unit = unit
                if sync is not None:
                    group.channels[0].sync_type = sync
            opened.save(path, overwrite=True)

    return write


def parquet(columns: dict[str, Any], *, index: Any = None, name: str | None = None) -> Write:
    def write(path: Path) -> None:
        optional("pyarrow")
        import pandas as pd

        frame = pd.DataFrame(columns)
        if index is not None:
            frame.index = pd.Index(index, name=name)
        frame.to_parquet(path)

    return write


OPTIONAL: list[File] = [
    ("MATLAB, timetable", ".mat", mat_objects(timetable=True), BOTH),
    ("MATLAB 7.3, timetable", ".mat", mat_objects(timetable=True, version="v7.3"), BOTH),
    ("MATLAB, table and a rate", ".mat", mat_objects(timetable=False, stated=True), BOTH),
    ("MATLAB, table without a time", ".mat", mat_objects(timetable=False),
     ("neither times nor a sample rate",)),
    ("MATLAB, time series", ".mat", time_series(), BOTH),
    ("MATLAB 7.3, time series", ".mat", time_series(version="v7.3"), SWAPPED),
    ("MATLAB, even time series", ".mat",
     time_series(Start=np.array([[0.0]]), Increment=np.array([[40.0]])), BOTH),
    ("MATLAB, cells of structures", ".mat",
     mat({"fs": 25.0, "a": np.array([{"Force": FORCE}, "note", {"Current": CURRENT}], object)}),
     {"a 1.Force": (25.0, 0.0), "a 3.Current": (25.0, 0.0)}),
    ("MATLAB, other objects", ".mat", time_series(kind="Recorder"),
     ("objects of the class Recorder are not read",)),
    ("TDMS, two times", ".tdms", tdms(time=("Time 1", TIME), later=TIME + 1.5),
     {"Force": (25.0, 0.0), "Current": (25.0, 1.5)}),
    ("TDMS over a frequency", ".tdms",
     tdms(first={**WAVE, "wf_xname": "Frequency", "wf_xunit_string": "Hz"}),
     ("it is over Frequency, not over time",)),
    ("TDMS, increment in ms", ".tdms",
     tdms(first={"wf_increment": 40.0, "wf_start_offset": 500.0, "wf_xunit_string": "ms"}),
     dict.fromkeys(BOTH, (25.0, 0.5))),
    ("TDMS, falling", ".tdms", tdms(first={"wf_increment": -STEP}),
     ("'wf_increment: -0.04' is no rate",)),
    ("TDMS, rate of the group", ".tdms", tdms(group={"SampleRate": "25 Hz"}), BOTH),
    ("TDMS, rate of the file", ".tdms", tdms(file={"sr": 25.0}), BOTH),
    ("TDMS, a shaft's rate", ".tdms", tdms(group={"rate": 25.0}), ("neither times nor",)),
    ("TDMS, starts", ".tdms",
     tdms(first=WAVE, second={**WAVE, "wf_start_time": BEGIN + np.timedelta64(1500, "ms")}),
     {"Force": (25.0, 0.0), "Current": (25.0, 1.5)}),
    ("TDMS, offset", ".tdms", tdms(first={**WAVE, "wf_start_offset": -0.5}),
     dict.fromkeys(BOTH, (25.0, -0.5))),
    ("TDMS, moments", ".tdms", tdms(time=("DateTime", MOMENTS)), BOTH),
    ("TDMS, time in ms", ".tdms", tdms(time=("Time (ms)", TIME * 1e3)), BOTH),
    ("TDMS, no clock", ".tdms", tdms(), ("neither times nor a sample rate",)),
    ("TDMS, no increment", ".tdms", tdms(first={"wf_increment": 0.0}), ("neither times nor",)),
    ("MDF", ".mf4", mdf(), BOTH),
    ("MDF, a later group", ".mf4", mdf(later=1.5), {"Force": (25.0, 0.0), "Current": (25.0, 1.5)}),
    ("MDF, master in ms", ".mf4", mdf(unit="ms"), dict.fromkeys(BOTH, (25_000.0, 0.0))),
    ("MDF, master in no time", ".mf4", mdf(unit="rev"), ("'rev' is no unit of time",)),
    ("MDF over a distance", ".mf4", mdf(sync=3), ("recorded over a distance",)),
    ("Parquet, moments", ".parquet", parquet({"when": MOMENTS, **ARRAYS}), BOTH),
    ("Parquet, index of moments", ".parquet", parquet(ARRAYS, index=MOMENTS), BOTH),
    ("Parquet, date beside a time", ".parquet",
     parquet({"date": MOMENTS[:1].astype("M8[D]").repeat(COUNT).astype("M8[us]"), "time": TIME,
              **ARRAYS}), BOTH),
    ("Parquet, named index", ".parquet", parquet(ARRAYS, index=TIME, name="time"), BOTH),
    ("Parquet, index of numbers", ".parquet", parquet(ARRAYS, index=np.arange(COUNT) * 2),
     ("neither times nor",)),
    ("Parquet, no index", ".parquet", parquet(ARRAYS), ("neither times nor a sample rate",)),
    ("Parquet, a signal a row", ".parquet",
     parquet({"which": ["Force", "Current"] * COUNT, "time": np.repeat(TIME, 2),
              "value": np.column_stack((FORCE, CURRENT)).ravel()}), BOTH),
    ("Parquet, throws", ".parquet",
     parquet({"throw": np.repeat([7, 8], COUNT // 2), "time": np.tile(TIME[: COUNT // 2], 2),
              **ARRAYS}), ("2 throws in one table",)),
]  # fmt: skip

FILES: list[File] = [*JSON, *SHEETS, *TEXTUAL, *NAMED, *OPTIONAL]
