"""One cause that a model may not follow a measurement: its sizes, and what it does to forces."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from turnout.calibration.drive_law.candidates import Law, Shape
from turnout.calibration.parameter import Parameter

# Causes of which several may be, such as one a drive.
SEVERAL = ("bushing shape", "clutch", "drive law", "objects")
Beside = Callable[[Mapping[str, float], Sequence[float]], dict[str, float]]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Cause:
    """One thing that may differ between model and measurement.

    Attributes
    ----------
    name : str
        What it is called, such as "recorder filter".
    text : callable
        From its sizes to a sentence.
    parameters : tuple of Parameter
        Its size, or several with priors that describe it together; none where each movement has
        its own.
    tries : tuple of float
        Sizes that are tried: of a smooth cause one of each parameter, each alone; else of its first
        parameter, the others at their start.
    group : str
        Of causes much alike in what they do to forces: a fit with each decides between them.
    refined : bool
        Whether the likeliest size is searched between those that are tried: where that needs no
        throws, so that causes alike in effect are compared at their best.
    smooth : bool
        Whether forces change in proportion to it: then one size is tried, and the likeliest
        follows with those of all values.
    least : float
        What is smaller is none: a fit that lacks another cause finds some of every one [as sizes].
    about_mean : bool
        Whether only differences of its sizes from their mean count.
    drives : tuple of str
        Drives whose law it changes; another cause that changes one of them too is not taken up.
    beside : callable, optional
        From values and sizes to the values that keep forces much as they are with the cause: where
        a trial, and a fit with it, begin.
    law, shape : callable or None
        As of `Misfit`.
    scatter : mapping of str to float
        Parameters that scatter from movement to movement, as shares.
    """

    name: str
    text: Callable[[Sequence[float]], str]
    parameters: tuple[Parameter, ...] = ()
    tries: tuple[float, ...] = ()
    group: str = ""
    refined: bool = False
    smooth: bool = False
    least: float = 0.0
    about_mean: bool = False
    drives: tuple[str, ...] = ()
    beside: Beside | None = None
    law: Law | None = None
    shape: Shape | None = None
    scatter: Mapping[str, float] = field(default_factory=dict)

    def sizes_in(self, values: Mapping[str, float]) -> tuple[float, ...]:
        """Return its sizes from the values of a fit by name."""
        return tuple(values[item.name] for item in self.parameters)

    def is_slight(self, sizes: Sequence[float]) -> bool:
        """Return whether all of its sizes are too small for it to be one."""
        # Where it is not smooth, its first parameter is its size.
        sized = self.parameters if self.smooth else self.parameters[:1]
        away = np.array([size - item.start for item, size in zip(sized, sizes, strict=False)])
        if self.about_mean:
            away = away - away.mean()
        return bool(away.size) and bool(np.all(np.abs(away) < self.least))

    def is_slight_in(self, values: Mapping[str, float]) -> bool:
        """Return whether the values of a fit by name make it too small to be one."""
        return self.is_slight(self.sizes_in(values))

    def goes_with(self, taken: "Cause") -> bool:
        """Return whether it may be taken up beside one that was."""
        if self is taken or set(self.drives) & set(taken.drives):
            return False
        return self.name != taken.name or self.name in SEVERAL
