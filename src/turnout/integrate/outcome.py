"""How a run ended, in words that help."""

from dataclasses import dataclass
from enum import IntEnum

from turnout.errors import SolverError


class Code(IntEnum):
    """Outcome codes; the kernels know the first three by number."""

    COMPLETE = 0
    NOT_CONVERGED = 1
    NOT_FINITE = 2
    NO_EQUILIBRIUM = 3
    INTERRUPTED = 4
    INACCURATE = 5
    NO_STATIC_CONTINUATION = 6


ADVICE = {
    Code.COMPLETE: "",
    Code.NOT_CONVERGED: (
        "the contact set did not settle even in the smallest step; try a smaller step, "
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
        "the books of energy do not close, so the numbers are not to be trusted; look for a "
        "stiffness that is far out of range, or take a smaller step"
    ),
    Code.NO_STATIC_CONTINUATION: (
        "without inertia the motion does not go on from here, since a foot can neither stick nor "
        "slip where friction follows its normal force; take a scheme with inertia"
    ),
    Code.INTERRUPTED: "the run was interrupted; what was computed until then is kept",
}


@dataclass(frozen=True, slots=True)
class Outcome:
    """How a run ended.

    Attributes
    ----------
    code : Code
        What happened.
    time : float
        Time reached [s].
    step : int
        Index of the last complete step.
    residual : float
        Largest disagreement of the rows with the base system, see `equilibrium_residual` [m].
    contacts : tuple of str
        Names of the laws that changed last or were not settled.
    """

    code: Code
    time: float
    step: int
    residual: float
    contacts: tuple[str, ...] = ()

    @property
    def complete(self) -> bool:
        """Whether the run reached its end."""
        return self.code is Code.COMPLETE

    def message(self) -> str:
        """Return one sentence naming code, time, step, residual and contacts, and the remedy."""
        if self.complete:
            return "complete"
        text = (
            f"{self.code.name.lower().replace('_', ' ')} at t = {self.time:.4f} s "
            f"(step {self.step}, residual {self.residual:.1e} m): {ADVICE[self.code]}"
        )
        if self.contacts:
            shown = ", ".join(self.contacts[:6])
            more = len(self.contacts) - 6
            text += f"; unsettled: {shown}" + (f" and {more} more" if more > 0 else "")
        return text


class NotConverged(SolverError):
    """A run ended before its time.

    Attributes
    ----------
    outcome : Outcome
        Time, step, residual and contacts of the failure.
    partial : object
        What was computed until then, in the form that the caller would have got.
    """

    def __init__(self, outcome: Outcome, *, partial: object = None) -> None:
        super().__init__(outcome.message())
        self.outcome = outcome
        self.partial = partial
