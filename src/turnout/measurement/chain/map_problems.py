"""Faults of a channel map, in words."""

from typing import Any

from turnout.core.problems import choices, describe_error, nearest
from turnout.measurement.chain.channel_map import KINDS, ChannelMap, SensorRecord


def map_problem(error: Any) -> str:
    """Return key path and fault, without the kind that pydantic puts into the path."""
    path = [str(part) for part in error["loc"]]
    kind = next((part for part in path if part in KINDS), None)
    keys = [part for part in path if part != kind]
    fields = KINDS[kind].model_fields if kind else ChannelMap.model_fields
    if error["type"] == "union_tag_not_found":
        return f"{'.'.join(keys)}: kind is missing; must be {choices(KINDS)}"
    if error["type"] == "union_tag_invalid":
        tag = error["ctx"]["tag"]
        return f'{".".join(keys)}.kind = "{tag}": must be {choices(KINDS)}{nearest(tag, KINDS)}'
    return ".".join(keys) + describe_error(error, allowed=fields) + _hint(error, keys)


def _hint(error: Any, keys: list[str]) -> str:
    """Return a hint on the table of a misplaced key or the form of a share, else an empty text."""
    key = keys[-1]
    if error["type"] == "extra_forbidden":
        if len(keys) > 1 and key in ChannelMap.model_fields:
            return "; it belongs above the first table of the map"
        if len(keys) == 1 and key in SensorRecord.model_fields:
            return "; it belongs into the table of a channel"
    if key.endswith("_uncertainty"):
        return "; it is a share: 0.02 for 2 %, 1e-5 for 10 ppm"
    return ""
