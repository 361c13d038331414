"""The causes of a misfit in words, and what to do about them."""

from collections.abc import Sequence

from turnout.calibration.causes import MOST_THROWS, CauseSearch
from turnout.calibration.fit import Fit
from turnout.calibration.sensors import FoundSensor, lead_text

# What a cause says of its remedy, and what stands there where the map states a recorder already.
STATE, BESIDE = (
    "state it in the channel map as",
    "beside what the channel map states already; it is",
)


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
