"""Caches of the values used last, safe to share between threads."""

from collections import OrderedDict
from collections.abc import Callable, Hashable, Sequence
from threading import Lock
from typing import Generic, TypeVar

V = TypeVar("V")


class LRUCache(Generic[V]):
    """Values by key, of which the least recently used are dropped; safe to share between threads.

    Parameters
    ----------
    most : int
        Largest number of values.

    Examples
    --------
    >>> cache = LRUCache[str](2)
    >>> cache.put("a", "one"), cache.put("b", "two"), cache.get("a"), cache.put("c", "three")
    ('one', 'two', 'one', 'three')
    >>> cache.get("b") is None
    True
    """

    def __init__(self, most: int) -> None:
        self._most = most
        self._values: OrderedDict[Hashable, V] = OrderedDict()
        self._lock = Lock()

    def get(self, key: Hashable) -> V | None:
        """Return the value of a key, or None."""
        with self._lock:
            found = self._values.get(key)
            if found is not None:
                self._values.move_to_end(key)
            return found

    def put(self, key: Hashable, value: V) -> V:
        """Store a value under a key, and return it."""
        with self._lock:
            self._values[key] = value
            self._values.move_to_end(key)
            while len(self._values) > self._most:
                self._values.popitem(last=False)
            return value

    def pop(self, key: Hashable) -> V | None:
        """Remove a key and return its value, or None."""
        with self._lock:
            return self._values.pop(key, None)

    def clear(self) -> None:
        """Drop all values."""
        with self._lock:
            self._values.clear()


class SharedResults(Generic[V]):
    """Results by what they follow from, of which the least recently used are dropped.

    Throws share the objects that their overrides leave as they are. Large ones are known by
    identity, and kept beside the result so that nothing else takes their place.

    Parameters
    ----------
    most : int
        Largest number of results.

    Examples
    --------
    >>> rows, sums = [1.0, 2.0], SharedResults[float](8)
    >>> sums.get([rows], ["sum"], lambda: sum(rows))
    3.0
    """

    def __init__(self, most: int) -> None:
        self._kept = LRUCache[tuple[V, Sequence[object]]](most)
        self.clear = self._kept.clear

    def get(self, named: Sequence[object], values: Sequence[Hashable], make: Callable[[], V]) -> V:
        """Return the result for the same objects and equal values.

        Parameters
        ----------
        named : sequence of object
            Objects that nobody changes any more.
        values : sequence of hashable
            All else that the result follows from.
        make : callable
            Makes it.
        """
        key = (*map(id, named), *values)
        kept = self._kept.get(key)
        if kept is None:
            kept = self._kept.put(key, (make(), named))
        return kept[0]
