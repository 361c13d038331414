"""The numerical choices of a run, with a physical scale each."""

import math
from dataclasses import dataclass, fields
from typing import Any, Literal

from turnout.core.errors import ResponseError, SolverError

LEAST_OUTPUT_INTERVAL = 1e-3
Mode = Literal["waveform", "quick", "quasi-static"]
MODES: dict[str, dict[str, Any]] = {
    "waveform": {"step": 1e-3, "cutoff_frequency": 300.0},
    "quick": {"step": 4e-3, "cutoff_frequency": 100.0, "spectral_radius": 0.3},
    "quasi-static": {"step": 1e-2, "cutoff_frequency": 1.0, "inertia": False},
}
"""Settings of the modes of simulating a throw: `waveform` shows impacts and single
chairs, `quick` drives, gaps and labels, `quasi-static` the motion without inertia."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Scheme:
    """Time integration of a mechanism.

    Attributes
    ----------
    step : float
        Time step [s]; without inertia the length of a straight piece of the markers' path.
    cutoff_frequency : float
        Modes up to here keep their inertia, everything above answers statically [Hz].
    spectral_radius : float
        Of the generalised-alpha scheme at infinite frequency: 1 keeps everything, 0 removes what
        the step cannot resolve [-].
    gap_tolerance : float
        Overlap of neighbouring law segments that is overlooked, and motion taken for rest [m].
    force_tolerance : float
        Violation of a friction limit that is overlooked [N].
    iterations : int
        Contact-set iterations a step before the step is halved.
    halvings : int
        How often a step is halved before the run ends.
    follow_path : bool
        Whether the smallest step, where it does not settle, is walked event by event.
    output_interval : float
        Time between stored instants [s]. Default every step, but not more often than every
        millisecond. Between the steps it is filled in, see `turnout.solver.record`.
    inertia : bool
        Whether masses and dampers count. Without them the rails go from one equilibrium to the
        next, event by event.

    Examples
    --------
    >>> Scheme(step=2.5e-4).stride, Scheme(step=2e-3).output_interval
    (4, 0.002)
    >>> Scheme.of("quick").step, Scheme.of("quick", step=2e-3).mode
    (0.004, 'own')
    """

    step: float = 1e-3
    cutoff_frequency: float = 300.0
    spectral_radius: float = 0.5
    gap_tolerance: float = 1e-11
    force_tolerance: float = 1e-6
    iterations: int = 40
    halvings: int = 6
    follow_path: bool = True
    output_interval: float = 0.0
    inertia: bool = True

    @classmethod
    def of(cls, mode: str, **changes: float | bool) -> "Scheme":
        """Return the scheme of a mode, with changes.

        Parameters
        ----------
        mode : {"waveform", "quick", "quasi-static"}
            See `MODES`.
        **changes : float or bool
            Attributes that differ.

        Raises
        ------
        SolverError
            When the mode is not known or a value not allowed.
        """
        if mode not in MODES:
            msg = f"mode = {mode!r}: allowed are {', '.join(MODES)}"
            raise SolverError(msg)
        return cls(**{**MODES[mode], **changes})

    @property
    def mode(self) -> str:
        """The mode whose step and cut-off these are, else "own"."""
        if not self.inertia:
            return "quasi-static"
        for name, chosen in MODES.items():
            if all(getattr(self, key) == value for key, value in chosen.items()):
                return name
        return "own"

    def __post_init__(self) -> None:
        """Refuse invalid values, all at once; choose the output interval if none is given."""
        problems = [
            f"{item.name} = {value!r}: must be a number in SI"
            for item in fields(self)
            if isinstance(value := getattr(self, item.name), str) or value is None
        ]
        if problems:
            raise SolverError("scheme: " + "; ".join(problems))
        if not 0 < self.step <= 0.1:
            problems.append(f"step = {self.step:g} s: must be more than 0, at most 0.1 s")
        if not self.cutoff_frequency > 0:
            problems.append(f"cutoff_frequency = {self.cutoff_frequency:g} Hz: must be positive")
        if not 0 <= self.spectral_radius <= 1:
            problems.append(f"spectral_radius = {self.spectral_radius:g}: allowed is 0 to 1")
        if not problems and self.output_interval == 0.0:
            every = max(1, math.ceil(LEAST_OUTPUT_INTERVAL / self.step - 1e-9))
            object.__setattr__(self, "output_interval", every * self.step)
        if not problems:
            problems += self._output_problems()
        if self.iterations < 1 or self.halvings < 0:
            problems.append("iterations must be at least 1, halvings at least 0")
        if problems:
            raise SolverError("scheme: " + "; ".join(problems))

    def _output_problems(self) -> list[str]:
        if 0 < self.output_interval < math.inf:
            return []
        return [f"output_interval = {self.output_interval:g} s: must be positive"]

    @property
    def stride(self) -> int:
        """Steps between stored instants, or 0 if these lie between the steps."""
        count = round(self.output_interval / self.step)
        aligned = abs(count * self.step - self.output_interval) <= 1e-6 * self.output_interval
        return count if aligned else 0

    def describe(self) -> str:
        """Return one line that states the scheme with a result."""
        if not self.inertia:
            return f"quasi-static from event to event, straight pieces of {self.step * 1e3:g} ms"
        return (
            f"generalised-alpha, spectral radius {self.spectral_radius:g}, "
            f"step {self.step * 1e3:g} ms, cut-off {self.cutoff_frequency:g} Hz"
        )


def chosen_scheme(mode: str | None, scheme: Scheme | None, *, caller: str) -> Scheme:
    """Return the scheme that a caller of the public interface asks for.

    Parameters
    ----------
    mode : str, optional
        See `MODES`.
    scheme : Scheme, optional
        In place of a mode; without either it is "waveform".
    caller : str
        Function to name in the message.

    Raises
    ------
    ResponseError
        When both are given.
    SolverError
        When there is no such mode.

    Examples
    --------
    >>> chosen_scheme("quick", None, caller="simulate()").step
    0.004
    """
    if mode is not None and scheme is not None:
        message = (
            f"{caller}: mode = {mode!r} and a scheme exclude each other; give one of them, such as "
            f'scheme=Scheme.of("quick", step=2e-3) for a mode with a step of your own'
        )
        raise ResponseError(message)
    return scheme or Scheme.of("waveform" if mode is None else mode)


@dataclass(frozen=True, slots=True)
class AlphaCoefficients:
    """Coefficients of the generalised-alpha scheme in the form with an auxiliary acceleration.

    Arnold and Bruels 2007, doi 10.1007/s11044-007-9084-0. It is second-order accurate,
    unconditionally stable on linear systems, and exact equilibrium holds at the end of each step.
    """

    alpha_m: float
    alpha_f: float
    beta: float
    gamma: float

    @classmethod
    def from_spectral_radius(cls, radius: float) -> "AlphaCoefficients":
        """Return the coefficients of Chung and Hulbert for a spectral radius at infinity."""
        alpha_m = (2 * radius - 1) / (radius + 1)
        alpha_f = radius / (radius + 1)
        gamma = 0.5 - alpha_m + alpha_f
        return cls(alpha_m, alpha_f, 0.25 * (gamma + 0.5) ** 2, gamma)
