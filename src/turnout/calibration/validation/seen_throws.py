"""Throws of measured movements at any values of a calibration, as its measuring chain sees them."""

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from turnout.calibration.candidate_causes import fitted_causes, overrides_with, shaped
from turnout.calibration.evaluate import Evaluator, Response, ThrowInputs, throws_done
from turnout.calibration.measured_movements import MeasuredMovement
from turnout.calibration.misfit import Refined
from turnout.calibration.objects import as_found
from turnout.calibration.result import Calibration
from turnout.calibration.validation.grid import Grid, later
from turnout.calibration.validation.measuring_chain import through_chain
from turnout.calibration.validation.onset import with_rest

Floats = NDArray[np.float64]
Report = Callable[[str, int, int], None]
# Stages: predictions and their slopes; wrong values where the verdict would notice them.
PREDICTING, CHECKING = "predicting", "checking what would be noticed"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Seen:
    """What throws movements, and sees them as they were measured.

    Attributes
    ----------
    movements : tuple of MeasuredMovement
        Of a campaign.
    grid : Grid
        On which forces are compared.
    calibration : Calibration
        With the causes that change forces.
    evaluator : Evaluator
        Open; throws the panel as it was before the calibration.
    chain : mapping of str to (float, float)
        Gains, zeros and clock as they were found: a sound prediction would differ by them.
    finer : tuple of Refined
        What fine throws change of each movement; empty until thrown, or where none are.
    shifts : ndarray, shape (n_movements,)
        How much later than marked each movement began [s].
    report : callable or None
        Called after each throw with the stage, and the throws done and in all of that stage.
    """

    movements: tuple[MeasuredMovement, ...]
    grid: Grid
    calibration: Calibration
    evaluator: Evaluator
    chain: Mapping[str, tuple[float, float]]
    finer: tuple[Refined, ...] = ()
    shifts: Floats = field(default_factory=lambda: np.zeros(0))
    report: Report | None = None

    def of(self, numbers: NDArray[np.intp]) -> "Seen":
        """Return the same for some of the movements."""
        return replace(
            self,
            movements=tuple(self.movements[n] for n in numbers),
            finer=tuple(self.finer[n] for n in numbers) if self.finer else (),
            shifts=self.shifts[numbers],
        )

    def thrown(
        self, settings: Sequence[Mapping[str, float]], *, stage: str
    ) -> tuple[list[list[Response]], "Seen"]:
        """Return the responses at each setting, and this with what fine throws change of them.

        Fine throws are made once, at the first setting.

        Parameters
        ----------
        settings : sequence of mapping of str to float
            Values of all parameters, in SI.
        stage : str
            What these throws are for, as it is reported.
        """
        parameters = self.calibration.parameters
        causes = fitted_causes(self.evaluator.panel, parameters)
        objects = as_found(self.movements, self.calibration.objects)
        throws = [
            ThrowInputs(
                overrides=overrides_with(causes, parameters, setting),
                place=item.place,
                size=item.size,
            )
            for setting in settings
            for item in objects
        ]
        count, finer = len(self.movements), self.finer
        refined = bool(self.calibration.about.get("refined"))
        self._announce(stage, len(settings) + (refined and not finer))
        made = self.evaluator.responses(throws)
        if refined:
            if not finer:
                # Values that were fitted with fine throws are of these.
                fine = [replace(item, fine=True) for item in throws[:count]]
                finer = tuple(
                    Refined(plain=a, halved=a, fine=b)
                    for a, b in zip(made, self.evaluator.responses(fine), strict=False)
                )
            made = [finer[number % count].added(item) for number, item in enumerate(made)]
        rest = iter(made)
        responses = [
            [
                with_rest(shaped(causes, response, setting))
                for response in itertools.islice(rest, count)
            ]
            for setting in settings
        ]
        return responses, replace(self, finer=finer)

    def _announce(self, stage: str, times: int) -> None:
        """Report each throw from now on, as one of those that throw all objects so many times."""
        report, evaluator = self.report, self.evaluator
        if report is None:
            return
        # Repeats are thrown once.
        total = times * len({(item.place, item.size) for item in self.movements})
        begun = throws_done(evaluator)
        evaluator.on_throw = lambda: report(stage, throws_done(evaluator) - begun, total)

    def forces(self, responses: Sequence[Response]) -> Floats:
        """Return forces through the chain, shape (n_channels, n_movements, n_times) [N]."""
        row = self.grid.predicted(self.movements, responses, shifts=self.shifts)
        return through_chain(row, later(row), self.grid, self.chain)
