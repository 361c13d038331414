"""Sensors as unknowns, and unknowns beyond their stated ranges.

Where a model is not right, such as one of a switch of another length, unknowns with priors take up
the rest: the model then misses nothing, but only with gains, objects and states that no one would
have stated. One kind of them may be off: then it is named, and the others are judged. Without a
cause a gain is itself the finding, and `sensor_reasons` judges it.
"""

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import xarray as xr
from scipy.special import chdtrc, ndtr

from turnout.calibration.candidate_causes import MODULUS
from turnout.calibration.comparison import Comparison, Key
from turnout.calibration.fit import Fit
from turnout.calibration.misfit import (
    about_clock,
    common_gain,
    framed,
    plain_jacobian,
    scale_column,
    shared_estimates,
    solver_columns,
)
from turnout.calibration.shared import CLOCK, CROSS_TALK, GAIN, ZERO, SensorColumn, chain_key
from turnout.calibration.stages import (
    Parameter,
    coordinates,
    is_of_object,
    is_thickness,
    prior_residuals,
    prior_slopes,
)
from turnout.core.value_text import value_text

# What chance does more rarely than this is no chance [-]. A right cause is refused that often.
LEAST_CHANCE = 0.01
# Chances below this are not stated in figures [-], and how many of many deviations are listed.
LEAST_SAID, MOST_SHOWN = 1e-4, 3
THICKNESS, PLACE, STATE = "thickness", "place", "state"
# Kinds of which one may be off, with the name of the cause that it then is: a wrong run sheet or
# sampling rate. Of the places at most this share, as all together are a wrong panel [-].
MAY_LEAVE, MOST_PLACES = {THICKNESS: "objects", PLACE: "objects", CLOCK: "timing"}, 0.5
VERBS = {False: ("was", "is"), True: ("were", "are")}


@dataclass(frozen=True, slots=True, kw_only=True)
class Stated:
    """One unknown that had a prior.

    Attributes
    ----------
    text : str
        As stated and as found.
    away : float
        How far it came out from the mean of its prior, in deviations of that [-].
    kind : str
        `THICKNESS`, `PLACE`, `STATE` of the panel, or that of a sensor.
    """

    text: str
    away: float
    kind: str = GAIN


def stated_unknowns(found: Fit) -> list[Stated]:
    """Return sensors and states of the panel with their distance from the stated values.

    Where other rails were fitted, their weight is doubted too, which all gains show alike: they
    then count about the gain that all channels have in common, whose size the intervals hold.

    Parameters
    ----------
    found : Fit
        At its end.
    """
    alike = 0.0
    if any(item.name == MODULUS for item in found.parameters):
        alike = (common_gain(found.local, found.frame, found.misfit.comparison) or (0.0, 0.0))[0]
    away = prior_residuals(found.parameters, coordinates(found.parameters, found.values))
    return [
        *(
            Stated(
                text=item.text,
                away=(item.value - alike * (item.column.kind == GAIN)) / item.stated,
                kind=item.column.kind,
            )
            for item in found_sensors(found)
        ),
        *(
            Stated(
                text=f"{item.name} {value_text(found.values[item.name], unit=item.unit, digits=3)} "
                f"(stated {value_text(item.start, unit=item.unit, digits=3)} ± "
                f"{value_text(item.prior, unit=item.unit, digits=3)})",
                away=float(size),
                kind=_kind(item),
            )
            for item, size in zip(found.parameters, away, strict=True)
            # The sizes of a cause are no states of the panel.
            if (item.keys or is_of_object(item)) and item.prior
        ),
    ]


def _kind(item: Parameter) -> str:
    if not is_of_object(item):
        return STATE
    return THICKNESS if is_thickness(item.name) else PLACE


def kind_that_leaves(unknowns: Sequence[Stated]) -> str:
    """Return the one kind of unknown that is off where no other need be; empty where none is.

    Parameters
    ----------
    unknowns : sequence of Stated
        From `stated_unknowns`.

    Examples
    --------
    >>> kind_that_leaves([Stated(text="", away=5.0, kind=THICKNESS), Stated(text="", away=0.3)])
    'thickness'
    """
    furthest = {
        kind: max((abs(item.away) for item in unknowns if item.kind == kind), default=0.0)
        for kind in MAY_LEAVE
    }
    kind = max(furthest, key=lambda name: furthest[name])
    own = [abs(item.away) > LEAVES_PRIOR for item in unknowns if item.kind == kind]
    if furthest[kind] <= LEAVES_PRIOR or (kind == PLACE and sum(own) > MOST_PLACES * len(own)):
        return ""
    return kind


def chances_of(away: Sequence[float]) -> tuple[float, float]:
    r"""Return how often chance takes unknowns as far from their priors, in each of two ways [-].

    That the furthest of `n` is as far, and that the sum of squares is as large,

    .. math:: 2 - 2 (1 - 2 Q(\max |z|))^n, \quad 2 P\bigl(\chi^2_n > \textstyle\sum z^2\bigr),

    twice what each alone would be, as either of the two refuses a cause (Bonferroni), 1 at most.

    Estimates lie nearer to the means of their priors than the unknowns do, so chance is overrated.

    Parameters
    ----------
    away : sequence of float
        In deviations of each prior [-].

    Examples
    --------
    >>> [round(min(chances_of([far] + 9 * [0.5])), 4) for far in (2.0, 3.0, 3.8)]
    [0.7446, 0.0533, 0.0029]
    >>> round(min(chances_of(10 * [1.6])), 4)
    0.0086
    """
    sizes = np.abs(np.asarray(away, dtype=np.float64))
    if not sizes.size:
        return 1.0, 1.0
    beyond = 2.0 * ndtr(-sizes.max())
    furthest = -np.expm1(sizes.size * np.log1p(-beyond)) if beyond < 1.0 else 1.0
    together = chdtrc(sizes.size, sizes @ sizes)
    return min(1.0, 2.0 * float(furthest)), min(1.0, 2.0 * float(together))


def prior_reasons(found: Fit, causes: Sequence[str]) -> list[str]:
    """Say what leaves its prior beside fitted causes, by more than chance would.

    Parameters
    ----------
    found : Fit
        At its end, with the causes.
    causes : sequence of str
        Names of those that were fitted, the likeliest first.

    Returns
    -------
    list of str
        One sentence, or none.
    """
    unknowns = stated_unknowns(found)
    kind = kind_that_leaves(unknowns)
    causes = [*causes, *([MAY_LEAVE[kind]] if kind else [])]
    # Without a cause a gain is the finding.
    judged = [
        item
        for item in unknowns
        if item.kind != kind and (causes or item.kind in (THICKNESS, PLACE, STATE))
    ]
    unknowns = sorted(judged, key=lambda item: -abs(item.away))
    furthest, together = chances_of([item.away for item in unknowns])
    chance = min(furthest, together)
    if chance >= LEAST_CHANCE:
        return []
    shown = [item for item in unknowns if abs(item.away) >= LEAVES_PRIOR]
    if together < furthest:
        shown = unknowns[: max(len(shown), MOST_SHOWN)]
    left = "; ".join(
        f"{item.text}, {abs(item.away):.1f} standard deviations away"
        for item in shown or unknowns[:1]
    )
    named = list(dict.fromkeys(causes))
    names, (was, is_now) = " and ".join(named), VERBS[len(named) > 1]
    although = f" although {names} {was} fitted" if named else ""
    hence = f"so {names} {is_now} not the cause or not all of it" if named else "so it is none"
    all_of_them = f"all {len(unknowns)} together, of which " if together < furthest else ""
    often = "less than 0.01" if chance < LEAST_SAID else f"{100 * chance:.1g}"
    return [
        f"stated values are not kept{although}: {all_of_them}{left}; chance does this in {often} % "
        f"of campaigns, {hence}: check that lengths, places and sections of the panel are those of "
        "the switch"
    ]


# A gain this many deviations from where it was stated to be gives a warning.
LEAVES_PRIOR = 2.0
# One this many of its own deviations from nothing is off.
CLEAR = 4.0
# One so many stated deviations off: something else is wrong that the sensors take up.
BEYOND_BELIEF = 4.0
# Movements that all begin later than their currents say, in standard deviations of an onset.
LATE, LEAST_ONSETS, LEAD_PASSES = 3.0, 2, 3
SAME_LEAD = 2e-4  # below what an onset is estimated to [s]


@dataclass(frozen=True, slots=True, kw_only=True)
class FoundSensor:
    """An unknown of the measuring chain, as stated and as found.

    Attributes
    ----------
    column : SensorColumn
        Which one, and its standard deviation before the measurement.
    value, deviation : float
        How much too high it reads or too long its seconds are, and the standard deviation of that
        [-, N, -].
    """

    column: SensorColumn
    value: float
    deviation: float

    @property
    def stated(self) -> float:
        """Standard deviation before the measurement."""
        return self.column.stated

    @property
    def name(self) -> str:
        """Name in texts."""
        if self.column.kind == CLOCK:
            return "clock of the recorder"
        where = _channel(self.column.drive)
        if self.column.kind == CROSS_TALK:
            source = self.column.source[1]
            return f"force of {f'drive {source}' if source else 'the load cell'} in the {where}"
        return f"zero of the {where}" if self.column.kind == ZERO else where

    @property
    def key(self) -> str:
        """Key of a calibration's `chain`."""
        own = self.column
        return chain_key(own.kind, own.channel, own.drive, source=own.source)

    @property
    def text(self) -> str:
        """Stated and found value in words."""
        factor, unit, _ = self._shown
        return (
            f"{self.short_text.removesuffix(f' {unit}')} ± "
            f"{factor * self.deviation:.{self._decimals}f} "
            f"{unit} (stated ± {factor * self.stated:.3g} {unit})"
        )

    @property
    def short_text(self) -> str:
        """Found value alone in words."""
        factor, unit, _ = self._shown
        # Adding zero turns a negative zero into a plain one.
        number = round(factor * self.value, self._decimals) + 0.0
        return f"{self.name} {number:+.{self._decimals}f} {unit}"

    @property
    def _shown(self) -> tuple[float, str, int]:
        """Factor from SI to the unit shown, that unit, and decimals at least."""
        return (1.0, "N", 1) if self.column.kind == ZERO else (100.0, "%", 2)

    @property
    def _decimals(self) -> int:
        """Decimals that show a deviation with a digit at least."""
        factor, _, least = self._shown
        size = factor * self.deviation
        return max(least, math.ceil(-math.log10(size))) if size > 0.0 else least

    @property
    def warning(self) -> str:
        """Advice where it leaves its prior."""
        remedy = {
            GAIN: "calibrate the channel (shunt or known loads), state gain_uncertainty in the "
            "channel map, or look for another cause",
            ZERO: "zero the channel with the rail unloaded, or look for another cause",
            CLOCK: "check the sampling rate that the recorder states, or look for another cause",
            CROSS_TALK: "load one channel alone and look at the others, or look for another cause",
        }
        return f"{self.text}: further off than was stated; {remedy[self.column.kind]}"

    @property
    def cause(self) -> str:
        """Name of the cause that it is where the movements show it; empty where they do not."""
        if abs(self.value) <= max(CLEAR * self.deviation, self.stated):
            return ""
        if self.column.kind == CROSS_TALK:
            return CROSS_TALK if self.leaves else ""
        return {GAIN: "gain", ZERO: "zero", CLOCK: "timing"}[self.column.kind]

    @property
    def leaves(self) -> bool:
        """True if the movements put it beyond its prior.

        Channels take up something of all others: one of so many is off by chance more often.
        """
        most = BEYOND_BELIEF if self.column.kind == CROSS_TALK else LEAVES_PRIOR
        return abs(self.value) > most * self.stated

    @property
    def is_shown(self) -> bool:
        """True if it stands in lists of sensors: of cross-talk only what leaves its prior.

        An error of the model that a step of the solver makes acts like a little of it.
        """
        return self.column.kind != CROSS_TALK or self.leaves


def _channel(drive: str) -> str:
    return f"gauges of drive {drive}" if drive else "load cell"


def stated_gains(dataset: xr.Dataset, comparison: Comparison) -> dict[Key, float]:
    """Return the uncertainty of the gain of each channel, from the channel map or the default.

    Parameters
    ----------
    dataset : xarray.Dataset
        From `build_campaign`; its attribute `gain_uncertainty` holds what the channel map states.
    comparison : Comparison
        With the channels, and the default.

    Examples
    --------
    >>> from turnout.calibration.comparison import Noise
    >>> stated = xr.Dataset(attrs={"gain_uncertainty": '{"drive_force.1": 0.002}'})
    >>> known = {("drive_force", "1"): Noise(white=1.0), ("object_force", ""): Noise(white=1.0)}
    >>> list(stated_gains(stated, Comparison(noise=known)).values())
    [0.002, 0.01]
    """
    stated = json.loads(str(dataset.attrs.get("gain_uncertainty", "{}")))
    default = comparison.uncertainty.common_gain
    return {
        (channel, drive): float(stated.get(f"{channel}.{drive}".rstrip("."), default))
        for channel, drive in comparison.noise
    }


def found_sensors(found: Fit) -> list[FoundSensor]:
    r"""Return gains, zeros and clock at a fit, with what the parameters leave uncertain of them.

    With the Jacobian `J` of the residuals that are whitened movement by movement, and columns `B`
    of what all movements share, parameters and columns have the joint covariance

    .. math:: \begin{pmatrix} J^T J & -J^T B \\ -B^T J & I + B^T B \end{pmatrix}^{-1}

    and the scale of the model, step, mesh and modes of the solver, each an error of all
    movements alike, add the squares of what they do to them.

    Parameters
    ----------
    found : Fit
        At its end.
    """
    shared = found.frame.shared
    if shared is None or not shared.sensors:
        return []
    J = plain_jacobian(found.local, found.frame, [item.name for item in found.parameters])
    B, count = shared.columns, J.shape[1]
    # Parameters with flat priors: a weak one keeps those that are not identified regular.
    weak = 1e-6 * np.eye(count) + np.diag(prior_slopes(found.parameters) ** 2)
    joint = np.block([[J.T @ J + weak, -J.T @ B], [-B.T @ J, np.eye(B.shape[1]) + shared.gram]])
    inverse = np.linalg.inv(joint)
    variance = np.diag(inverse)[count:].copy()
    scale = scale_column(found.frame, found.misfit.comparison)
    for column in (scale, *solver_columns(found.misfit, found.frame)):
        move = inverse @ np.concatenate([-J.T @ column, B.T @ column])
        variance += move[count:] ** 2
    deviations = np.sqrt(variance)
    values = shared_estimates(found.local, found.frame)
    return [
        FoundSensor(
            column=item,
            value=float(values[n]) * item.stated,
            deviation=float(deviations[n]) * item.stated,
        )
        for n, item in enumerate(shared.sensors)
    ]


def sensor_reasons(found: Fit) -> list[str]:
    """Say which sensors would have to be off by more than anybody would believe of them.

    A cause that is not known is taken up by gains: rails of another stiffness, a bushing that is
    soft. Values are then off by as much as the gains are.
    """
    return [
        f"{item.text}: not to be believed of it, so something else is wrong"
        for item in found_sensors(found)
        # A clock is warped as it is: only other unknowns show that it took up something else.
        if item.column.kind != CLOCK and abs(item.value) > BEYOND_BELIEF * item.stated
    ]


def common_lead(found: Fit) -> float:
    """Return how much later than marked all movements begin [s]; 0 where they do not.

    Motors may run before the rods move: the onset that currents mark is then early in all
    movements alike, and their own uncertainty is about that lead.
    """
    misfit, frame, lead = found.misfit, found.frame, 0.0
    comparison = misfit.comparison
    spread = comparison.uncertainty.clocked_onset
    if sum(item.clocked for item in misfit.movements) < LEAST_ONSETS:
        return 0.0
    # As if currents said no more of the onset than forces: else they would hold it where it is.
    wide = replace(comparison.uncertainty, clocked_onset=comparison.uncertainty.onset)
    for _ in range(LEAD_PASSES):
        about = replace(misfit.comparison, uncertainty=wide, lead=lead)
        frame = framed(found.local, replace(misfit, comparison=about), near=frame)
        misfit, before = about_clock(misfit, frame), lead
        lead = float(
            np.median([a.estimates["onset"][0] for a in frame.alignments if a.movement.clocked])
        )
        if abs(lead - before) < SAME_LEAD:
            break
    return lead if abs(lead) > LATE * spread else 0.0


def unknown_lead(found: Fit) -> float:
    """Return how much later than marked all movements begin where no lead is known of [s]."""
    return 0.0 if found.misfit.comparison.lead else common_lead(found)


def lead_text(lead: float) -> str:
    """Say by how much motors lead.

    Examples
    --------
    >>> lead_text(0.15)
    'timing: the motors run 150 ms before the rods move'
    """
    way = "before" if lead > 0 else "after"
    return f"timing: the motors run {1e3 * abs(lead):.0f} ms {way} the rods move"
