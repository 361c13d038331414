"""The books of energy of a run in the terms of the schema."""

import numpy as np
from numpy.typing import NDArray

from turnout.integrate.energy import (
    ALGORITHMIC,
    DAMPING,
    FRICTION,
    MARKERS,
    SEGMENTS,
    SWITCHED,
    energy_balance,
)
from turnout.integrate.stored import CONTACT, GRAVITY, KINETIC, STRAIN
from turnout.response.signals import Variable

Floats = NDArray[np.float64]

_STORED = {
    "energy_kinetic": KINETIC,
    "energy_strain": STRAIN,
    "energy_contact": CONTACT,
    "energy_gravity": GRAVITY,
}
_SPENT = {
    "work_markers": MARKERS,
    "energy_friction": FRICTION,
    "energy_damping": DAMPING,
    "energy_object_switched": SWITCHED,
}
ENERGIES = (*_STORED, *_SPENT, "energy_numerical", "energy_residual")
"""Channels that `energy_channels` makes."""


def energy_channels(stored: Floats, ledger: Floats) -> dict[str, Variable]:
    """Return all energies; stored ones as change from the first instant.

    `energy_residual` is the only one that is a remainder: the stored change less what was put in
    and not taken out. The others come each from its own history.

    Parameters
    ----------
    stored : ndarray, shape (n_times, 4)
        Columns of `turnout.integrate.stored`, kinetic first [J].
    ledger : ndarray, shape (n_times, 6)
        Columns of `turnout.integrate.energy`, work of markers first [J].

    Returns
    -------
    dict
        Channel name to dimensions and values.
    """
    change = stored - stored[:1]
    numerical = ledger[:, ALGORITHMIC] + ledger[:, SEGMENTS]
    books = (
        ledger[:, MARKERS]
        + ledger[:, SWITCHED]
        - ledger[:, FRICTION]
        - ledger[:, DAMPING]
        - numerical
    )
    values = {name: change[:, column] for name, column in _STORED.items()}
    values |= {name: ledger[:, column] for name, column in _SPENT.items()}
    values |= {"energy_numerical": numerical, "energy_residual": change.sum(axis=1) - books}
    return {name: (("time",), value.copy()) for name, value in values.items()}


def energy_scale(stored: Floats, ledger: Floats) -> float:
    """Return the largest sum of marker work and stored change of a run, for ratios [J]."""
    return float(energy_balance(stored, ledger)[1])
