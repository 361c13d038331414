"""Choice of the channels, instants and places that a response keeps."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, TypeVar

from turnout.core.channels import ON_REQUEST, unknown_channels
from turnout.core.errors import ResponseError

V = TypeVar("V")


@dataclass(frozen=True, slots=True, kw_only=True)
class Save:
    """Interval, stations and channels that a response keeps.

    Attributes
    ----------
    interval : float, optional
        Time between kept instants [s], which need not be steps; default that of the scheme.
    stations : tuple of float or "all", optional
        Places x of `gap` and `lateral_displacement` [m]; "all" for every node of the first rail;
        default the chairs and drives.
    fields : tuple of str, optional
        Channels to keep; default all but those that are made only on request.
    also : tuple of str
        Channels to keep besides, such as ``("fastening_force",)``.

    Examples
    --------
    >>> Save(interval=0.01, fields=("drive_force", "object_force")).interval
    0.01
    """

    interval: float | None = None
    stations: tuple[float, ...] | Literal["all"] | None = None
    fields: tuple[str, ...] | None = None
    also: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Refuse all impossible choices at once."""
        problems = []
        if isinstance(self.interval, str):
            problems.append(f"interval = {self.interval!r}: must be a number of seconds")
        elif self.interval is not None and not 0 < self.interval < float("inf"):
            problems.append(f"interval = {self.interval:g} s: must be positive")
        if isinstance(self.stations, str):
            if self.stations != "all":
                problems.append(f"stations = {self.stations!r}: allowed are places [m] or 'all'")
        elif self.stations is not None:
            rising = all(a < b for a, b in zip(self.stations, self.stations[1:], strict=False))
            if not self.stations or not rising:
                problems.append("stations: must be places in rising order")
        if isinstance(self.fields, str):
            problems.append(f"fields = {self.fields!r}: must be a tuple of channel names")
        elif self.fields is not None:
            problems += unknown_channels(self.fields)
        if isinstance(self.also, str):
            problems.append(f"also = {self.also!r}: must be a tuple of channel names")
        else:
            made = ", ".join(sorted(ON_REQUEST))
            problems += [f"{p}; made on request are {made}" for p in unknown_channels(self.also)]
        if problems:
            message = "save: " + "; ".join(problems)
            raise ResponseError(message)

    def keeps(self, *names: str) -> bool:
        """Return True if any of these channels is kept."""
        if self.fields is None and not ON_REQUEST.issuperset(names):
            return True
        return not set(names).isdisjoint((*(self.fields or ()), *self.also))

    def kept(self, channels: Mapping[str, V]) -> dict[str, V]:
        """Return those of some channels that are kept."""
        if self.fields is None:
            left_out = ON_REQUEST.difference(self.also)
            return {name: value for name, value in channels.items() if name not in left_out}
        return {name: value for name, value in channels.items() if self.keeps(name)}
