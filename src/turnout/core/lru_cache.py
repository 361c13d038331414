"""A cache of the values used last, safe to share between threads."""

from collections import OrderedDict
from collections.abc import Hashable
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
