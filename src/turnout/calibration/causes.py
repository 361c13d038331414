"""Why a model does not follow: likely causes, each tested by a fit with one more parameter.

A cause is a parameter that the panel does not have, or that a calibration usually takes as known: a
recorder that averages, a bushing that is soft at first, rails of another stiffness, friction that
rises along the switch, a slip level of its own in each throw. Each is tried at a few sizes, with
the other values adjusted to first order, and judged by the Bayesian information criterion. One that
is decisively better is fitted together with all values, so that they are freed of its effect.
"""

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import reduce

import numpy as np
from numpy.typing import NDArray

from turnout.calibration.candidate_causes import Cause, candidate_causes
from turnout.calibration.cause_trials import (
    TestedCause,
    cause_trials,
    deviance,
    of_sizes,
    one_of_alike,
    own_levels,
    with_cause,
)
from turnout.calibration.comparison import peaks_of
from turnout.calibration.covariance import Rival
from turnout.calibration.evaluate import throws_done
from turnout.calibration.fit import Fit, brief_fit, fit, sought_effects
from turnout.calibration.measured_movements import channel_name
from turnout.calibration.misfit import Misfit, framed
from turnout.calibration.sensors import (
    found_sensors,
    lead_text,
    unknown_lead,
)
from turnout.calibration.shared import CLEARLY, CLOCK, missing_more, model_error
from turnout.calibration.stages import (
    coordinates,
    prior_residuals,
)
from turnout.core.errors import SolverError
from turnout.core.threads import one_blas_thread
from turnout.core.value_text import duration_text
from turnout.panel.load import LoadedPanel

Floats = NDArray[np.float64]
# How many causes are taken up at most, and of how many choices the one that misses least.
MOST_CAUSES, ATTEMPTS = 3, 4
# A choice is not fitted that explains less than this share of what the likeliest one does: to first
# order, right causes explained a fifth to all of it [-].
CANNOT_WIN = 0.1
# A size that is further from what is expected, in deviations, is rather that of a cause much alike:
# play was followed as a bushing 1.2 to 2.9 of them too soft before it came to its bound [-].
SURPRISING = 1.0
# How many are taken up in one fit at most.
AT_ONCE = 2
# The share of what a model misses without a cause that is noise in a fit with it [-], and the steps
# of that: with more noise, or with noise found again too early, it would stay where it is.
LEFT_MISSED, CAUSE_STEPS = 0.1, 14
# Rounds in which a fit with a cause goes on where it misses something.
MOST_ROUNDS = 2
# What such a round may leave at most of what was missed, if another is to follow, and what a fit
# with a cause may leave if it goes on at all: one that leaves more lacks another cause [-].
LESS_MISSED, MOSTLY_RIGHT = 0.85, 0.5
# Throws, for each movement, from the first verdict on, after which no further cause is tried and no
# further fit is begun: a model of something else could go on for long and still miss much.
MOST_THROWS = 400
# What a cause says of its remedy, and what stands there where the map states a recorder already.
STATE, BESIDE = (
    "state it in the channel map as",
    "beside what the channel map states already; it is",
)
# Difference of twice the logarithm of evidences from which on a cause is one, and up to which two
# are alike: odds of 1 to 20.
DECISIVE, ALIKE = 10.0, 6.0
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
    rivals : tuple of Rival
        That were about as likely as some of those taken up.
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
    rivals: tuple[Rival, ...] = ()
    misses: bool
    stopped: int = 0

    @property
    def tested(self) -> tuple[TestedCause, ...]:
        """Those that were taken up, then the others."""
        return (*self.taken, *self.others)

    def is_as_likely(self, final: Fit, other: "CauseSearch", its: Fit) -> bool:
        """Return whether a fit with some of the causes of another is as likely as that.

        Causes that are too small to be one are none, however well they follow what is rough.
        """
        left = [item.cause for item in other.taken if item not in self.taken]
        if all(cause.is_slight_in(its.values) for cause in left):
            return True
        mine, yours = ([item.cause for item in some.taken] for some in (self, other))
        return evidence(final, mine) < evidence(its, yours) + DECISIVE

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


def first_verdict(found: Fit, *, causes: bool, most: float) -> str:
    """Return whether a first fit follows, and what comes next, for the screen.

    Parameters
    ----------
    found : Fit
        By throws of the scheme.
    causes : bool
        Whether causes are looked for.
    most : float
        Time that this takes at most, infinite where that is not known [s].
    """
    peaks = peaks_of(found.misfit.movements)
    missing = [
        f"{channel_name(*key)} misses {100 * missed / peaks[key]:.2g} %"
        for key, missed in missing_more(found.misfit.comparison, found.misfit.movements).items()
    ]
    if not missing:
        return "so far the model follows; fitting to the end"
    upto = f", at most {duration_text(most)}" if most < float("inf") else ""
    then = f"looking for the cause{upto}" if causes else "causes are not looked for"
    return f"so far the model does not follow: {', '.join(missing)}; {then}"


@one_blas_thread()
def with_causes(
    found: Fit, first: Misfit, panel: LoadedPanel, *, begun: int | None = None
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
    begun : int, optional
        Throws after which the first fit was seen to miss something; default those so far.

    Returns
    -------
    CauseSearch
    """
    plain, taken = first, list[TestedCause]()
    tested: list[TestedCause] = []
    rivals: list[Rival] = []
    choice: Sequence[TestedCause] = ()
    left = candidate_causes(panel, found.parameters, first.movements)
    before = throws_done(first.evaluator) if begun is None else begun
    most = MOST_THROWS * len(first.movements)

    def is_spent() -> bool:
        return throws_done(first.evaluator) - before >= most

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
        fitted = _fitted_choices(found, first, good, is_spent)
        if not fitted:
            break
        fitted = _gone_on(fitted, found, first, is_spent)
        found, choice = fitted[0].found, fitted[0].choice
        rivals += _rivals(fitted)
        first = with_choice(first, choice)
        taken += choice
        left = tuple(cause for cause in left if all(cause.goes_with(item.cause) for item in choice))
    names = {item.name for item in taken}
    # The likeliest of each name, where those that were taken up do not explain what it does.
    others = dict[str, TestedCause]()
    for item in tested if misses else ():
        if item.name not in names:
            others.setdefault(item.name, item)
    search = CauseSearch(
        found=found,
        first=first,
        plain=plain,
        taken=tuple(taken),
        stopped=throws_done(first.evaluator) - before if misses and is_spent() else 0,
        others=tuple(others.values()),
        rivals=tuple(item for item in rivals if not names.issuperset(item.causes)),
        misses=misses,
    )
    return _without_earlier(search, choice)


def _without_earlier(search: CauseSearch, last: Sequence[TestedCause]) -> CauseSearch:
    """Leave out causes that were taken up before the right one, which explain less than that.

    They would hold back the end, and others with them.
    """
    found = search.found
    earlier = [(explained_by(t.cause, found), t) for t in search.taken if t not in last]
    most = max((explained_by(item.cause, found) for item in last), default=0.0)
    for explained, item in sorted(earlier, key=lambda pair: pair[0]):
        if explained > most:
            break
        fewer = without(search, search.found, [item])
        if not fewer.is_as_likely(fewer.found, search, search.found):
            break
        search = fewer
    return search.ended(search.found)


def without_needless(search: CauseSearch, final: Fit) -> CauseSearch:
    """Leave out causes that the fit to the end does not need, and fit briefly without them.

    A cause is often taken up while another is still unknown. What its sizes explain at the end is
    then no more than they cost, or they are too small to matter.

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
    return without(search, final, [t for t in search.taken if not is_needed(t.cause, final)])


def without(search: CauseSearch, final: Fit, left_out: Sequence[TestedCause]) -> CauseSearch:
    """Fit briefly without some causes, from a fit with them; with none nothing changes."""
    kept = tuple(item for item in search.taken if item not in left_out)
    first = with_choice(search.plain, kept)
    dropped = {own.name for item in left_out for own in item.cause.parameters}
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
    with suppress(SolverError):
        if left_out:
            found = brief_fit(replace(first, base=values), start)
            # Rivals were compared with fits that have all of the causes.
            fewer = replace(search, found=found, first=first, taken=kept, rivals=())
            return replace(fewer, misses=is_worth_a_search(found))
    return search


def with_choice(first: Misfit, choice: Sequence[TestedCause]) -> Misfit:
    """Return a misfit with several causes beside those that it has."""
    return reduce(with_cause, (item.cause for item in choice), first)


def evidence(found: Fit, causes: Sequence[Cause], first: Misfit | None = None) -> float:
    """Return minus twice the logarithm of the evidence for causes by a fit with them (Laplace).

    Where all movements begin later than marked, motors that lead are one unknown more. The fit goes
    on with it from `first` if given, the misfit with the causes and the noise of the measurement:
    what a cause lacks without a lead counts as noise else, and one that delays forces too wins.
    """
    lead = unknown_lead(found)
    if lead:
        misfit = replace(found.misfit, comparison=replace(found.misfit.comparison, lead=lead))
        frame = framed(found.local, misfit, near=found.frame)
        residuals = misfit.residuals_of(found.local.simulated, frame)
        found = replace(found, misfit=misfit, frame=frame, residuals=residuals)
        if first is not None:
            known = replace(first.comparison, lead=lead)
            first = replace(first, base=found.values, comparison=known)
            found = brief_fit(first, found, share=LEFT_MISSED, passes=1, steps=CAUSE_STEPS)
    return deviance(found) + of_sizes(causes, found, more=int(bool(lead)))[1]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FittedChoice:
    """A fit with one choice of causes.

    Attributes
    ----------
    found : Fit
        All values together with the causes.
    choice : sequence of TestedCause
        Those that are no trifles at its end.
    evidence : float
        As of `evidence` [-].
    """

    found: Fit
    choice: Sequence[TestedCause]
    evidence: float


def _rivals(fitted: Sequence[FittedChoice]) -> list[Rival]:
    """Return the choices about as likely as the first of them."""
    best = fitted[0]
    odds = [float(np.exp(0.5 * (best.evidence - found.evidence))) for found in fitted]
    return [
        Rival(
            causes=tuple(cause.name for cause in found.choice),
            text=" and ".join(f"{cause.name}: {cause.text}" for cause in found.choice),
            odds=own,
            probability=own / sum(odds),
            moves={
                item.name: item.coordinate(found.found.values[item.name])
                - item.coordinate(best.found.values[item.name])
                for item in best.found.parameters
                if item.name in {same.name for same in found.found.parameters}
            },
        )
        for found, own in zip(fitted[1:], odds[1:], strict=True)
        if found.evidence < best.evidence + ALIKE
    ]


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
        again = brief_fit(
            replace(first, base=found.values), found, share=LEFT_MISSED, passes=1, steps=CAUSE_STEPS
        )
        before, after = missed_share(found), missed_share(again)
        if after <= before:
            found = again
        if after > LESS_MISSED * before or not is_worth_a_search(found):
            break
    return found


def missed_share(found: Fit) -> float:
    """Return the sum of the model errors of all channels, as shares of their peaks [-]."""
    comparison = found.misfit.comparison
    return sum(
        model_error(comparison, key) / max(peak, 1.0)
        for key, peak in peaks_of(found.misfit.movements).items()
    )


def _fitted_choices(
    found: Fit,
    first: Misfit,
    choices: Sequence[Sequence[TestedCause]],
    is_spent: Callable[[], bool],
) -> list[FittedChoice]:
    """Fit with each of the likeliest choices, and return those with evidence, the likeliest first.

    None is fitted after one that leaves nothing to look for, unless that is as likely to first
    order. Of causes much alike the others are fitted too where the one that was leaves something,
    or is to be doubted.
    """
    least, most = evidence(found, ()), MOSTLY_RIGHT * missed_share(found)
    fitted: list[FittedChoice] = []
    tried: list[Sequence[TestedCause]] = []

    def fit_with(choice: Sequence[TestedCause]) -> None:
        tried.append(choice)
        with suppress(SolverError):
            again = _fitted_with(found, first, choice)
            kept = [item for item in choice if not item.cause.is_slight_in(again.values)]
            if kept and len(kept) < len(choice):
                again = _fitted_with(found, first, kept)
            if not kept:
                return
            causes = [item.cause for item in kept]
            size = evidence(again, causes, with_choice(first, kept))
            if size < least - DECISIVE:
                fitted.append(FittedChoice(found=again, choice=kept, evidence=size))
                fitted.sort(key=lambda item: item.evidence)

    def is_rival(choice: Sequence[TestedCause]) -> bool:
        best = fitted[0]
        return is_worth_a_search(best.found) or _gain(choice) > _gain(best.choice) - ALIKE

    likely = [choice for choice in choices if _gain(choice) > CANNOT_WIN * _gain(choices[0])]
    for choice in one_of_alike(likely)[:ATTEMPTS]:
        if is_spent() or (fitted and not is_rival(choice)):
            break
        fit_with(choice)
    for choice in choices:
        if not fitted or is_spent():
            break
        if choice in tried or not _are_alike(choice, fitted[0].choice):
            continue
        # One that leaves less than half of what was missed is not of too few drives.
        few = _has_drives_of(fitted[0], choice) or missed_share(fitted[0].found) > most
        if (few and choice in likely and is_rival(choice)) or _is_doubted(fitted[0], choice):
            fit_with(choice)
    return fitted


def _gone_on(
    fitted: Sequence[FittedChoice], found: Fit, first: Misfit, is_spent: Callable[[], bool]
) -> list[FittedChoice]:
    """Go on with the likeliest of some choices where it leaves something; the likeliest first.

    Not where it leaves most of what the fit without them did, as that would be slow. So does one
    that is much like it where it is then to be doubted: fits that have not come to their end say
    little of which is the right one.
    """
    gone, most = list(fitted), MOSTLY_RIGHT * missed_share(found)

    def go_on_with(item: FittedChoice) -> None:
        some = is_worth_a_search(item.found) and missed_share(item.found) < most
        if some and not is_spent():
            beside = with_choice(first, item.choice)
            again = continued(item.found, beside, rounds=MOST_ROUNDS)
            size = evidence(again, [own.cause for own in item.choice], beside)
            gone[gone.index(item)] = replace(item, found=again, evidence=size)
            gone.sort(key=lambda item: item.evidence)

    go_on_with(gone[0])
    best = gone[0]
    alike = [item for item in gone[1:] if _are_alike(item.choice, best.choice)]
    for item in alike[:1]:
        if _is_doubted(best, item.choice):
            go_on_with(item)
    return gone


def _are_alike(choice: Sequence[TestedCause], other: Sequence[TestedCause]) -> bool:
    """Return whether two choices are single causes of a group."""
    (one, *further), (two, *more) = choice, other
    return bool(one.cause.group) and one.cause.group == two.cause.group and not (further or more)


def _has_drives_of(item: FittedChoice, choice: Sequence[TestedCause]) -> bool:
    """Return whether a fitted choice is of the drives of another."""
    return item.choice[0].cause.drives == choice[0].cause.drives


def _is_doubted(item: FittedChoice, choice: Sequence[TestedCause]) -> bool:
    """Return whether a cause may rather be that of another choice, of the same drives.

    It is at its bound, which is another (a bushing without stiffness is play), has sizes that are
    not expected or that make up for the shape of another (a filter with few samples), or needs a
    lead of the motors, as those do that delay forces less than the right one.
    """
    found, cause = item.found, item.choice[0].cause
    if not _has_drives_of(item, choice):
        return False
    bound = any(own.at_bound(found.values[own.name]) for own in cause.sized)
    away = prior_residuals(cause.parameters, coordinates(cause.parameters, found.values))
    doubted = bound or cause.doubted(cause.sizes_in(found.values))
    return doubted or bool(np.abs(away).max() > SURPRISING) or bool(unknown_lead(found))


def _gain(choice: Sequence[TestedCause]) -> float:
    """Return the gain of a choice in the criterion, to first order [-]."""
    return sum(item.gain for item in choice)


def _fitted_with(found: Fit, first: Misfit, choice: Sequence[TestedCause]) -> Fit:
    """Fit all values together with causes, from where both are."""
    values, vary = dict(found.values), list(found.parameters)
    effects, scatter = dict(found.misfit.effects), dict(found.misfit.comparison.scatter)
    for item in choice:
        cause = item.cause
        if not cause.parameters:
            (level,) = cause.scatter
            effects[level] = own_levels(found, level.split(".")[1])[level]
        values |= item.values
        vary += cause.parameters
        scatter |= cause.scatter
    misfit = replace(with_choice(first, choice), base=values)
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


def cause_lines(final: Fit, search: CauseSearch | None) -> tuple[str, ...]:
    """Return what the panel alone does not follow, a lead of the motors first, sensors last.

    Parameters
    ----------
    final : Fit
        With the lead that it found.
    search : CauseSearch, optional
        With the causes that were tested.
    """
    lead = final.misfit.comparison.lead
    lines = [lead_text(lead)] if lead else []
    stated = any(s.recorder for item in final.misfit.movements for s in item.signals)
    for item in search.tested if search else ():
        lines.append(item.line.replace(STATE, BESIDE) if stated else item.line)
    lines += [item.line for item in (search.rivals if search else ())]
    if search is not None and search.stopped:
        lines.append(
            f"search: ended after {search.stopped} throws, {MOST_THROWS} a movement at most, "
            "with causes that were not tried; the panel is likely to be of another switch"
        )
    return (*lines, *(f"{item.cause}: {item.text}" for item in found_sensors(final) if item.cause))


def is_needed(cause: Cause, final: Fit) -> bool:
    """Return whether a fit to the end shows that a cause is one."""
    if not cause.parameters:
        return any(_scatters(name, final) for name in cause.scatter)
    return not cause.is_slight_in(final.values) and explained_by(cause, final) > DECISIVE


def explained_by(cause: Cause, found: Fit) -> float:
    """Return the deviance of a fit that sizes of a cause explain beyond their cost."""
    explained, cost = of_sizes([cause], found)
    return explained - cost


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


# Rounds of a first fit that misses something at most.
FIRST_ROUNDS = 3


def first_fit(start: Misfit, near: Fit, found: Fit) -> Fit:
    """Go on with a first fit that misses something, before causes are looked for.

    By slopes of plain throws, with little of what is missed as noise, as long as that helps: a
    model that lacks nothing leaves it.

    Parameters
    ----------
    start : Misfit
        With the noise of the measurement.
    near : Fit
        By plain throws at the values of a fit by quick ones, and with its slopes.
    found : Fit
        Where those slopes led, which is where it ends if nothing is missed.
    """
    if is_worth_a_search(found):
        bare = replace(found, local=replace(found.local, stepped={}))
        again = continued(bare, start, rounds=FIRST_ROUNDS)
        found = found if again is bare else again
    if not is_worth_a_search(found, share=CLEARLY):
        return found
    return _gone_to_its_end(start, near) or found


def _gone_to_its_end(start: Misfit, near: Fit) -> Fit | None:
    """Return a fit to its end if that misses no more than another solver would.

    Where values and each movement's friction are off together, brief fits leave that so slowly that
    the model seems to lack something, and causes that are not there would be taken up.
    """
    try:
        whole = fit(start, near.parameters, near.values, near=near, refined=False)
    except SolverError:
        return None
    return None if is_worth_a_search(whole) else whole
