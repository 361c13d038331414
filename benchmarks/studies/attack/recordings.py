"""Recordings that are damaged or made to harm, read as `turnout import` reads them.

Each file of `tests.faults.hostile_recordings` comes once as it is; after that, sound recordings of
each format with bits flipped, parts cut out, doubled or filled, sizes put where a format keeps
them, and cells of a table replaced. Each must be read, or refused with one line, below 1 GB in
every process and 10 s of processor time.
"""

import random
import resource
import struct
import tempfile
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from scipy.io import savemat
from tests.faults.hostile_recordings import HOSTILE, ROD, mat73

from benchmarks.studies.attack.requests import NUMBERS, ODD
from turnout.core.errors import FileError
from turnout.measurement.chain.skeleton import skeleton
from turnout.measurement.formats import isolated
from turnout.measurement.formats.file_format import read_recording, write_recording
from turnout.measurement.recording import RecordedChannel, Recording, overview

MOST_MEMORY, MOST_SECONDS, LONGEST_MESSAGE = 1000.0, 10.0, 1000
"""Of every process [MB], of all processors [s], of a message [characters]."""
OWN_LIMIT = 4_000_000_000
"""Only keeps a program that fails from taking the machine's memory [bytes]."""
SIZES = (0, 1, 255, 2**16, 2**31 - 1, 2**31, 2**32 - 1, 2**40, 2**63 - 1, 2**64 - 1)

Record = dict[str, Any]


def sound_files(folder: Path) -> dict[str, Path]:
    """Write a sound recording in each format that can be written here; return them by kind."""
    rods = {
        name: RecordedChannel(name, "mV/V", ROD * factor, rate=1000.0)
        for name, factor in (("Rod 1", 1.0), ("Rod 2", -0.5))
    }
    found = {}
    for kind, name in (("CSV", "a.csv"), ("MATLAB", "a.mat"), ("HDF5", "a.h5")):
        found[kind] = folder / name
        write_recording(Recording(rods, "a test"), found[kind])
    found["MATLAB, compressed"] = folder / "b.mat"
    arrays = {"t": np.arange(ROD.size) / 1000, "rod": ROD, "names": np.array(["rod"], dtype=object)}
    savemat(found["MATLAB, compressed"], arrays, do_compression=True)
    found["MATLAB 7.3"] = folder / "c.mat"
    mat73(found["MATLAB 7.3"], _plain_hdf5)
    found["HDF5, compressed"] = folder / "d.h5"
    with h5py.File(found["HDF5, compressed"], "w") as file:
        group = file.create_group("Throw 1")
        item = group.create_dataset("rod", data=ROD, compression=4, chunks=(100,))
        item.attrs["rate"], item.attrs["unit"] = 1000.0, "mV/V"
    return found | _of_extras(folder)


def _plain_hdf5(path: Path) -> None:
    with h5py.File(path, "w") as file:
        file["rod"], file["sample_rate"] = ROD, 1000.0


def _of_extras(folder: Path) -> dict[str, Path]:
    import asammdf
    import nptdms
    import pyarrow as pa
    import pyarrow.parquet as pq

    found = {kind: folder / f"e.{kind.lower()}" for kind in ("Parquet", "TDMS", "MF4")}
    pq.write_table(pa.table({"Time": np.arange(ROD.size) / 1000, "rod": ROD}), found["Parquet"])
    with nptdms.TdmsWriter(found["TDMS"]) as writer:
        reported = {"wf_increment": 0.001, "unit_string": "mV/V"}
        writer.write_segment([nptdms.ChannelObject("Throw", "rod", ROD, reported)])
    with asammdf.MDF() as mdf:
        mdf.append([asammdf.Signal(ROD, np.arange(ROD.size) / 1000, name="rod", unit="mV/V")])
        mdf.save(found["MF4"], overwrite=True)
    return found


@contextmanager
def attacking(seed: int) -> Iterator[Callable[[int], Record]]:
    """Provide a function that reads a hostile recording by its number."""
    resource.setrlimit(resource.RLIMIT_DATA, (OWN_LIMIT, OWN_LIMIT))
    warnings.simplefilter("error")
    with tempfile.TemporaryDirectory(prefix="attack on recordings ") as name:
        folder = Path(name)
        sound, names = sound_files(folder), list(HOSTILE)
        for path in sound.values():
            assert read_recording(path).channels, path

        def attempt(index: int) -> Record:
            source = random.Random(f"{seed}-{index}")
            if index < len(names):
                suffix, write = HOSTILE[names[index]]
                path = folder / f"throw{suffix}"
                kind, what = f"made to harm, {suffix.lstrip('.')}", names[index]
                write(path)
            else:
                kind = source.choice(list(sound))
                path = folder / f"throw{sound[kind].suffix}"
                content, what = mutated(sound[kind].read_bytes(), source, text=kind == "CSV")
                path.write_bytes(content)
            try:
                return {"index": index, "kind": kind, **judged(path, what)}
            finally:
                path.unlink()

        yield attempt


def mutated(content: bytes, source: random.Random, *, text: bool) -> tuple[bytes, str]:
    """Return a file's content with drawn changes, and the names of these."""
    ways = [_bits, _cut, _doubled, _filled, _sizes, *([_cells] * 4 if text else [])]
    chosen = source.sample(ways, source.choice((1, 1, 1, 2)))
    for way in chosen:
        content = way(content, source)
    return content, " and ".join(way.__name__.lstrip("_") for way in chosen)


def _bits(content: bytes, source: random.Random) -> bytes:
    changed = bytearray(content)
    for _ in range(source.choice((1, 1, 5, 50))):
        if changed:
            changed[_place(changed, source)] ^= 1 << source.randrange(8)
    return bytes(changed)


def _cut(content: bytes, source: random.Random) -> bytes:
    at = source.randrange(len(content) + 1)
    more = source.choice((len(content), 1, 8, 500))
    return content[:at] + content[at + more :]


def _doubled(content: bytes, source: random.Random) -> bytes:
    at, more = source.randrange(len(content) + 1), source.choice((8, 512, 10_000))
    return content[:at] + content[at : at + more] * source.choice((2, 20)) + content[at + more :]


def _filled(content: bytes, source: random.Random) -> bytes:
    at, more = _place(content, source), source.choice((4, 64, 3000))
    fill = source.choice((bytes(more), b"\xff" * more, source.randbytes(more)))
    return content[:at] + fill + content[at + more :]


def _sizes(content: bytes, source: random.Random) -> bytes:
    changed = bytearray(content)
    for _ in range(source.choice((1, 3))):
        at = _place(changed, source)
        size = struct.pack(source.choice(("<Q", ">Q")), source.choice(SIZES))
        size = size[: source.choice((2, 4, 8))]
        changed[at : at + len(size)] = size
    return bytes(changed)


def _cells(content: bytes, source: random.Random) -> bytes:
    lines = content.decode("utf-8", "replace").split("\n")
    for _ in range(source.choice((1, 5, 100))):
        at = source.choice((source.randrange(len(lines)), source.randrange(min(12, len(lines)))))
        cells = lines[at].split(",")
        cells[source.randrange(len(cells))] = source.choice((*NUMBERS, *ODD, "1;2", '"', "1,2,3"))
        lines[at] = ",".join(cells)
    return source.choice(("\n", "\r\n", "\r")).join(lines).encode("utf-8", "replace")


def _place(content: bytes | bytearray, source: random.Random) -> int:
    """Return a place, half the time in the first 2 kB, which describe the rest of most formats."""
    near = min(len(content), 2048)
    return source.randrange(max(1, source.choice((near, len(content)))))


def judged(path: Path, what: str) -> Record:
    """Read a recording; return the outcome, and time and memory of all processes."""
    for item in isolated._kept:
        _drop_memory(item.process.pid)
    _drop_memory("self")
    before, ended_before = _processor_time(), _ended_readers()
    own = _most_memory("self")
    said, fault, outcome = "", "", "answered"
    try:
        recording = read_recording(path)
        for channel in recording.channels.values():
            overview(channel)
        skeleton(recording)
    except FileError as error:
        said, outcome = str(error), "refused"
    except Exception as error:  # anything else is a fault
        fault = f"{type(error).__name__}: {error}"[:2000]
    seconds = _processor_time() - before
    # Of this process counts what it took on top: it may hold a suite of tests.
    memory = max(
        _most_memory("self") - own, *(_most_memory(i.process.pid) for i in isolated._kept), 0.0
    )
    # Of readers that ended the system gives the largest only, with what they were forked from.
    if (ended := _ended_readers()) > max(ended_before, _most_memory("self")):
        memory = max(memory, ended)
    if len(said.splitlines()) > 1 or len(said) > LONGEST_MESSAGE:
        fault = f"not one line: {said[:2000]!r}"
    elif seconds > MOST_SECONDS or memory > MOST_MEMORY:
        fault = f"took {seconds:.1f} s and {memory:.0f} MB"
    record: Record = {"outcome": outcome, "seconds": round(seconds, 3), "memory": round(memory)}
    return record | ({"outcome": "fault", "text": f"{path.name}, {what}: {fault}"} if fault else {})


def _ended_readers() -> float:
    return resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024


def _processor_time() -> float:
    """Return the processor time of this process and all readers [s]."""
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    running = 0.0
    for item in isolated._kept:
        fields = Path(f"/proc/{item.process.pid}/stat").read_text().rpartition(")")[2].split()
        running += (int(fields[11]) + int(fields[12])) / 100
    return sum(item.ru_utime + item.ru_stime for item in used) + running


def _drop_memory(pid: int | str) -> None:
    """Let the system count the largest memory of a process again."""
    Path(f"/proc/{pid}/clear_refs").write_text("5")


def _most_memory(pid: int | str) -> float:
    lines = Path(f"/proc/{pid}/status").read_text(encoding="ascii").splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith("VmHWM:")) / 1024
