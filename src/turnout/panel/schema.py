"""JSON schema of a panel file as a user writes it, for editors that complete and check TOML."""

from typing import Any

from pydantic import TypeAdapter

from turnout.core.quantity import LengthList
from turnout.panel.document import is_generated
from turnout.panel.model import FAMILIES, Panel

DRAFT = "https://json-schema.org/draft/2020-12/schema"


def panel_schema() -> dict[str, Any]:
    """Give the JSON schema of a panel file.

    A family may hold defaults, a generator of positions, and members that give only what differs;
    that a value is present at all is therefore checked when the file is loaded, not here.

    Returns
    -------
    dict
        A JSON schema, draft 2020-12.

    Examples
    --------
    >>> panel_schema()["properties"]["chair"]["properties"]["friction_coefficient"]["maximum"]
    2
    """
    schema = Panel.model_json_schema(mode="validation")
    definitions: dict[str, Any] = schema["$defs"]
    for name, family in FAMILIES.items():
        record = definitions[family.__name__]
        schema["properties"][name] = _family_schema(name, record, schema["properties"][name])
    for name in {family.__name__ for family in FAMILIES.values()}:
        definitions[name].pop("required", None)
    tidy(schema)
    return {"$schema": DRAFT, **schema, "title": "turnout panel"}


def _family_schema(name: str, record: dict[str, Any], family: dict[str, Any]) -> dict[str, Any]:
    """Describe a family: defaults and generator beside its members."""
    properties = dict(record["properties"])
    if is_generated(name):
        generator = TypeAdapter(LengthList).json_schema()
        generator["description"] = (
            "positions of the members [m]: a list, {start, step, count} or {unit, values}; "
            "one text is a default"
        )
        properties["x"] = generator
        properties["names"] = {
            "type": "array",
            "items": {"type": "string"},
            "description": 'names of the generated members, default "1", "2", ...',
        }
    return {
        "type": "object",
        "description": f"{record.get('description', name)} Defaults here, members below.",
        "properties": properties,
        "additionalProperties": family["additionalProperties"],
    }


def tidy(node: Any) -> None:
    """Take out entries for the records alone: titles, SI defaults, and nulls that TOML lacks."""
    if isinstance(node, list):
        for item in node:
            tidy(item)
        return
    if not isinstance(node, dict):
        return
    if not isinstance(node.get("default", {}), dict):
        plain = node.get("type") in ("number", "boolean")
        has_unit = not plain and isinstance(node["default"], int | float | list)
        if node["default"] is None or has_unit:
            del node["default"]
    forms = node.get("anyOf")
    if isinstance(forms, list):
        kept = [form for form in forms if form != {"type": "null"}]
        node["anyOf"] = kept
        if len(kept) == 1:
            del node["anyOf"]
            node.update({key: item for key, item in kept[0].items() if key not in node})
    for stray in ("title", "gt", "ge", "lt", "le"):
        if isinstance(node.get(stray), str | int | float):
            del node[stray]
    for item in node.values():
        tidy(item)
