"""One throw of a study: its changes, its objects, and its labels."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from turnout.measurement.chain.recorder import Recorder
from turnout.panel.foreign_object import ForeignObject

Value = float | str | bool


@dataclass(frozen=True, slots=True, kw_only=True)
class Scenario:
    """One throw of a study, the same whatever was requested before it.

    Attributes
    ----------
    index : int
        Place in the study, from 0.
    name : str
        For people, such as "sleeper 6, 13 mm".
    overrides : mapping of str to float, str or bool
        Changes of the panel by key, in SI, as `LoadedPanel.with_overrides` takes them.
    foreign_objects : tuple of ForeignObject
        Trapped objects; none if the size is 0 or `object.present` is false.
    inputs : mapping of str to float, str or bool
        Values of the variables, by name: coordinates of the results. In SI; the same names in each
        scenario.
    condition : str
        Group that must stay together when data are split for training and test.
    seed : int
        Of whatever else is left to chance in this throw.
    recorder : Recorder
        Recorder of forces and currents.
    """

    index: int
    name: str
    overrides: Mapping[str, Value]
    foreign_objects: tuple[ForeignObject, ...]
    inputs: Mapping[str, Value]
    condition: str
    seed: int
    recorder: Recorder = field(default_factory=Recorder)


@dataclass(frozen=True, slots=True, kw_only=True)
class Rule:
    """Throws of a chain are made in their order until a drive slips.

    Attributes
    ----------
    variable : str
        Variable that grows along a chain.
    at_least : float
        Up to this value throws are made even if a drive slips, in SI.
    """

    variable: str
    at_least: float = 0.0

    def stops(self, labels: Mapping[str, object]) -> bool:
        """Return True if the rest of a chain is left out after a throw.

        Parameters
        ----------
        labels : mapping
            Of the throw: "slipped", whether a drive slipped in its last movement, and the inputs
            of its scenario.

        Examples
        --------
        >>> rule = Rule(variable="object.size", at_least=0.013)
        >>> rule.stops({"slipped": True, "object.size": 0.016})
        True
        >>> rule.stops({"slipped": True, "object.size": 0.010})
        False
        """
        reached = float(str(labels[self.variable])) >= self.at_least * (1 - 1e-9)
        return bool(labels["slipped"]) and reached


@dataclass(frozen=True, slots=True, kw_only=True)
class Output:
    """Channels and rate that a sweep keeps of each throw besides its labels.

    Attributes
    ----------
    rate : float
        Kept instants a second [Hz].
    channels : tuple of str
        Histories that are kept; none for labels alone.
    """

    rate: float = 100.0
    channels: tuple[str, ...] = (
        "drive_force",
        "drive_displacement",
        "drive_gap",
        "object_force",
        "sensor_gap",
    )

    @property
    def interval(self) -> float:
        """Time between kept instants [s]."""
        return 1.0 / self.rate


def split_into_chains(count: int, *, length: int) -> Sequence[range]:
    """Return the scenarios of each chain, in the order in which they are thrown.

    Parameters
    ----------
    count : int
        Scenarios in all.
    length : int
        Of a chain; 1 where no rule ends one.

    Examples
    --------
    >>> split_into_chains(4, length=2)
    (range(0, 2), range(2, 4))
    """
    return tuple(range(first, first + length) for first in range(0, count, length))
