"""Keep what was made for some keys, the latest used of them."""

from collections import OrderedDict
from collections.abc import Hashable
from threading import Lock
from typing import Generic, TypeVar

V = TypeVar("V")


class LRUCache(Generic[V]):
    """Values by key, of which the latest used stay; several threads may ask at once.

    Parameters
    ----------
    most : int
        So many are kept.

    Examples
    --------
    >>> kept = LRUCache[str](2)
    >>> kept.put("a", "one"), kept.put("b", "two"), kept.get("a"), kept.put("c", "three")
    ('one', 'two', 'one', 'three')
    >>> kept.get("b") is None
    True
    """

    def __init__(self, most: int) -> None:
        self._most = most
        self._kept: OrderedDict[Hashable, V] = OrderedDict()
        self._lock = Lock()

    def get(self, key: Hashable) -> V | None:
        """Return what is kept for a key; None where nothing is."""
        with self._lock:
            found = self._kept.get(key)
            if found is not None:
                self._kept.move_to_end(key)
            return found

    def put(self, key: Hashable, value: V) -> V:
        """Keep a value, and return it."""
        with self._lock:
            self._kept[key] = value
            self._kept.move_to_end(key)
            while len(self._kept) > self._most:
                self._kept.popitem(last=False)
            return value

    def clear(self) -> None:
        """Forget everything."""
        with self._lock:
            self._kept.clear()
