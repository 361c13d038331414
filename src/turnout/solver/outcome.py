"""Outcome of a run: its code, and a message with the remedy."""

import math
from dataclasses import dataclass
from enum import IntEnum

from turnout.core.errors import SolverError

CLOSES = 1e-6
"""Largest residual of the energy balance of a complete run, as a share of its scale [-]."""
LEAST_SCALE = 0.1
"""Smallest scale of the energy balance [J]; forces of 10 kN times 1e-12 m are 1e-7 of it."""
ROUNDING = 1e-14
"""Rounding allowed besides, as a share of the energy of the folded linear system [-]."""
MOST_ROUNDING = 1e-5
"""Most rounding allowed [J]: rails at rest with chairs metres below them have 5e-7 to 4e-6 J.

The latter is 9 units of the last digit of the folded energy; processors sum in different orders.
"""


class Code(IntEnum):
    """Outcome codes; the kernels know the first three by number."""

    COMPLETE = 0
    NOT_CONVERGED = 1
    NOT_FINITE = 2
    NO_EQUILIBRIUM = 3
    INTERRUPTED = 4
    INACCURATE = 5
    NO_STATIC_CONTINUATION = 6
    NO_LOADED_START = 7


ADVICE = {
    Code.COMPLETE: "",
    Code.NOT_CONVERGED: (
        "the contact set did not converge even with the smallest step; try a smaller step, "
        "a softer contact or stick stiffness, or a higher cut-off frequency"
    ),
    Code.NOT_FINITE: (
        "the solution is no longer finite; look for a stiffness or mass that is far out of range"
    ),
    Code.NO_EQUILIBRIUM: (
        "no static equilibrium was found at the start; check that stops and chairs "
        "do not press against each other in the stress-free position"
    ),
    Code.INACCURATE: (
        "the energy balance does not close, so the results are not trustworthy; look for a "
        "stiffness, mass or length that is far out of range (`turnout panel check` names unusual "
        "values), or take a smaller step"
    ),
    Code.NO_STATIC_CONTINUATION: (
        "no quasi-static equilibrium follows, since a foot can neither stick nor "
        "slip where friction follows its normal force; take a scheme with inertia"
    ),
    Code.NO_LOADED_START: (
        "the movement before the start did not converge, whose friction a loaded start takes over, "
        "or its cycles did not repeat; start without it (schedule.loaded = false), or try a "
        "smaller friction coefficient"
    ),
    Code.INTERRUPTED: "the run was interrupted; what was computed until then is kept",
}


def is_closed(residual: float, scale: float, folded: float = 0.0) -> bool:
    """Return whether the energy balance of a run closes.

    Parameters
    ----------
    residual, scale : float
        From `turnout.solver.energy.energy_balance` [J].
    folded : float
        From `turnout.solver.energy.folded_energy` [J]; 0 allows no rounding.

    Examples
    --------
    >>> is_closed(1e-4, 700.0), is_closed(1e-3, 700.0), is_closed(float("nan"), 700.0)
    (True, False, False)
    >>> is_closed(5e-7, 5e-7), is_closed(5e-7, 5e-7, 1e8), is_closed(2e-5, 2e-5, 1e12)
    (False, True, False)
    """
    rounding = min(ROUNDING * folded, MOST_ROUNDING)
    return residual <= CLOSES * max(scale, LEAST_SCALE) + rounding


@dataclass(frozen=True, slots=True)
class Outcome:
    """Outcome of one run.

    Attributes
    ----------
    code : Code
        Complete, or why not.
    time : float
        Time reached [s].
    step : int
        Index of the last complete step.
    residual : float
        Largest displacement error, see `turnout.solver.solve.equilibrium_residual` [m].
    contacts : tuple of str
        Names of the laws that changed last or were not settled.
    energy_residual, energy_scale : float
        Largest residual of the energy balance and its scale, see
        `turnout.solver.energy.energy_balance` [J].
    """

    code: Code
    time: float
    step: int
    residual: float
    contacts: tuple[str, ...] = ()
    energy_residual: float = math.nan
    energy_scale: float = math.nan

    @property
    def complete(self) -> bool:
        """True if the run reached its end."""
        return self.code is Code.COMPLETE

    def message(self) -> str:
        """Return one sentence naming code, time, step, residual and contacts, and the remedy."""
        if self.complete:
            return "complete"
        text = (
            f"{self.code.name.lower().replace('_', ' ')} at t = {self.time:.4f} s "
            f"(step {self.step}, residual {self.residual:.1e} m): {ADVICE[self.code]}"
        )
        if self.code is Code.INACCURATE:
            return (
                f"{text}; energy residual {self.energy_residual:.1e} J of {self.energy_scale:.3g} J"
                f", allowed is {CLOSES:g} of it or of {LEAST_SCALE:g} J, and rounding of "
                f"{MOST_ROUNDING:g} J at most"
            )
        if self.contacts:
            shown = ", ".join(self.contacts[:6])
            more = len(self.contacts) - 6
            text += f"; unconverged: {shown}" + (f" and {more} more" if more > 0 else "")
        return text


class NotConverged(SolverError):
    """Raised where a run ended early.

    Attributes
    ----------
    outcome : Outcome
        Time, step, residual and contacts of the failure.
    partial : object
        Result up to the failure, of the type that the caller would have got.
    """

    def __init__(self, outcome: Outcome, *, partial: object = None) -> None:
        super().__init__(outcome.message())
        self.outcome = outcome
        self.partial = partial
