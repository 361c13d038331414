"""Records of arrays that kernels take by reference.

A kernel that takes a named tuple of arrays by value gets every pointer and every length of it on
each call, hundreds of numbers, which costs more than what a small kernel does. `shared_record` lays
these numbers down in memory once and hands kernels the address alone. In Python as in a kernel the
arrays are read as attributes of the same names; which arrays they are can no longer be changed,
what is in them can. What reading one is in machine code is in `turnout.kernels.record_code`.
"""

import itertools
from collections.abc import Mapping
from functools import cache, lru_cache
from typing import Any, NamedTuple, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from turnout.kernels.lanes import address_of, empty_in_lines, whole_lines

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
    """

    def __init__(self, record: str, fields: tuple[tuple[str, str, int], ...]) -> None:
        self.record, self.fields = record, fields
        starts = itertools.accumulate((1 + ndim for *_, ndim in fields), initial=0)
        self.word_of = {name: word for (name, *_), word in zip(fields, starts, strict=False)}

    def __str__(self) -> str:
        """Return all that a kernel knows of the record."""
        kinds = ", ".join(f"{name}: {kind}{ndim}" for name, kind, ndim in self.fields)
        return f"Shared({self.record}: {kinds})"


class Shared:
    """A named tuple of arrays with its address; made by `shared_record` and `clone_record`.

    Vectors are pieces of one `memory`; `vectors` holds start, size and dtype of each. `words` are
    the address and the lengths of each array, which kernels read. `arrays` caches the arrays that
    have been requested.
    """

    __slots__ = ("address", "arrays", "kind", "memory", "vectors", "words")

    def __init__(
        self,
        kind: RecordKind,
        memory: NDArray[np.float64],
        vectors: Mapping[str, tuple[int, int, np.dtype[Any]]],
        words: NDArray[np.int64],
    ) -> None:
        self.kind, self.memory, self.vectors, self.words = kind, memory, vectors, words
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
            if name not in self.vectors:
                raise AttributeError(name)
            start, size, dtype = self.vectors[name]
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
        If something in it is not a contiguous array of such numbers.

    Examples
    --------
    >>> import numpy as np
    >>> from turnout.law.table import LawTableBuilder
    >>> builder = LawTableBuilder()
    >>> law = builder.add_contact(0, stiffness=2.0, clearance=0.5)
    >>> shared_record(builder.table()).offset.tolist()
    [0.5]
    """
    shapes = []
    for name, array in zip(arrays._fields, arrays, strict=True):
        if not (isinstance(array, np.ndarray) and array.flags.c_contiguous and array.itemsize == 8):
            msg = f"{type(arrays).__name__}.{name} must be an array of 8-byte numbers without gaps"
            raise TypeError(msg)
        shapes.append((array.dtype, array.shape))
    layout = _layout(type(arrays), tuple(shapes), tuple(beyond.items()))
    memory = empty_in_lines(layout.size)
    pieces: list[NDArray[np.float64]] = []
    for at, padding in layout.pieces:
        array = arrays[at]
        pieces.append(array if array.dtype == np.float64 else array.view(np.float64))
        if padding is not None:
            pieces.append(padding)
    if pieces:
        np.concatenate(pieces, out=memory)
    record = Shared(layout.kind, memory, layout.vectors, layout.words.copy())
    record.words[layout.of_vectors] += address_of(memory)
    for at, name, word in layout.matrices:
        array = record.arrays[name] = arrays[at]
        record.words[word] = address_of(array)
    return cast("T", record)


class _Layout(NamedTuple):
    """Where the vectors of a record lie in its memory.

    `words` have the place of each vector in bytes, at `of_vectors`, in place of its address;
    `pieces` are the number of each vector that is not empty and what follows it in memory, None for
    nothing; `matrices` number, name and word of each array of more dimensions; `size` that of all.
    """

    kind: RecordKind
    vectors: Mapping[str, tuple[int, int, np.dtype[Any]]]
    words: NDArray[np.int64]
    of_vectors: NDArray[np.int64]
    pieces: tuple[tuple[int, NDArray[np.float64] | None], ...]
    matrices: tuple[tuple[int, str, int], ...]
    size: int


@lru_cache(maxsize=256)
def _layout(
    record: Any,
    shapes: tuple[tuple[np.dtype[Any], tuple[int, ...]], ...],
    beyond: tuple[tuple[str, float], ...],
) -> _Layout:
    """Lay out a record of arrays of these kinds and shapes; records of throws are mostly alike."""
    kind = _shared_type(record, tuple([(dtype.str, len(shape)) for dtype, shape in shapes]))
    vectors: dict[str, tuple[int, int, np.dtype[Any]]] = {}
    words, pieces, matrices, at, fills = list[int](), [], [], 0, dict(beyond)
    for number, (name, (dtype, shape)) in enumerate(zip(record._fields, shapes, strict=True)):
        words += [8 * at if len(shape) == 1 else 0, *shape]
        if len(shape) != 1:
            matrices.append((number, name, kind.word_of[name]))
            continue
        vectors[name] = (at, shape[0], dtype)
        count = whole_lines(shape[0]) - shape[0]
        at += shape[0] + count
        if shape[0]:
            padding = np.full(count, fills.get(name, 0.0)) if count else None
            pieces.append((number, padding))
    of_vectors = np.array([kind.word_of[name] for name in vectors], dtype=np.int64)
    found = np.array(words, dtype=np.int64)
    return _Layout(kind, vectors, found, of_vectors, tuple(pieces), tuple(matrices), at)


def clone_record(record: T, **matrices: NDArray[Any]) -> T:
    """Return a record of the same content with vectors of its own.

    Parameters
    ----------
    record : named tuple of ndarray
        Made by `shared_record`.
    **matrices : ndarray
        All its arrays of more dimensions, of the same shapes.

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
    given = cast("Shared", record)
    if matrices.keys() != given.kind.word_of.keys() - given.vectors.keys():
        msg = f"clone_record({given.kind.record}): pass every matrix, no vector"
        raise TypeError(msg)
    words = given.words.copy()
    found = Shared(given.kind, empty_in_lines(given.memory.size), given.vectors, words)
    found.memory[:] = given.memory
    moved = address_of(found.memory) - address_of(given.memory)
    words[[given.kind.word_of[name] for name in given.vectors]] += moved
    for name, array in matrices.items():
        found.arrays[name] = array
        words[given.kind.word_of[name]] = address_of(array)
    return cast("T", found)


def copy_vectors(record: T, to: T) -> None:
    """Copy the vectors of a record into those of another one of its kind, which was cloned from it.

    Examples
    --------
    >>> from turnout.law.table import LawTableBuilder
    >>> first = shared_record(LawTableBuilder().table())
    >>> second = clone_record(first)
    >>> second.segment_start[0] = 7
    >>> copy_vectors(first, second)
    >>> second.segment_start.tolist()
    [0]
    """
    cast("Shared", to).memory[:] = cast("Shared", record).memory
