"""Matrices of one rail that another program has made, in place of sections and beams."""

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class RailMatrices:
    """A rail as matrices and a table that says which displacements its coordinates make.

    Attributes
    ----------
    stiffness, mass : csr_array, shape (n, n)
        Symmetric.
    damping : csr_array, shape (n, n), or None
        None: the panel's Rayleigh damping of these matrices.
    unit_weight : ndarray, shape (n,), or None
        Load for a gravity of 1 m/s2 in -z; None: from the mass.
    x, z : ndarray, shape (n_table,)
        Place of each displacement of the table, from the toe and above the foot [m].
    direction : tuple of str
        "ux", "uy", "uz", "rx", "ry" or "rz" of each.
    rows : csr_array, shape (n_table, n), or None
        Each displacement of the table for unit coordinates; None: the coordinates are the table.
    with_supports : bool
        The fastenings of the rail and its clamped heel are in the matrices already.
    digest : str
        Content hash of the file.
    """

    stiffness: sp.csr_array
    mass: sp.csr_array
    damping: sp.csr_array | None
    unit_weight: Floats | None
    x: Floats
    z: Floats
    direction: tuple[str, ...]
    rows: sp.csr_array | None
    with_supports: bool
    digest: str
