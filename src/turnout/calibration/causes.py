"""Why a model does not follow: likely causes, each tested by a fit with one more parameter.

A cause is a parameter that the panel does not have, or that a calibration usually takes as known: a
recorder that averages, a bushing that is soft at first, rails of another stiffness, friction that
rises along the switch, a slip level of its own in each throw. Each is tried at a few sizes, with
the other values adjusted to first order, and judged by the Bayesian information criterion. One that
is decisively better is fitted together with all values, so that they are freed of its effect.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from turnout.calibration.candidate_causes import Cause, candidate_causes
from turnout.calibration.cause_trials import (
    TestedCause,
    cause_trials,
    one_of_alike,
    own_levels,
    with_cause,
)
from turnout.calibration.comparison import peaks_of
from turnout.calibration.evaluate import throws_done
from turnout.calibration.fit import Fit, brief_fit, sought_effects
from turnout.calibration.measured_movements import channel_name
from turnout.calibration.misfit import Misfit
from turnout.calibration.sensors import FoundSensor, found_sensors, lead_text, needs_lead
from turnout.calibration.shared import CLOCK, effective_samples, missing_more, model_error
from turnout.calibration.stages import prior_slopes
from turnout.core.errors import SolverError
from turnout.core.threads import one_blas_thread
from turnout.panel.load import LoadedPanel

Floats = NDArray[np.float64]
# How many causes are taken up at most, and of how many choices the one that misses least.
MOST_CAUSES, ATTEMPTS = 3, 4
# How many are taken up in one fit at most.
AT_ONCE = 2
# The share of what a model misses without a cause that is noise in a fit with it [-], and the steps
# of that: with more noise, or with noise found again too early, it would stay where it is.
LEFT_MISSED, CAUSE_STEPS = 0.1, 14
# Rounds in which a fit with a cause goes on where it misses something.
MOST_ROUNDS = 2
# Throws of a search, for each movement, after which no further cause is tried and no further fit
# is begun: a model of something else could go on for long and still miss much.
MOST_THROWS = 600
# What a fit with a cause may miss at most, as a share of what one without it does, and of what one
# does whose cause is at its bound [-].
LESS_MISSED, AS_WELL = 0.85, 1.05
# What a cause says of its remedy, and what stands there where the map states a recorder already.
STATE, BESIDE = (
    "state it in the channel map as",
    "beside what the channel map states already; it is",
)
# Difference of the criterion from which on a cause is one.
DECISIVE = 10.0
# The scatter of a slip level from which on it is one [-], of movements that know it to this share
# of what was expected.
LEAST_SCATTER, SAYS_SOMETHING = 5e-3, 0.3


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CauseSearch:
    """Result of a search for causes.

    Attributes
    ----------
    found : Fit
        With all causes that were taken up; near its end.
    first : Misfit
        As a fit with them begins: with the noise of the measurement.
    plain : Misfit
        The same without causes.
    taken : tuple of TestedCause
        Those that were taken up.
    others : tuple of TestedCause
        That explain something, the likeliest first.
    misses : bool
        Whether the model still misses more than other solvers would.
    stopped : int
        Throws after which it was ended with causes untried; 0 where it came to its end.
    """

    found: Fit
    first: Misfit
    plain: Misfit
    taken: tuple[TestedCause, ...] = ()
    others: tuple[TestedCause, ...] = ()
    misses: bool
    stopped: int = 0

    @property
    def tested(self) -> tuple[TestedCause, ...]:
        """Those that were taken up, then the others."""
        return (*self.taken, *self.others)

    def ended(self, final: Fit) -> "CauseSearch":
        """Return the search with its causes as the fit to the end found them."""
        return replace(self, taken=tuple(item.as_fitted(final) for item in self.taken))


def is_worth_a_search(found: Fit, *, share: float = 1.0) -> bool:
    """Return whether a model misses more of a channel than another solver would, or by its gain.

    `share` is how many times as much [-]; from `CLEARLY` on no fit need be finished to see it.
    """
    # A clock that is off is followed as it is.
    if share <= 1.0 and any(
        item.leaves and item.column.kind != CLOCK for item in found_sensors(found)
    ):
        return True
    return bool(missing_more(found.misfit.comparison, found.misfit.movements, share=share))


def first_verdict(found: Fit, *, causes: bool, limit: float) -> str:
    """Return whether a first fit follows, and what comes next, for the screen.

    Parameters
    ----------
    found : Fit
        By throws of the scheme.
    causes : bool
        Whether causes are looked for.
    limit : float
        Of the whole calibration [s].
    """
    peaks = peaks_of(found.misfit.movements)
    missing = [
        f"{channel_name(*key)} misses {100 * missed / peaks[key]:.2g} %"
        for key, missed in missing_more(found.misfit.comparison, found.misfit.movements).items()
    ]
    if not missing:
        return "the first fit follows; fitting to the end"
    upto = f", at most {limit:g} s in all" if limit < float("inf") else ""
    then = f"looking for the cause{upto}" if causes else "causes are not looked for"
    return f"the first fit does not follow: {', '.join(missing)}; {then}"


def ended_reasons(ended: Sequence[str]) -> list[str]:
    """Return why a calibration that was ended after its first fit is not trusted."""
    return [
        f"was ended by {what} after the first fit, so values and intervals are those of then; "
        "calibrate again to go on with the throws that were kept"
        for what in ended
    ]


@one_blas_thread()
def with_causes(
    found: Fit,
    first: Misfit,
    panel: LoadedPanel,
) -> CauseSearch:
    """Test the causes of what a fit misses, and fit the decisive ones together with all values.

    All fits are brief: what a cause explains is seen long before a fit has converged, and one that
    lacks its cause converges slowly.

    Parameters
    ----------
    found : Fit
        Where a brief fit without them ended.
    first : Misfit
        As it began: with the noise of the measurement.
    panel : LoadedPanel
        That is thrown.

    Returns
    -------
    CauseSearch
    """
    plain, taken = first, list[TestedCause]()
    tested: list[TestedCause] = []
    left = candidate_causes(panel, found.parameters, first.movements)
    begun, most = throws_done(first.evaluator), MOST_THROWS * len(first.movements)

    def is_spent() -> bool:
        return throws_done(first.evaluator) - begun >= most

    while (misses := is_worth_a_search(found)) and len(taken) < MOST_CAUSES:
        if is_spent():
            break
        choices = cause_trials(
            found, left, most=min(AT_ONCE, MOST_CAUSES - len(taken)), decisive=DECISIVE
        )
        tested = [
            item
            for choice in choices
            for item in choice
            if item.gain > DECISIVE and not item.cause.is_slight(item.sizes)
        ]
        good = [choice for choice in choices if choice[0].gain > DECISIVE]
        fitted = _likeliest(found, first, one_of_alike(good)[:ATTEMPTS], is_spent)
        if fitted is None:
            break
        found, choice = _best_of_alike(found, first, fitted, good, is_spent)
        for item in choice:
            first = with_cause(first, item.cause)
        taken += choice
        if is_worth_a_search(found):
            found = continued(found, first, rounds=MOST_ROUNDS)
        left = tuple(cause for cause in left if all(cause.goes_with(item.cause) for item in choice))
    # The likeliest of each name, where those that were taken up do not explain what it does.
    others = dict[str, TestedCause]()
    for item in tested if misses else ():
        if item.name not in {known.name for known in taken}:
            others.setdefault(item.name, item)
    return CauseSearch(
        found=found,
        first=first,
        plain=plain,
        taken=tuple(taken),
        stopped=throws_done(first.evaluator) - begun if misses and is_spent() else 0,
        others=tuple(others.values()),
        misses=misses,
    ).ended(found)


def without_needless(
    search: CauseSearch,
    final: Fit,
) -> CauseSearch:
    r"""Leave out causes that the fit to the end does not need, and fit briefly without them.

    A cause is often taken up while another is still unknown. With the sizes `a` of a cause at the
    end, and the information `S` on them that all other values leave, the deviance without it is
    higher by

    .. math:: a^T S a - \ln\det(\Sigma S) - k \ln n

    with the prior variances of those parameters that have one, and the effective samples `n` for
    each of the `k` others. Where that is not decisive, or the sizes are too small to matter, it is
    left out, unless the model then misses more.

    Parameters
    ----------
    search : CauseSearch
        With the causes that were taken up.
    final : Fit
        To the end, with all of them.

    Returns
    -------
    CauseSearch
        The same one where all are needed.
    """
    needed = [item for item in search.taken if is_needed(item.cause, final)]
    if len(needed) == len(search.taken):
        return search
    left_out = [item.cause for item in search.taken if item not in needed]
    first = search.plain
    for item in needed:
        first = with_cause(first, item.cause)
    dropped = {item.name for cause in left_out for item in cause.parameters}
    values = {name: value for name, value in final.values.items() if name not in dropped}
    effects = {
        name: row for name, row in final.misfit.effects.items() if name in first.comparison.scatter
    }
    start = replace(
        final,
        parameters=tuple(item for item in final.parameters if item.name not in dropped),
        values=values,
        misfit=replace(final.misfit, effects=effects),
        local=replace(final.local, stepped={}),
    )
    try:
        found = brief_fit(replace(first, base=values), start)
    except SolverError:
        return search
    slight = all(cause.is_slight_in(final.values) for cause in left_out)
    if not slight and missed_share(found) * LESS_MISSED > missed_share(final):
        return search
    return replace(
        search, found=found, first=first, taken=tuple(needed), misses=is_worth_a_search(found)
    )


def continued(found: Fit, first: Misfit, *, rounds: int) -> Fit:
    """Go on with a fit that misses something, as long as that helps.

    With little of what is missed as noise: a model that lacks nothing leaves it.

    Parameters
    ----------
    found : Fit
        Where it goes on.
    first : Misfit
        With the noise of the measurement.
    rounds : int
        At most.
    """
    for _ in range(rounds):
        before = missed_share(found)
        found = brief_fit(
            replace(first, base=found.values), found, share=LEFT_MISSED, passes=1, steps=CAUSE_STEPS
        )
        if missed_share(found) > LESS_MISSED * before or not is_worth_a_search(found):
            break
    return found


def _likeliest(
    found: Fit,
    first: Misfit,
    choices: Sequence[Sequence[TestedCause]],
    is_spent: Callable[[], bool],
) -> tuple[Fit, Sequence[TestedCause]] | None:
    """Fit with each of the likeliest choices, and return the one with which the model misses least.

    Which it is shows only in what a fit with each still misses. One that comes later has to miss
    clearly less; none is tried after one that leaves nothing to look for.
    """
    best: tuple[Fit, Sequence[TestedCause]] | None = None
    for choice in choices:
        if is_spent() or (best and not is_worth_a_search(best[0])):
            break
        try:
            again = _fitted_with(found, first, choice)
            kept = [item for item in choice if not item.cause.is_slight_in(again.values)]
            if kept and len(kept) < len(choice):
                choice, again = kept, _fitted_with(found, first, kept)
        except SolverError:
            continue
        if kept and missed_share(again) <= LESS_MISSED * missed_share(best[0] if best else found):
            best = again, choice
    return best


def _best_of_alike(
    before: Fit,
    first: Misfit,
    fitted: tuple[Fit, Sequence[TestedCause]],
    choices: Sequence[Sequence[TestedCause]],
    is_spent: Callable[[], bool],
) -> tuple[Fit, Sequence[TestedCause]]:
    """Return the fit that misses least of one with a cause and those with others much alike.

    A mean over the past and filters of a recorder delay forces alike; which it is shows only in
    what a fit with each still misses, or in a lead of the motors that but one of them needs.
    """
    found, choice = fitted
    taken = choice[0].cause
    # One at its bound is another: a bushing without stiffness is play.
    bound = any(item.at_bound(found.values[item.name]) for item in taken.parameters)
    if not taken.group:
        return fitted
    with_lead = needs_lead(found)
    if not (bound or with_lead or is_worth_a_search(found)):
        return fitted
    for other in choices:
        cause = other[0].cause
        if len(other) > 1 or cause is taken or cause.group != taken.group:
            continue
        if is_spent():
            break
        try:
            again = _fitted_with(before, first, other)
        except SolverError:
            continue
        again_with_lead = needs_lead(again)
        # A lead is one more unknown: a fit that needs none may miss as much as one that does.
        if again_with_lead == with_lead:
            better = missed_share(again) < missed_share(found) * (AS_WELL if bound else 1.0)
        elif with_lead:
            better = missed_share(again) <= AS_WELL * missed_share(found)
        else:
            better = AS_WELL * missed_share(again) < missed_share(found)
        if better:
            found, choice, bound, with_lead = again, other, False, again_with_lead
    return found, choice


def missed_share(found: Fit) -> float:
    """Return what a fit misses of all channels, as shares of their peaks [-]."""
    comparison = found.misfit.comparison
    return sum(
        model_error(comparison, key) / max(peak, 1.0)
        for key, peak in peaks_of(found.misfit.movements).items()
    )


def _fitted_with(found: Fit, first: Misfit, choice: Sequence[TestedCause]) -> Fit:
    """Fit all values together with causes, from where both are."""
    values, vary = dict(found.values), list(found.parameters)
    effects, scatter = dict(found.misfit.effects), dict(found.misfit.comparison.scatter)
    misfit = first
    for item in choice:
        cause = item.cause
        if not cause.parameters:
            (level,) = cause.scatter
            effects[level] = own_levels(found, level.split(".")[1])[level]
        values |= item.values
        vary += cause.parameters
        scatter |= cause.scatter
        misfit = with_cause(misfit, cause)
    misfit = replace(misfit, base=values)
    kept = replace(misfit.comparison, noise=found.misfit.comparison.noise, scatter=scatter)
    start = replace(
        found,
        parameters=tuple(vary),
        values=values,
        misfit=replace(misfit, comparison=kept, effects=effects),
        local=replace(found.local, stepped={}),
    )
    again = brief_fit(misfit, start, share=LEFT_MISSED, passes=1, steps=CAUSE_STEPS)
    own = sought_effects(again)
    if own == again.misfit.effects:
        return again
    start = replace(again, misfit=replace(again.misfit, effects=own))
    return brief_fit(misfit, start, share=LEFT_MISSED, passes=1, steps=CAUSE_STEPS)


def cause_lines(
    final: Fit, search: CauseSearch | None, sensors: Sequence[FoundSensor]
) -> tuple[str, ...]:
    """Return what the panel alone does not follow, a lead of the motors first, sensors last.

    Parameters
    ----------
    final : Fit
        With the lead that it found.
    search : CauseSearch, optional
        With the causes that were tested.
    sensors : sequence of FoundSensor
        Gains, zeros and clock as found.
    """
    lead = final.misfit.comparison.lead
    lines = [lead_text(lead)] if lead else []
    stated = any(s.recorder for item in final.misfit.movements for s in item.signals)
    for item in search.tested if search else ():
        lines.append(item.line.replace(STATE, BESIDE) if stated else item.line)
    if search is not None and search.stopped:
        lines.append(
            f"search: ended after {search.stopped} throws, {MOST_THROWS} a movement at most, "
            "with causes that were not tried; the panel is likely to be of another switch"
        )
    return (*lines, *(f"{item.cause}: {item.text}" for item in sensors if item.cause))


def is_needed(cause: Cause, final: Fit) -> bool:
    """Return whether a fit to the end shows that a cause is one."""
    if not cause.parameters:
        return any(_scatters(name, final) for name in cause.scatter)
    if cause.is_slight_in(final.values):
        return False
    places = {item.name: number for number, item in enumerate(final.parameters)}
    sized = cause.parameters if cause.smooth else cause.parameters[:1]
    own = [places[item.name] for item in sized]
    rest = [number for number in range(len(places)) if number not in own]
    J = np.vstack([final.jacobian, np.diag(prior_slopes(final.parameters))])
    H = J.T @ J
    S = (
        H[np.ix_(own, own)]
        - H[np.ix_(own, rest)]
        @ np.linalg.lstsq(H[np.ix_(rest, rest)], H[np.ix_(rest, own)], rcond=None)[0]
    )
    a = np.array(
        [item.coordinate(final.values[item.name]) - item.coordinate(item.start) for item in sized]
    )
    samples = effective_samples(final.frame.alignments, final.misfit.comparison)
    known = [n for n, item in enumerate(sized) if item.prior > 0.0]
    widths = np.array([sized[n].prior_width for n in known])
    gain = float(a @ S @ a) - (len(sized) - len(known)) * float(np.log(samples))
    gain -= float(np.linalg.slogdet(S[np.ix_(known, known)] * np.outer(widths, widths))[1])
    return gain > DECISIVE


def _scatters(name: str, final: Fit) -> bool:
    """Return whether the values of those movements that say something of them differ.

    The scatter that a fit states keeps a part of what was expected, also where there is none.
    """
    expected = final.misfit.comparison.scatter[name]
    known = [
        mean
        for alignment in final.frame.alignments
        for mean, deviation in [alignment.estimates.get(name, (0.0, np.inf))]
        if deviation < SAYS_SOMETHING * expected
    ]
    return bool(known) and float(np.sqrt(np.mean(np.square(known)))) > LEAST_SCATTER
