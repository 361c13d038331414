"""Whether a fit to the end needs a cause that was taken up on the way."""

import numpy as np

from turnout.calibration.cause import Cause
from turnout.calibration.fit import Fit
from turnout.calibration.parameter import prior_slopes
from turnout.calibration.shared import effective_samples

# Difference of the criterion from which on a cause is one.
DECISIVE = 10.0
# The scatter of a slip level from which on it is one [-], of movements that know it to this share
# of what was expected.
LEAST_SCATTER, SAYS_SOMETHING = 5e-3, 0.3


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
    if cause.about_mean:
        a = a - a.mean()
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
