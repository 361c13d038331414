"""Recordings that someone made to harm their readers: small files that demand much.

Each function writes one file; `HOSTILE` names them all.
"""

import io
import struct
import zlib
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest
from scipy.io import savemat

Writer = Callable[[Path], None]
HUGE = 200_000_000
ROD = np.sin(np.arange(500) / 50)


def filled(path: Path, *, dtype: str = "float64", count: int = HUGE, parts: int = 1) -> None:
    """Declare datasets that only a fill value fills."""
    with h5py.File(path, "w") as file:
        for number in range(parts):
            item = file.create_dataset(
                f"rod {number}", shape=(count // parts,), dtype=dtype, fillvalue=1, chunks=(1000,)
            )
            item.attrs["rate"] = 1000.0


def compressed(path: Path, *, filters: str = "gzip") -> None:
    """Hold zeros that compress a thousandfold and more."""
    count = 50_000_000
    with h5py.File(path, "w") as file:
        item = file.create_dataset(
            "rod", shape=(HUGE,), dtype="int8", chunks=(count,), compression=filters
        )
        item[:count] = 0
        packed = item.id.read_direct_chunk((0,))[1]
        for at in range(count, HUGE, count):
            item.id.write_direct_chunk((at,), packed)
        item.attrs["rate"] = 1000.0


def large_chunk(path: Path) -> None:
    """Hold ten samples in a chunk of 1.6 GB that is never filled."""
    with h5py.File(path, "w") as file:
        item = file.create_dataset(
            "rod", shape=(10,), maxshape=(None,), dtype="float64", chunks=(HUGE,), fillvalue=2
        )
        item.attrs["rate"] = 1000.0


def wide(path: Path) -> None:
    with h5py.File(path, "w") as file:
        file.create_dataset("table", shape=(HUGE // 200, 200), dtype="float64", fillvalue=1)
        file.attrs["rate"] = 1000.0


def names(path: Path) -> None:
    """Declare a list of 200 million names."""
    with h5py.File(path, "w") as file:
        file.create_dataset("names", shape=(HUGE,), dtype="S8", chunks=(1000,))
        file.create_dataset("rod", data=ROD).attrs["rate"] = 1000.0


def linked(path: Path) -> None:
    """Link one dataset a thousand times."""
    with h5py.File(path, "w") as file:
        item = file.create_dataset("rod", data=np.zeros(1_000_000, dtype="int8"), compression=9)
        item.attrs["rate"] = 1000.0
        for number in range(1000):
            file[f"rod {number}"] = item


def circle(path: Path) -> None:
    with h5py.File(path, "w") as file:
        group = file.create_group("a")
        group["a"] = group
        file.create_dataset("rod", data=np.zeros(0))


def doubled(path: Path) -> None:
    """Reach a last group by 2^40 ways."""
    with h5py.File(path, "w") as file:
        inner = file.create_group("last")
        for number in range(40):
            outer = file.create_group(f"level {number}")
            outer["one"] = inner
            outer["two"] = inner
            inner = outer


def nested(path: Path) -> None:
    with h5py.File(path, "w") as file:
        group: h5py.Group = file
        for _ in range(3000):
            group = group.create_group("a")


def groups(path: Path) -> None:
    with h5py.File(path, "w", libver="latest") as file:
        for number in range(15_000):
            file.create_group(f"{number}")


def virtual(path: Path) -> None:
    with h5py.File(path, "w") as file:
        file.create_dataset("small", data=np.zeros(10))
        layout = h5py.VirtualLayout(shape=(HUGE,), dtype="float64")
        layout[:10] = h5py.VirtualSource(".", "small", shape=(10,))
        file.create_virtual_dataset("rod", layout, fillvalue=3).attrs["rate"] = 1000.0


def mat73(path: Path, write: Writer) -> None:
    """Put the head of MATLAB 7.3 before an HDF5 file."""
    write(path)
    content = path.read_bytes()
    with h5py.File(path, "w", userblock_size=512) as file, h5py.File(io.BytesIO(content)) as old:
        for name in old:
            old.copy(name, file)
    with path.open("r+b") as raw:
        raw.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(512, b" "))


def cells_of_themselves(path: Path, *, ways: int = 2) -> None:
    """Let a cell array refer to itself."""
    with h5py.File(path, "w", userblock_size=512) as file:
        item = file.create_dataset("c", shape=(ways,), dtype=h5py.ref_dtype)
        item.attrs["MATLAB_class"] = np.bytes_("cell")
        item[:] = [item.ref] * ways
    with path.open("r+b") as raw:
        raw.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(512, b" "))


def mat5_element(kind: int, content: bytes) -> bytes:
    return struct.pack("<II", kind, len(content)) + content + b"\0" * (-len(content) % 8)


def mat5_matrix(
    values: bytes, *, dims: tuple[int, ...], class_: int = 6, kind: int = 9, name: bytes = b"rod"
) -> bytes:
    head = mat5_element(6, struct.pack("<II", class_, 0))
    shape = mat5_element(5, struct.pack(f"<{len(dims)}i", *dims))
    return head + shape + mat5_element(1, name) + mat5_element(kind, values)


def mat5(path: Path, *elements: bytes) -> None:
    header = b"MATLAB 5.0 MAT-file".ljust(124, b" ") + b"\x00\x01IM"
    path.write_bytes(header + b"".join(elements))


def deflated(head: bytes, zeros: int) -> bytes:
    """Return what zlib makes of a head and many zeros, compressing the same block once only."""
    packer, block = zlib.compressobj(9, wbits=-zlib.MAX_WBITS), bytes(8_000_000)
    first = packer.compress(head) + packer.flush(zlib.Z_FULL_FLUSH)
    again = packer.compress(block) + packer.flush(zlib.Z_FULL_FLUSH)
    count, checksum = zeros // len(block), zlib.adler32(head)
    for _ in range(count):
        checksum = zlib.adler32(block, checksum)
    return b"\x78\xda" + first + again * count + packer.flush() + struct.pack(">I", checksum)


def mat5_compressed(path: Path, *, parts: int = 1) -> None:
    """Hold gigabytes of zeros in megabytes or less."""
    count = HUGE // parts
    head = mat5_matrix(b"", dims=(count, 1))[:-8] + struct.pack("<II", 9, 8 * count)
    content = deflated(struct.pack("<II", 14, len(head) + 8 * count) + head, 8 * count)
    mat5(path, *[struct.pack("<II", 15, len(content)) + content] * parts)


def mat5_lying(path: Path) -> None:
    """Declare a small variable whose compressed content is large."""
    head = mat5_matrix(b"", dims=(3, 1))[:-8] + struct.pack("<II", 9, 24)
    content = deflated(struct.pack("<II", 14, len(head) + 24) + head, 8 * HUGE)
    mat5(path, struct.pack("<II", 15, len(content)) + content)


def mat5_cells(path: Path, *, class_: int = 1, count: int = 2**31 - 1) -> None:
    head = mat5_element(6, struct.pack("<II", class_, 0))
    shape = mat5_element(5, struct.pack("<2i", count, 1))
    names = mat5_element(5, struct.pack("<i", 8)) + mat5_element(1, b"a".ljust(8, b"\0"))
    content = head + shape + mat5_element(1, b"c") + (names if class_ == 2 else b"")
    mat5(path, mat5_element(14, content))


def mat5_large(path: Path, *, compressed: bool) -> None:
    """Declare more numbers than there are bytes."""
    plain = mat5_element(14, mat5_matrix(ROD.tobytes(), dims=(2**30, 1)))
    packed = zlib.compress(plain)
    mat5(path, struct.pack("<II", 15, len(packed)) + packed if compressed else plain)


def mat5_nested(path: Path) -> None:
    content = mat5_matrix(ROD.tobytes(), dims=(ROD.size, 1))
    for _ in range(3000):
        head = mat5_element(6, struct.pack("<II", 1, 0)) + mat5_element(5, struct.pack("<2i", 1, 1))
        content = head + mat5_element(1, b"c") + mat5_element(14, content)
    mat5(path, mat5_element(14, content))


def mat5_sparse(path: Path) -> None:
    head = mat5_element(6, struct.pack("<II", 5, 2**31 - 1))
    shape = mat5_element(5, struct.pack("<2i", 2**31 - 1, 2**31 - 1))
    rows = mat5_element(5, struct.pack("<2i", 0, 1)) * 2 + mat5_element(9, ROD[:2].tobytes())
    mat5(path, mat5_element(14, head + shape + mat5_element(1, b"s") + rows))


def mat4(path: Path) -> None:
    """Declare a matrix of version 4 with 2^60 numbers."""
    path.write_bytes(struct.pack("<5i", 0, 2**30, 2**30, 0, 4) + b"rod\0" + ROD.tobytes())


def mat_bomb_of_names(path: Path) -> None:
    savemat(path, {f"c{i}": np.zeros(3) for i in range(12_000)})


def parquet(path: Path, *, strings: bool = False, columns: int = 1) -> None:
    """Hold one value 100 million times: run lengths and a dictionary need no room."""
    pa = pytest.importorskip("pyarrow", reason="the extra parquet is not installed")
    import pyarrow.parquet as pq

    count = 2_000_000 if strings else HUGE // 2 // columns
    value = "x" * 1000 if strings else 1.0
    part = pa.table({f"rod {i}": pa.repeat(value, count // 20) for i in range(columns)})
    with pq.ParquetWriter(path, part.schema, use_dictionary=True, compression="zstd") as file:
        for _ in range(20):
            file.write_table(part)


def tdms(path: Path, *, count: int = HUGE) -> None:
    """Declare many more samples than follow."""
    nptdms = pytest.importorskip("nptdms", reason="the extra daq is not installed")
    reported = {"wf_increment": 0.001}
    with nptdms.TdmsWriter(path) as file:
        file.write_segment([nptdms.ChannelObject("Throw", "rod", ROD, reported)])
    content = path.read_bytes()
    old, new = struct.pack("<Q", ROD.size), struct.pack("<Q", count)
    assert old in content
    path.write_bytes(content.replace(old, new, 1))


def mdf(path: Path, *, cycles: int = HUGE) -> None:
    """Declare more cycles than are recorded."""
    asammdf = pytest.importorskip("asammdf", reason="the extra daq is not installed")
    signal = asammdf.Signal(ROD, np.arange(ROD.size) / 1000, name="rod")
    with asammdf.MDF() as file:
        file.append([signal])
        file.save(path, overwrite=True, compression=2)
    content = path.read_bytes()
    old, new = struct.pack("<Q", ROD.size), struct.pack("<Q", cycles)
    path.write_bytes(content.replace(old, new))


def csv(path: Path, text: str) -> None:
    path.write_text(text, encoding="utf-8")


HOSTILE: dict[str, tuple[str, Writer]] = {
    "filled": (".h5", filled),
    "filled float32": (".h5", lambda p: filled(p, dtype="float32")),
    "filled int8": (".h5", lambda p: filled(p, dtype="int8")),
    "filled beyond any memory": (".h5", lambda p: filled(p, count=10**15)),
    "filled in parts": (".h5", lambda p: filled(p, parts=50)),
    "filled, called netCDF": (".nc", filled),
    "compressed": (".h5", compressed),
    "compressed by lzf": (".h5", lambda p: compressed(p, filters="lzf")),
    "large chunk": (".h5", large_chunk),
    "wide table": (".h5", wide),
    "many names": (".h5", names),
    "links to one": (".h5", linked),
    "circle": (".h5", circle),
    "doubled": (".h5", doubled),
    "nested": (".h5", nested),
    "groups": (".h5", groups),
    "virtual": (".h5", virtual),
    "7.3 filled": (".mat", lambda p: mat73(p, filled)),
    "7.3 in parts": (".mat", lambda p: mat73(p, lambda q: filled(q, parts=50))),
    "7.3 beyond any memory": (".mat", lambda p: mat73(p, lambda q: filled(q, count=10**15))),
    "7.3 circle": (".mat", lambda p: mat73(p, circle)),
    "7.3 doubled": (".mat", lambda p: mat73(p, doubled)),
    "7.3 large chunk": (".mat", lambda p: mat73(p, large_chunk)),
    "7.3 cell of itself": (".mat", cells_of_themselves),
    "7.3 cell of itself, wide": (".mat", lambda p: cells_of_themselves(p, ways=2000)),
    "5 compressed": (".mat", mat5_compressed),
    "5 compressed in parts": (".mat", lambda p: mat5_compressed(p, parts=20)),
    "5 lying": (".mat", mat5_lying),
    "5 cells": (".mat", mat5_cells),
    "5 fewer cells": (".mat", lambda p: mat5_cells(p, count=100_000_000)),
    "5 structures": (".mat", lambda p: mat5_cells(p, class_=2)),
    "5 objects": (".mat", lambda p: mat5_cells(p, class_=3)),
    "5 larger than it is": (".mat", lambda p: mat5_large(p, compressed=False)),
    "5 larger, compressed": (".mat", lambda p: mat5_large(p, compressed=True)),
    "5 nested": (".mat", mat5_nested),
    "5 sparse": (".mat", mat5_sparse),
    "4 larger than it is": (".mat", mat4),
    "5 many variables": (".mat", mat_bomb_of_names),
    "parquet": (".parquet", parquet),
    "parquet in columns": (".parquet", lambda p: parquet(p, columns=20)),
    "parquet of texts": (".parquet", lambda p: parquet(p, strings=True)),
    "tdms": (".tdms", tdms),
    "tdms beyond any memory": (".tdms", lambda p: tdms(p, count=2**50)),
    "mdf": (".mf4", mdf),
    "mdf beyond any memory": (".mf4", lambda p: mdf(p, cycles=2**50)),
    "columns": (".csv", lambda p: csv(p, ("1," * 60_000 + "1\n") * 3)),
    "columns of one name": (
        ".csv",
        lambda p: csv(p, "t" + ",rod" * 9000 + "\n" + "".join(f"{i}{',1' * 9000}\n" for i in "12")),
    ),
    "long cell": (".csv", lambda p: csv(p, "t,rod\n0,1\n1,2\n2," + "9" * 3_000_000 + "\n")),
    "long name": (".csv", lambda p: csv(p, "t," + "r" * 190_000 + "\n0,1\n1,2\n2,3\n")),
    "quotation": (".csv", lambda p: csv(p, 't,rod\n0,1\n1,"' + "2\n" * 500_000)),
    "jump in time": (".csv", lambda p: csv(p, "t,rod\n0,1\n1e-9,2\n2e-9,3\n1e9,4\n2e9,5\n")),
    "text called gzip": (".csv.gz", lambda p: csv(p, "t,rod\n0,1\n1,2\n2,3\n")),
}
