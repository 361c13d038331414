"""Records of arrays that kernels take by reference.

A kernel that takes a named tuple of arrays by value gets every pointer and every length of it on
each call, hundreds of numbers, which costs more than what a small kernel does. `shared_record` lays
these numbers down in memory once and hands kernels the address alone. In Python as in a kernel the
arrays are read as attributes of the same names; which arrays they are can no longer be changed,
what is in them can. What reading one is in machine code is in `turnout.kernels.record_code`.
"""

import itertools
from collections.abc import Mapping
from ctypes import addressof, c_char
from functools import cache, lru_cache
from typing import Any, NamedTuple, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from turnout.kernels.lanes import empty_in_lines, whole_lines

T = TypeVar("T", bound=NamedTuple)


class RecordKind:
    """Names, dtypes and numbers of dimensions of the arrays of a record; one object for each.

    Attributes
    ----------
    record : str
        Name of the class of the named tuple.
    fields : tuple of (str, str, int)
        Name, dtype and number of dimensions of each array.
    word_of : dict of str to int
        Index of the word with the address of an array; its shape follows.
    of_vectors : ndarray of int
        These indices of the vectors.
    matrices : set of str
        Names of the arrays of more dimensions.
    """

    def __init__(self, record: str, fields: tuple[tuple[str, str, int], ...]) -> None:
        self.record, self.fields = record, fields
        starts = itertools.accumulate((1 + ndim for *_, ndim in fields), initial=0)
        self.word_of = {name: word for (name, *_), word in zip(fields, starts, strict=False)}
        vectors = [self.word_of[name] for name, _, ndim in fields if ndim == 1]
        self.of_vectors = np.array(vectors, dtype=np.int64)
        self.matrices = frozenset(name for name, _, ndim in fields if ndim != 1)

    def __str__(self) -> str:
        """Return all that a kernel knows of the record."""
        kinds = ", ".join(f"{name}: {kind}{ndim}" for name, kind, ndim in self.fields)
        return f"Shared({self.record}: {kinds})"


class SharedRecord:
    """A named tuple of arrays with its address; made by `shared_record` and `clone_record`.

    Vectors are pieces of one `memory`; `layout` says which. `words` are the address and the lengths
    of each array, which kernels read. `arrays` caches the arrays that have been requested.
    """

    __slots__ = ("address", "arrays", "kind", "layout", "memory", "words")

    def __init__(
        self, layout: "_Layout", memory: NDArray[np.float64], words: NDArray[np.int64]
    ) -> None:
        self.kind, self.layout, self.memory, self.words = layout.kind, layout, memory, words
        self.arrays: dict[str, NDArray[Any]] = {}
        self.address = address_of(words)

    def __reduce__(self) -> str:
        """Refuse to be copied or pickled: the address would be that of the original."""
        msg = f"a shared {self.kind.record} stays where it is in memory; copy its arrays"
        raise TypeError(msg)

    def __getattr__(self, name: str) -> Any:
        """Return one of the arrays."""
        found = self.arrays.get(name)
        if found is None:
            vectors = self.layout.vectors
            if name not in vectors:
                raise AttributeError(name)
            start, size, dtype = vectors[name]
            found = self.arrays[name] = self.memory[start : start + size].view(dtype)
        return found


@cache
def _shared_type(record: type[Any], arrays: tuple[tuple[str, int], ...]) -> RecordKind:
    named = zip(record._fields, arrays, strict=True)
    return RecordKind(record.__name__, tuple((name, *array) for name, array in named))


def shared_record(arrays: T, **beyond: float) -> T:
    """Return a named tuple of arrays as a record that kernels take by reference.

    Parameters
    ----------
    arrays : named tuple of ndarray
        Contiguous arrays of floats or integers, of 8 bytes each.
    **beyond : float
        Padding of a vector of floats up to the end of its cache line, by name; else zero.

    Returns
    -------
    named tuple of ndarray
        It has the attributes of `arrays` but is no tuple. Vectors are copies, which lie next to
        each other and fill whole cache lines (`turnout.kernels.lanes`); matrices are not copied.

    Raises
    ------
    TypeError
        If an array in it is not contiguous, or not one of such numbers.

    Examples
    --------
    >>> import numpy as np
    >>> from turnout.law.table import LawTableBuilder
    >>> builder = LawTableBuilder()
    >>> law = builder.add_contact(0, stiffness=2.0, clearance=0.5)
    >>> shared_record(builder.table()).offset.tolist()
    [0.5]
    """
    shapes = tuple([(array.dtype, array.shape, array.flags.c_contiguous) for array in arrays])
    return _filled(_layout(type(arrays), shapes, tuple(beyond.items())), arrays)


def record_like(record: T, arrays: T) -> T:
    """Return a record of a named tuple with arrays of the same kinds and shapes as another one.

    It takes half the time of `shared_record`, which looks at each of them; nothing is checked.

    Examples
    --------
    >>> from turnout.law.table import LawTableBuilder
    >>> arrays = LawTableBuilder().table()
    >>> record_like(shared_record(arrays), arrays).segment_start.tolist()
    [0]
    """
    return _filled(cast("SharedRecord", record).layout, arrays)


def _filled(layout: "_Layout", arrays: T) -> T:
    memory = empty_in_lines(layout.size)
    pieces: list[NDArray[np.float64]] = []
    for at, as_floats, padding in layout.pieces:
        array = arrays[at]
        pieces.append(array.view(np.float64) if as_floats else array)
        if padding is not None:
            pieces.append(padding)
    if pieces:
        np.concatenate(pieces, out=memory)
    record = SharedRecord(layout, memory, layout.words.copy())
    record.words[layout.kind.of_vectors] += address_of(memory)
    for at, name, word in layout.matrices:
        array = record.arrays[name] = arrays[at]
        record.words[word] = address_of(array)
    return cast("T", record)


def address_of(array: NDArray[Any]) -> int:
    """Return the address of an array's first number; ``ctypes.data`` takes 0.5 us more."""
    if array.size:
        if array.flags.carray:
            return addressof(c_char.from_buffer(array.data))
        if array.ndim > 1:  # where its first row lies, which mostly has no gaps
            return address_of(array[0])
    return int(array.ctypes.data)


class _Layout(NamedTuple):
    """Places of the vectors of a record in its memory.

    `vectors` are start, size and dtype of each; `words` hold its offset in bytes where a record has
    its address. `pieces` are the number of each vector that is not empty, whether it is viewed as
    floats, and what follows it in memory, None for nothing; `matrices` number, name and word of
    each array of more dimensions; `size` that of all.
    """

    kind: RecordKind
    vectors: Mapping[str, tuple[int, int, np.dtype[Any]]]
    words: NDArray[np.int64]
    pieces: tuple[tuple[int, bool, NDArray[np.float64] | None], ...]
    matrices: tuple[tuple[int, str, int], ...]
    size: int


@lru_cache(maxsize=256)
def _layout(
    record: Any,
    shapes: tuple[tuple[np.dtype[Any], tuple[int, ...], bool], ...],
    beyond: tuple[tuple[str, float], ...],
) -> _Layout:
    """Lay out a record of arrays of these kinds and shapes; records of throws are mostly alike."""
    for name, (dtype, _, contiguous) in zip(record._fields, shapes, strict=True):
        if not contiguous or dtype.itemsize != 8:
            msg = f"{record.__name__}.{name} must be an array of 8-byte numbers without gaps"
            raise TypeError(msg)
    kind = _shared_type(record, tuple([(dtype.str, len(shape)) for dtype, shape, _ in shapes]))
    vectors: dict[str, tuple[int, int, np.dtype[Any]]] = {}
    words, pieces, matrices, at, fills = list[int](), [], [], 0, dict(beyond)
    named = zip(record._fields, shapes, strict=True)
    for number, (name, (dtype, shape, _)) in enumerate(named):
        words += [8 * at if len(shape) == 1 else 0, *shape]
        if len(shape) != 1:
            matrices.append((number, name, kind.word_of[name]))
            continue
        vectors[name] = (at, shape[0], dtype)
        count = whole_lines(shape[0]) - shape[0]
        at += shape[0] + count
        if shape[0]:
            padding = np.full(count, fills.get(name, 0.0)) if count else None
            pieces.append((number, dtype != np.float64, padding))
    found = np.array(words, dtype=np.int64)
    return _Layout(kind, vectors, found, tuple(pieces), tuple(matrices), at)


def clone_record(record: T, **matrices: NDArray[Any]) -> T:
    """Return a record of the same content with vectors of its own.

    Parameters
    ----------
    record : named tuple of ndarray
        Made by `shared_record`.
    **matrices : ndarray
        Its arrays of more dimensions, the same ones or others, which may have other shapes; only
        empty ones may be left out.

    Returns
    -------
    named tuple of ndarray
        As of `shared_record`.

    Examples
    --------
    >>> from typing import NamedTuple
    >>> import numpy as np
    >>> class Pair(NamedTuple):
    ...     left: np.ndarray
    ...     right: np.ndarray
    >>> first = shared_record(Pair(np.arange(3.0), np.ones((2, 2))))
    >>> second = clone_record(first, right=np.zeros((2, 2)))
    >>> second.left[0] = 5.0
    >>> first.left.tolist(), second.left.tolist(), float(second.right.sum())
    ([0.0, 1.0, 2.0], [5.0, 1.0, 2.0], 0.0)
    """
    given = cast("SharedRecord", record)
    kind, shared = given.kind, given.kind.matrices - matrices.keys()
    if any(given.arrays[name].size for name in shared) or not kind.matrices >= matrices.keys():
        msg = f"clone_record({kind.record}): pass every matrix, no vector"
        raise TypeError(msg)
    words = given.words.copy()
    found = SharedRecord(given.layout, empty_in_lines(given.memory.size), words)
    found.memory[:] = given.memory
    words[kind.of_vectors] += address_of(found.memory) - address_of(given.memory)
    for name in shared:
        found.arrays[name] = given.arrays[name]
    for name, array in matrices.items():
        found.arrays[name] = array
        if array is given.arrays[name]:
            continue
        word = kind.word_of[name]
        words[word] = address_of(array)
        for axis, length in enumerate(array.shape, start=1):
            words[word + axis] = length
    return cast("T", found)
