"""Weighted residuals of measured movements against simulated ones, over any set of movements.

And their changes with the parameters, and with errors of gauges and of the solver.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from turnout.calibration.comparison import Alignment, Comparison, Key, Sensitivity, align
from turnout.calibration.evaluate import Evaluator, Response, ThrowInputs, with_change
from turnout.calibration.linearisation import (
    DIFFERENCE,
    FINE_DIFFERENCE,
    NEAR_REACHES,
    REACH,
    SAME_SLOPE,
    Differences,
    Linearisation,
    Plane,
    Thrown,
    apart_in_reaches,
    difference_of,
    leaders_of,
    moved_aside,
    pairs_wanted,
    plane_of,
    points_about,
    stepped_value,
    touches,
)
from turnout.calibration.measured_movements import (
    MeasuredMovement,
    Signal,
)
from turnout.calibration.shared import CLOCK, GAIN, Shared, shared_of
from turnout.calibration.stages import (
    Parameter,
    acts_on,
    is_of_object,
    overrides_of,
    thrown_object,
)
from turnout.core.errors import SolverError

Floats = NDArray[np.float64]
# The clock is linearised again where it is further off than this, so often at most [-].
SAME_CLOCK, CLOCK_PASSES = 2e-5, 5
# The change by half the step and elements half as long, and by four times the frequency of modes,
# over the error left [-].
OF_STEP, OF_MODES = 2.0**2 - 1.0, 4.0**1.2 - 1.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Refined:
    """One movement near the end of a fit, thrown ever more finely.

    Attributes
    ----------
    plain, halved, fine : Response
        As the scheme says; with half its step and elements half as long; and with modes to a
        higher frequency too.
    """

    plain: Response
    halved: Response
    fine: Response

    @property
    def failure(self) -> str:
        """Why it is not known what fine throws change; empty where it is."""
        return self.fine.failure or self.plain.failure

    def added(self, response: Response) -> Response:
        """Return a response near by with what fine throws change; the same where one failed."""
        if self.failure:
            return response
        return with_change(response, self.fine, self.plain)


@dataclass(slots=True, kw_only=True, eq=False)
class Misfit:
    """A set of movements, how they are compared, and what throws them.

    Attributes
    ----------
    evaluator : Evaluator
        Throws the panel.
    parameters : tuple of Parameter
        All that may differ from the panel.
    base : mapping of str to float
        Their values where a call does not name them [SI].
    movements : tuple of MeasuredMovement
        Measured means over bins of each channel, forces [N].
    comparison : Comparison
        How they are compared.
    effects : mapping of str to tuple of float
        By parameter that scatters: difference of each movement's own value from the common one, as
        a share; movements are simulated there.
    law : callable, optional
        From values by name to further overrides of the panel, such as another law of a drive.
    shape : callable, optional
        From a response and the values by name to the response as it is compared.
    always : tuple of str
        Parameters that act in every movement, whatever forces the plain law would ask for.
    quick : bool
        Whether throws are quick, those aside too.
    refinement : tuple of Refined
        Of each movement near the end, thrown as the scheme says and more finely: what this changes
        is added to every response. None away from there.
    same_slope : float
        Within this of where steps aside were taken they are not thrown again [coordinate].
    """

    evaluator: Evaluator
    parameters: tuple[Parameter, ...]
    base: Mapping[str, float]
    movements: tuple[MeasuredMovement, ...]
    comparison: Comparison
    effects: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    law: Callable[[Mapping[str, float]], dict[str, object]] | None = None
    shape: Callable[[Response, Mapping[str, float]], Response] | None = None
    always: tuple[str, ...] = ()
    quick: bool = False
    refinement: tuple[Refined, ...] = ()
    same_slope: float = SAME_SLOPE

    def residuals_of(self, responses: Sequence[Response], frame: "Frame") -> Floats:
        """Return the whitened residuals of the response to each movement.

        Parameters
        ----------
        responses : sequence of Response
            Simulated with the movement effects of this misfit.
        frame : Frame
            Alignments that whiten.

        Returns
        -------
        ndarray, shape (n,)
            Measured less simulated, independent with a standard deviation of 1 where the model is
            right; NaN where a simulation failed.
        """
        rows = []
        for number, (alignment, response) in enumerate(
            zip(frame.alignments, responses, strict=True)
        ):
            effects = {name: self.effect(name, number) for name in alignment.effects}
            rows.append(
                alignment.whitened(alignment.measured - alignment.reduced(response, effects))
            )
        return frame.joined(np.concatenate(rows)) if rows else np.zeros(0)

    def effect(self, name: str, number: int) -> float:
        """Return the difference of a movement's own value from the common one [share]."""
        return self.effects[name][number] if name in self.effects else 0.0

    def responses(self, points: Sequence[Mapping[str, float]]) -> list[list[Response]]:
        """Return the response to each movement at each of several points, thrown together."""
        whole = [{**self.base, **point} for point in points]
        throws = [
            self._throw(number, values) for values in whole for number in range(len(self.movements))
        ]
        count = len(self.movements)
        made = self.evaluator.responses(throws)
        rows = [made[n * count : (n + 1) * count] for n in range(len(points))]
        return [
            [self._kept(number, item, values) for number, item in enumerate(row)]
            for row, values in zip(rows, whole, strict=True)
        ]

    def refined(self, values: Mapping[str, float], *, halved: bool = True) -> "Misfit":
        """Return this with what finer throws change at values, half the step alone if wanted."""
        like = self._repeated_alike()
        count, whole = len(self.movements), {**self.base, **values}
        made = self.evaluator.responses(
            [
                like._throw(number, whole, kind)
                for kind in ("plain", "halved" if halved else "plain", "fine")
                for number in range(count)
            ]
        )
        pairs = zip(made[:count], made[count : 2 * count], made[2 * count :], strict=True)
        return replace(
            self, refinement=tuple(Refined(plain=a, halved=b, fine=c) for a, b, c in pairs)
        )

    def _repeated_alike(self) -> "Misfit":
        """Return this with one effect for all movements of a place and size: they share throws."""
        places = [(item.place, item.size) for item in self.movements]
        effects = {
            name: tuple(
                float(
                    np.mean(
                        [share for share, other in zip(row, places, strict=True) if other == place]
                    )
                )
                for place in places
            )
            for name, row in self.effects.items()
        }
        return replace(self, effects=effects)

    def of(self, numbers: Sequence[int]) -> "Misfit":
        """Return the misfit of some of the movements, in the order of the numbers."""
        return replace(
            self,
            movements=tuple(self.movements[n] for n in numbers),
            effects={name: tuple(row[n] for n in numbers) for name, row in self.effects.items()},
            refinement=tuple(self.refinement[n] for n in numbers) if self.refinement else (),
        )

    def _kept(self, number: int, response: Response, values: Mapping[str, float]) -> Response:
        """Return a response as it is compared: refined, and shaped."""
        if self.refinement and not response.failure:
            response = self.refinement[number].added(response)
        return response if self.shape is None else self.shape(response, values)

    def _throw(self, number: int, values: Mapping[str, float], kind: str = "") -> ThrowInputs:
        movement = self.movements[number]
        mine = {
            name: values[name] * (1.0 + shares[number])
            for name, shares in self.effects.items()
            if shares[number]
        }
        overrides: dict[str, object] = dict(overrides_of(self.parameters, {**values, **mine}))
        if self.law is not None:
            overrides |= self.law({**values, **mine})
        place, size = thrown_object(movement, values)
        return ThrowInputs(
            overrides=overrides,
            place=place,
            size=size,
            kind=kind or ("quick" if self.quick else "plain"),
        )

    def local(self, values: Mapping[str, float], vary: Sequence[str]) -> Linearisation:
        """Simulate about values: responses there, and one step aside for each parameter.

        Parameters that scatter are always among those that are stepped. Repeats that are thrown at
        nearly the same values share the steps aside of the first of them.

        Raises
        ------
        SolverError
            When a simulation fails at the values, or on both sides of them.
        """
        whole = {**self.base, **values}
        stepped = [
            p
            for p in self.parameters
            if p.name in vary or self.comparison.scatter.get(p.name, 0.0) > 0
        ]
        here = self.responses([whole])[0]
        for movement, response in zip(self.movements, here, strict=True):
            if response.failure:
                message = f"{movement.text}: cannot be simulated: {response.failure}"
                raise SolverError(message)
        difference = DIFFERENCE if self.quick else FINE_DIFFERENCE
        aside = {
            p.name: stepped_value(p, whole[p.name], difference_of(p) or difference) for p in stepped
        }
        own = [self._inputs_of(whole, n) for n in range(len(self.movements))]
        leaders = leaders_of(self.movements, stepped, own, within=0.5 * self.same_slope)
        numbers = sorted(set(leaders))
        aside, moved = moved_aside(
            lambda some, sides: self._moved(whole, some, sides, here, numbers),
            whole,
            stepped,
            aside,
        )
        count = len(self.movements)
        steps = {
            p.name: (p.coordinate(aside[p.name]) - p.coordinate(whole[p.name]),) * count
            for p in stepped
        }
        shares = {
            p.name: tuple(
                (aside[p.name] / whole[p.name] - 1.0) * (1.0 + self.effect(p.name, n))
                for n in leaders
            )
            for p in stepped
            if whole[p.name] != 0.0
        }
        return Linearisation(
            values=whole,
            simulated=tuple(here),
            origin=tuple(here[n] for n in leaders),
            stepped={name: tuple(row[n] for n in leaders) for name, row in moved.items()},
            steps=steps,
            shares=shares,
            about=tuple(own[n] for n in leaders),
            quick=self.quick,
        )

    def smoothed(
        self,
        values: Mapping[str, float],
        vary: Sequence[str],
        thrown: dict[int, Thrown],
        reaches: Floats,
        known: Linearisation | None = None,
    ) -> Linearisation:
        """Simulate on all sides of values, and return the plane nearest to the responses.

        Responses are rough: chairs stick and slide, and drives slip, at other instants for values
        that differ by a thousandth. One throw, and a slope from two, are off by as much as the
        cost decides on near its end; a mean over throws on all sides is not. Repeats that are
        thrown at nearly the same values share theirs.

        Parameters
        ----------
        values : mapping of str to float
            In the middle.
        vary : sequence of str
            Names of the parameters that are stepped, beside those that scatter.
        thrown : dict of int to list
            By movement what was thrown for planes before, which those near by are part of; what is
            thrown now is added.
        reaches : ndarray, shape (len(vary), len(vary))
            Of `reaches_of`.
        known : Linearisation, optional
            With slopes from near by, which are part of each plane.

        Raises
        ------
        SolverError
            When a simulation fails.
        """
        whole = {**self.base, **values}
        stepped = [
            p
            for p in self.parameters
            if p.name in vary or self.comparison.scatter.get(p.name, 0.0) > 0
        ]
        own = [self._inputs_of(whole, n) for n in range(len(self.movements))]
        leaders = leaders_of(self.movements, stepped, own, within=0.5 * self.same_slope)
        numbers = sorted(set(leaders))
        self._throw_into(thrown, [(n, whole) for n in numbers if not thrown.get(n)])
        acting = {
            n: [p for p in stepped if self._acts(p, n, whole, thrown[n][-1][1])] for n in numbers
        }
        far = {n: _of_some(reaches, vary, acting[n]) for n in numbers}
        slopes = {n: known.differences(n, acting[n]) if known else {} for n in numbers}
        planes = self._planes(whole, own, acting, thrown, far, slopes)
        found = Linearisation(
            values=whole,
            simulated=tuple(planes[n][0] for n in leaders),
            origin=tuple(planes[n][0] for n in leaders),
            stepped={
                p.name: tuple(planes[n][1].get(p.name, planes[n][0]) for n in leaders)
                for p in stepped
            },
            steps={p.name: (REACH,) * len(leaders) for p in stepped},
            shares={
                p.name: tuple(
                    REACH * p.slope(whole[p.name]) / whole[p.name] * (1.0 + self.effect(p.name, n))
                    for n in leaders
                )
                for p in stepped
                if whole[p.name] != 0.0
            },
            about=tuple(own[n] for n in leaders),
            quick=self.quick,
        )
        return found.each_moved(
            [
                {
                    p.name: p.coordinate(own[n][p.name]) - p.coordinate(own[leader][p.name])
                    for p in stepped
                }
                for n, leader in enumerate(leaders)
            ]
        )

    def _planes(
        self,
        whole: Mapping[str, float],
        own: Sequence[Mapping[str, float]],
        acting: Mapping[int, Sequence[Parameter]],
        thrown: dict[int, Thrown],
        far: Mapping[int, Floats],
        slopes: Mapping[int, Differences],
    ) -> dict[int, Plane]:
        """Throw movements on all sides of values, and return the plane of each."""
        jobs: list[tuple[int, Mapping[str, float]]] = []
        for place, (n, some) in enumerate(acting.items()):
            count = len(_near(thrown[n], own[n], some, far[n])[0])
            enough = count + len(slopes[n]) > len(some) + 1
            pairs, known = count // 2 if enough else 0, len(slopes[n]) == len(some)
            more = pairs_wanted(len(some), len(acting), near=pairs, known=known)
            # Each movement begins with another pair, so that all of them take all signs.
            numbers = range(place + pairs, place + pairs + more)
            jobs += [(n, x) for x in points_about(whole, some, far[n], numbers)]
        self._throw_into(thrown, jobs)
        planes = {}
        for n, some in acting.items():
            steps, responses = _near(thrown[n], own[n], some, far[n])
            planes[n] = plane_of(steps, [p.name for p in some], responses, slopes[n])
        return planes

    def _throw_into(
        self, thrown: dict[int, Thrown], jobs: Sequence[tuple[int, Mapping[str, float]]]
    ) -> None:
        """Throw movements at values, and add the responses; SolverError where one failed."""
        made = self.evaluator.responses([self._throw(n, values) for n, values in jobs])
        for (n, values), item in zip(jobs, made, strict=True):
            response = self._shaped(n, item, values)
            thrown.setdefault(n, []).append((self._inputs_of(values, n), response))

    def local_near(
        self, values: Mapping[str, float], vary: Sequence[str], previous: Linearisation
    ) -> Linearisation:
        """Return what `local` does, reusing differences that were taken near by.

        Near is judged movement by movement, as each is simulated at its own values.
        """
        whole = {**self.base, **values}
        own = [self._inputs_of(whole, n) for n in range(len(self.movements))]
        stale = [
            n
            for n, inputs in enumerate(own)
            if previous.apart(previous.about[n], inputs, self.parameters) > self.same_slope
        ]
        same = set(vary) <= set(previous.stepped) and previous.quick == self.quick
        if not same or len(stale) == len(self.movements):
            return self.local(whole, vary)
        found = replace(previous, values=whole, simulated=tuple(self.responses([whole])[0]))
        return found.with_movements(stale, self.of(stale).local(whole, vary)) if stale else found

    def _inputs_of(self, values: Mapping[str, float], number: int) -> dict[str, float]:
        return {name: value * (1.0 + self.effect(name, number)) for name, value in values.items()}

    def _moved(
        self,
        whole: Mapping[str, float],
        stepped: Sequence[Parameter],
        aside: Mapping[str, float],
        here: Sequence[Response],
        numbers: Sequence[int],
    ) -> dict[str, tuple[Response, ...]]:
        """Return the responses aside of some movements; those at the point where nothing acts.

        Those of parameters with priors are lean.
        """
        wanted: list[tuple[Parameter, int, bool]] = []
        throws = []
        found = {p.name: list(here) for p in stepped}
        for p in stepped:
            values = {**whole, p.name: aside[p.name]}
            lean = p.prior > 0.0 and not (self.quick or is_of_object(p))
            for number in numbers:
                if self._acts(p, number, whole, here[number]):
                    wanted.append((p, number, lean))
                    throws.append(self._throw(number, values, "lean" if lean else ""))
        origins = sorted({number for _, number, lean in wanted if lean})
        throws += [self._throw(number, whole, "lean") for number in origins]
        made = self.evaluator.responses(throws)
        before = {
            number: self._shaped(number, response, whole)
            for number, response in zip(origins, made[len(wanted) :], strict=True)
        }
        for (p, number, lean), response in zip(wanted, made[: len(wanted)], strict=True):
            values = {**whole, p.name: aside[p.name]}
            moved = self._shaped(number, response, values)
            found[p.name][number] = (
                with_change(here[number], moved, before[number]) if lean else moved
            )
        return {name: tuple(row) for name, row in found.items()}

    def _acts(self, p: Parameter, number: int, whole: Mapping[str, float], here: Response) -> bool:
        """Return whether a parameter can change the response to a movement."""
        if is_of_object(p):
            return acts_on(p, self.movements[number])
        return p.name in self.always or touches(
            p, whole[p.name] * (1.0 + self.effect(p.name, number)), here
        )

    def _shaped(self, number: int, response: Response, values: Mapping[str, float]) -> Response:
        """Return a response as it is compared; SolverError where it failed."""
        if response.failure:
            message = f"{self.movements[number].text}: cannot be simulated: {response.failure}"
            raise SolverError(message)
        return self._kept(number, response, values)


def _of_some(matrix: Floats, names: Sequence[str], parameters: Sequence[Parameter]) -> Floats:
    """Return the part of a matrix that is of some parameters; one for those that it has not."""
    found = np.eye(len(parameters))
    pairs = [(n, list(names).index(p.name)) for n, p in enumerate(parameters) if p.name in names]
    own, rows = [n for n, _ in pairs], [n for _, n in pairs]
    found[np.ix_(own, own)] = matrix[np.ix_(rows, rows)]
    return found


def _near(
    thrown: Thrown, middle: Mapping[str, float], parameters: Sequence[Parameter], reaches: Floats
) -> tuple[Floats, list[Response]]:
    """Return those of some throws that are near values: their distances, and their responses."""
    apart = [apart_in_reaches(inputs, middle, parameters) for inputs, _ in thrown]
    most = [np.abs(np.linalg.solve(reaches, row)).max(initial=0.0) for row in apart]
    near = [n for n, far in enumerate(most) if far <= NEAR_REACHES]
    steps = np.array([apart[n] for n in near], dtype=np.float64).reshape(-1, len(parameters))
    return steps, [thrown[n][1] for n in near]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Frame:
    """Alignments of all movements, made about one point.

    Attributes
    ----------
    values : mapping of str to float
        Common values of the parameters at which the frame was found, in SI.
    alignments : tuple of Alignment
        In the order of the movements.
    shared : Shared or None
        What all movements share.
    """

    values: Mapping[str, float]
    alignments: tuple[Alignment, ...]
    shared: Shared | None = None

    def joined(self, rows: Floats) -> Floats:
        """Return the whitened rows of all movements with what they share made independent too."""
        return rows if self.shared is None else self.shared.whitened(rows)


def framed(
    local: Linearisation,
    misfit: Misfit,
    *,
    passes: int = CLOCK_PASSES,
    near: Frame | None = None,
) -> Frame:
    """Align all movements about a point, with the recorder's clock where they show it.

    With one pass the clock stays where the misfit has it, and counts to first order about that.
    Onsets are looked for from those of a frame near by.
    """
    frame = _framed(local, misfit, near)
    for _ in range(passes - 1):
        rate, known = _clock_of(local, frame), misfit.comparison.rate
        if rate is None or abs(rate - known) < SAME_CLOCK:
            break
        misfit = replace(misfit, comparison=replace(misfit.comparison, rate=rate))
        frame = _framed(local, misfit, frame)
    return frame


def about_clock(misfit: Misfit, frame: Frame) -> Misfit:
    """Return a misfit whose clock is linearised where a frame found it."""
    rate = frame.alignments[0].rate if frame.alignments else 0.0
    return replace(misfit, comparison=replace(misfit.comparison, rate=rate))


def _clock_of(local: Linearisation, frame: Frame) -> float | None:
    """Return the likeliest share by which the recorder's seconds are too short [-]."""
    sensors = frame.shared.sensors if frame.shared else ()
    place = next((n for n, item in enumerate(sensors) if item.kind == CLOCK), None)
    if place is None:
        return None
    return float(shared_estimates(local, frame)[place]) * sensors[place].stated


def shared_estimates(local: Linearisation, frame: Frame) -> Floats:
    """Return the likeliest size of all that movements share, in standard deviations, shape (q,)."""
    if frame.shared is None:
        return np.zeros(0)
    rows = [
        alignment.whitened(alignment.measured - alignment.reduced(response))
        for alignment, response in zip(frame.alignments, local.simulated, strict=True)
    ]
    return frame.shared.estimates(np.concatenate(rows))


def remaining(
    local: Linearisation, frame: Frame
) -> list[tuple[Alignment, list[tuple[Signal, NDArray[np.intp], Floats]]]]:
    """Return by movement each part, and its residuals less what nuisances and sensors explain.

    Returns
    -------
    list of (Alignment, list of (Signal, ndarray of int, ndarray))
        Signal, bins and residuals over these [N].
    """
    count = len(frame.shared.sensors) if frame.shared else 0
    sizes = shared_estimates(local, frame)[:count]
    found = []
    for number, (alignment, response) in enumerate(
        zip(frame.alignments, local.simulated, strict=True)
    ):
        sensors = frame.shared.plain[number][:, :count] @ sizes if frame.shared else None
        rows = alignment.remaining_residuals(response, shared=sensors)
        found.append(
            (alignment, [(*part, row) for part, row in zip(alignment.parts, rows, strict=True)])
        )
    return found


def _framed(local: Linearisation, misfit: Misfit, near: Frame | None) -> Frame:
    """Align all movements about a point."""
    alignments = []
    for number, movement in enumerate(misfit.movements):
        sensitivities = {
            name: Sensitivity(
                simulated=local.origin[number],
                stepped=local.stepped[name][number],
                step=local.shares[name][number],
                effect=misfit.effect(name, number),
            )
            for name, share in misfit.comparison.scatter.items()
            if share > 0 and name in local.stepped
        }
        alignments.append(
            align(
                movement,
                local.simulated[number],
                comparison=misfit.comparison,
                sensitivities=sensitivities,
                shift=near.alignments[number].shift if near else None,
            )
        )
    shared = shared_of(alignments, misfit.comparison)
    return Frame(values=local.values, alignments=tuple(alignments), shared=shared)


def slopes_of(local: Linearisation, frame: Frame, names: Sequence[str]) -> list[Floats]:
    """Return the change of each movement's prediction with each coordinate.

    Returns
    -------
    list of ndarray, shape (n, len(names))
    """
    found = []
    for number, alignment in enumerate(frame.alignments):
        here = alignment.predicted(local.origin[number])
        block = np.zeros((here.size, len(names)))
        for column, name in enumerate(names):
            moved = local.stepped[name][number]
            if moved is not local.origin[number]:
                block[:, column] = (alignment.predicted(moved) - here) / local.steps[name][number]
        found.append(block)
    return found


def jacobian(local: Linearisation, frame: Frame, names: Sequence[str]) -> Floats:
    """Return the change of the whitened residuals with each coordinate.

    Returns
    -------
    ndarray, shape (n, len(names))
    """
    return frame.joined(plain_jacobian(local, frame, names))


def plain_jacobian(local: Linearisation, frame: Frame, names: Sequence[str]) -> Floats:
    """Return the change of the residuals that are whitened movement by movement alone."""
    slopes = slopes_of(local, frame, names)
    rows = [
        -alignment.whitened(slope)
        for alignment, slope in zip(frame.alignments, slopes, strict=True)
    ]
    return np.concatenate(rows)


def force_channels(frame: Frame) -> list[Key]:
    """Return channel and drive of all that is compared, each once."""
    return list(
        dict.fromkeys(
            (s.channel, s.drive) for alignment in frame.alignments for s, _ in alignment.parts
        )
    )


def plain_gain_column(frame: Frame, key: Key) -> Floats:
    """Return the change of the residuals, whitened movement by movement alone, with a gain.

    Parameters
    ----------
    frame : Frame
        Alignments that whiten.
    key : tuple of str
        Channel and drive.

    Returns
    -------
    ndarray, shape (n,)
        For all of its force too much.
    """
    rows = []
    for alignment in frame.alignments:
        row = np.zeros(alignment.measured.size)
        for signal, _, place in alignment.pieces:
            if (signal.channel, signal.drive) == key:
                row[place] = alignment.measured[place]
        rows.append(alignment.whitened(row))
    return np.concatenate(rows)


def solver_columns(misfit: Misfit, frame: Frame) -> list[Floats]:
    r"""Return what step, mesh and modes leave, as changes of the residuals of a fit.

    By Richardson's rule, with the change :math:`\Delta` that a refinement makes of forces,

    .. math:: F_h - F_0 = \frac{\Delta}{2^2 - 1}, \quad F_f - F_\infty = \frac{\Delta}{4^{1.2} - 1}

    for half the step of a scheme of second order together with elements half as long, whose error
    is of that order too, and for modes to four times the frequency: on the panels of the library
    each doubling leaves 0.41 to 0.46 of the change that it makes, which is an order of 1.2. Each is
    one error of all movements, shown by those whose fine throws succeeded; none without any.

    Parameters
    ----------
    misfit : Misfit
        With the refinement of each movement.
    frame : Frame
        At the end of the fit.

    Returns
    -------
    list of ndarray, shape (n,)
        Whitened movement by movement alone.
    """
    shape, step, modes = misfit.shape, list[Floats](), list[Floats]()

    def seen(response: Response, alignment: Alignment) -> Floats:
        return alignment.predicted(shape(response, frame.values) if shape else response)

    def change(later: Response, before: Response, alignment: Alignment) -> Floats:
        return alignment.whitened(seen(later, alignment) - seen(before, alignment))

    for alignment, one in zip(frame.alignments, misfit.refinement, strict=False):
        nothing = np.zeros(alignment.measured.size)
        known = not (one.failure or one.halved.failure)
        step.append(change(one.halved, one.plain, alignment) / OF_STEP if known else nothing)
        modes.append(change(one.fine, one.halved, alignment) / OF_MODES if known else nothing)
    return [np.concatenate(rows) for rows in (step, modes) if rows]


def scale_column(frame: Frame, comparison: Comparison) -> Floats:
    """Return the change of the residuals with one deviation of the scale of the model's forces.

    Whitened movement by movement alone.
    """
    columns = [plain_gain_column(frame, key) for key in force_channels(frame)]
    return np.asarray(comparison.uncertainty.scale * np.sum(columns, axis=0))


def common_gain(
    local: Linearisation, frame: Frame, comparison: Comparison
) -> tuple[float, float] | None:
    r"""Return the gain that all channels have alike, and how far off it was stated to be [-].

    .. math:: \bar g = \sum_c g_c / s_c^2 \Big/ \sum_c 1 / s_c^2, \quad
        s = \Big(\sum_c 1 / s_c^2\Big)^{-1/2}

    with the estimated gains and the deviations that were stated of them. None where one is known.
    """
    shared = frame.shared
    sizes = shared_estimates(local, frame)
    gains = [
        (size, item.stated)
        for size, item in zip(sizes, shared.sensors if shared else (), strict=False)
        if item.kind == GAIN
    ]
    # One that is known exactly is the scale.
    if not gains or min(comparison.gains.values()) == 0.0:
        return None
    weight = sum(stated**-2 for _, stated in gains)
    mean = sum(size / stated for size, stated in gains) / weight
    return float(mean), float(weight**-0.5)
