"""The datasets of an HDF5 file from elsewhere, each met once, declared before it is read.

Such a file can refer to any other file of the machine (external links and storage, virtual
datasets), link groups in circles, and declare shapes that nothing fills.
"""

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import h5py

from turnout.errors import FileError
from turnout.measurement.extent import MOST_CHANNELS, Declared

LARGEST_DEPTH = 50


class Content:
    """What an HDF5 file holds.

    Parameters
    ----------
    path : Path
        The file.
    file : h5py.File
        Opened.
    allow_outside : bool
        Whether it may refer to other files.

    Attributes
    ----------
    problems : list of str
        Links that lead nowhere.
    """

    def __init__(self, path: Path, file: h5py.File, *, allow_outside: bool) -> None:
        self.problems: list[str] = []
        self._path, self._file, self._allow_outside = path, file, allow_outside
        self._declared = Declared(path)
        self._seen: set[Any] = set()

    def datasets(self) -> Iterator[tuple[str, h5py.Dataset]]:
        """Yield each dataset with its path in the file."""
        yield from self._within(self._file, "", 0)

    def _within(
        self, group: h5py.Group, prefix: str, depth: int
    ) -> Iterator[tuple[str, h5py.Dataset]]:
        if depth > LARGEST_DEPTH:
            message = f"{self._path}: its groups are nested deeper than {LARGEST_DEPTH}"
            raise FileError(message + "; save it again, flatter")
        for name, item in self.members(group, prefix):
            if isinstance(item, h5py.Group):
                yield from self._within(item, f"{name}/", depth + 1)
            elif isinstance(item, h5py.Dataset):
                yield name, item

    def members(self, group: h5py.Group, prefix: str = "") -> Iterator[tuple[str, Any]]:
        """Yield what a group holds and no group before it held, with its path in the file."""
        for key in group:
            name = f"{prefix}{key}"
            link = group.get(key, getlink=True)
            if isinstance(link, h5py.ExternalLink) and not self._allow_outside:
                raise FileError(self._outside(name, "is a link to", link.filename))
            item = group.get(key)
            if item is None:
                self.problems.append(f"'{name}' is left out: its link leads nowhere")
                continue
            place = h5py.h5o.get_info(item.id)
            if (place.fileno, place.addr) in self._seen:
                continue
            self._seen.add((place.fileno, place.addr))
            if len(self._seen) > MOST_CHANNELS:
                message = f"{self._path}: holds more than {MOST_CHANNELS} groups and datasets"
                raise FileError(message + "; export fewer channels")
            yield name, item

    def read(self, item: h5py.Dataset) -> Any:
        """Return the samples of a dataset, unless they are too many or in another file.

        Raises
        ------
        FileError
            Saying which.
        """
        name = (item.name or "").lstrip("/")
        if not self._allow_outside:
            if item.external:
                raise FileError(self._outside(name, "takes its samples from", item.external[0][0]))
            others = [s.file_name for s in item.virtual_sources()] if item.is_virtual else []
            other = next((file for file in others if file != "."), None)
            if other is not None:
                raise FileError(self._outside(name, "takes its samples from", other))
        # A chunk is read as a whole, however little of it the dataset needs.
        self._declared.add(max(item.size or 0, math.prod(item.chunks or (0,)), 1))
        return item[()]

    def _outside(self, name: str, what: str, other: str) -> str:
        return (
            f"{self._path}: '{name}' {what} another file ({other}), which is not read; export it "
            "into one file, or permit it by --allow-outside (in Python allow_outside=True)"
        )
