"""Response of a recorder to forces, from typed options."""

from typing import Any

from pydantic import ValidationError

from turnout.core.errors import FileError, TurnoutError
from turnout.core.toml import parse_toml
from turnout.measurement.chain.channel_map import ChannelMap
from turnout.measurement.chain.map_problems import map_problem
from turnout.measurement.chain.recorder_response import LEAST_INTERVAL, RecorderResponse


def typed_recorder(
    *, average: str | None = None, low_pass: str | None = None, rate: str | None = None
) -> RecorderResponse:
    """Return a recorder's response from the texts that a channel map takes.

    Parameters
    ----------
    average, rate : str, optional
        Such as "0.1 s" and "20 Hz".
    low_pass : str, optional
        A corner frequency, "6 Hz", or as in a channel map, '{ kind = "rc", corner = "6 Hz" }'.

    Raises
    ------
    FileError
        With all problems.

    Examples
    --------
    >>> typed_recorder(low_pass="6 Hz", average="0.1 s").text
    'a Butterworth low-pass of order 2 at 6 Hz, a mean over the last 0.1 s'
    """
    given: dict[str, Any] = {"recorded_average": average, "recorded_rate": rate}
    problems = []
    if low_pass is not None:
        try:
            given["recorded_filter"] = _filter_table(low_pass)
        except TurnoutError:
            problems.append(
                f"--recorded-filter {low_pass}: must be a corner frequency such as '6 Hz', or a "
                'table as in a channel map: \'{ kind = "bessel", order = 4, corner = "6 Hz" }\''
            )
    stated: dict[str, Any] = {}
    for key, value in given.items():
        try:
            stated[key] = getattr(ChannelMap.model_validate({key: value}), key)
        except ValidationError as error:
            found = [map_problem(item) for item in error.errors(include_url=False)]
            problems += [f"--{text.replace('_', '-', 1)}" for text in dict.fromkeys(found)]
    if (stated.get("recorded_rate") or 0.0) * LEAST_INTERVAL >= 1.0:
        problems.append(
            f"--recorded-rate {rate}: must be below {1.0 / LEAST_INTERVAL:g} Hz; "
            "closer samples change nothing that is compared"
        )
    if problems:
        raise FileError("\n".join(problems))
    return ChannelMap.model_validate(given).recorder_response()


def _filter_table(text: str) -> object:
    if not text.strip().startswith("{"):
        return {"corner": text}
    return parse_toml(f"recorded_filter = {text}", source="--recorded-filter").data[
        "recorded_filter"
    ]
