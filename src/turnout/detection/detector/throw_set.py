"""Simulated throws as arrays: what a detector learns from and is judged on."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ThrowSet:
    """Throws of one plan, without noise; those that did not end are left out.

    Attributes
    ----------
    features, rates : ndarray, shape (n, n_features)
        [N], and their change with the onset of their movement [N/s].
    gaps : ndarray, shape (n, n_gaps)
        At the end: sensors, then drives [m].
    level : ndarray, shape (n,)
        [-]
    inputs : ndarray, shape (n, n_inputs)
        What is fixed for the switch.
    switch, partner, row : ndarray of int, shape (n,)
        Number of the switch; row of the paired sound throw in its plan; own row.
    size, x, force : ndarray, shape (n,)
        Of an object [m], [m], and the largest force on it [N].
    """

    features: Floats
    rates: Floats
    gaps: Floats
    level: Floats
    inputs: Floats
    switch: NDArray[np.intp]
    partner: NDArray[np.intp]
    row: NDArray[np.intp]
    size: Floats
    x: Floats
    force: Floats

    def of(self, index: NDArray[np.intp] | NDArray[np.bool_] | slice) -> "ThrowSet":
        """Return some of them."""
        return ThrowSet(**{name: getattr(self, name)[index] for name in self.__slots__})

    def with_more(self, others: "ThrowSet") -> "ThrowSet":
        """Return these and then others of the same features."""
        return ThrowSet(**{
            name: np.concatenate([getattr(self, name), getattr(others, name)])
            for name in self.__slots__
        })  # fmt: skip

    @property
    def values(self) -> Floats:
        """Features and gaps side by side."""
        return np.hstack([self.features, self.gaps])
