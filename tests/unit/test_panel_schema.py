"""The JSON schema of panel files: accepts the library, refuses what the loader refuses."""

import json
import tomllib
from typing import Any

import pytest

from turnout.panel.load import library_names, library_text
from turnout.panel.model import FAMILIES
from turnout.panel.schema import panel_schema

SCHEMA = panel_schema()
TYPES = {
    "object": dict,
    "array": list,
    "string": str,
    "number": int | float,
    "integer": int,
    "boolean": bool,
}


def faults(value: Any, schema: dict[str, Any], path: str = "") -> list[str]:
    """Validate against the part of JSON schema that is in use; any other keyword is an error."""
    known = {
        "$ref", "$defs", "$schema", "title", "description", "default", "examples", "type", "enum",
        "const", "anyOf", "oneOf", "properties", "additionalProperties", "required", "items",
        "minItems", "maxItems", "minLength", "minimum", "maximum", "exclusiveMinimum",
        "exclusiveMaximum",
    }  # fmt: skip
    assert set(schema) <= known, set(schema) - known
    if "$ref" in schema:
        return faults(value, SCHEMA["$defs"][schema["$ref"].removeprefix("#/$defs/")], path)
    for key in ("anyOf", "oneOf"):
        if key in schema and all(faults(value, form, path) for form in schema[key]):
            return [f"{path}: fits none of the forms"]
    if "type" in schema and (
        not isinstance(value, TYPES[schema["type"]])
        or isinstance(value, bool) != (schema["type"] == "boolean")
    ):
        return [f"{path}: must be {schema['type']}"]
    if "const" in schema and value != schema["const"]:
        return [f"{path}: must be {schema['const']}"]
    if "enum" in schema and value not in schema["enum"]:
        return [f"{path}: must be one of {schema['enum']}"]
    if schema.get("type") == "number" and not (
        schema.get("minimum", value) <= value <= schema.get("maximum", value)
        and schema.get("exclusiveMinimum", value - 1) < value
        and value < schema.get("exclusiveMaximum", value + 1)
    ):
        return [f"{path}: out of bounds"]
    found = []
    if isinstance(value, list):
        if len(value) < schema.get("minItems", 0):
            found.append(f"{path}: too short")
        for number, item in enumerate(value):
            found += faults(item, schema.get("items", {}), f"{path}.{number}")
    if isinstance(value, dict):
        found += [
            f"{path}: {key} is missing" for key in schema.get("required", []) if key not in value
        ]
        more = schema.get("additionalProperties", {})
        for key, item in value.items():
            inner = schema.get("properties", {}).get(key, more)
            place = f"{path}.{key}"
            found += [f"{place}: unknown"] if inner is False else faults(item, inner, place)
    return found


@pytest.mark.parametrize("name", library_names())
def test_library_files_fit_the_schema(name: str) -> None:
    assert faults(tomllib.loads(library_text(name)), SCHEMA) == []


@pytest.mark.parametrize(
    ("old", "new", "fault"),
    [
        ('"1e8 N/m"', "1e8", ".chair.normal_stiffness: must be string"),
        (
            "friction_coefficient = 0.4",
            "friction_coefficient = 3",
            ".chair.friction_coefficient: out",
        ),
        ("friction_coefficient", "friction", ".chair.friction: must be object"),
        ('starts = "open"', 'starts = "ajar"', ".schedule.starts: must be one of"),
        ('rule = "no slip"', 'rules = "no slip"', ".lock.rules: unknown"),
        ("schema_version = 1", "schema_version = 2", ".schema_version: must be 1"),
        ('gravity = "9.81 m/s^2"', "", ": gravity is missing"),
        ("[drive.1]", '[drive.1]\nmass = "1 kg"', ".drive.1.mass: unknown"),
        ("count = 16", 'count = "16"', ".chair.x: fits none of the forms"),
    ],
)
def test_wrong_files_do_not_fit(old: str, new: str, fault: str) -> None:
    text = library_text("sb1")
    assert old in text
    found = faults(tomllib.loads(text.replace(old, new, 1)), SCHEMA)
    assert any(item.startswith(fault) for item in found), found


def test_schema_is_plain_json_and_has_all_families() -> None:
    assert json.loads(json.dumps(SCHEMA)) == SCHEMA
    for family in FAMILIES:
        assert "properties" in SCHEMA["properties"][family]


def test_every_field_is_described_and_every_quantity_names_its_unit() -> None:
    records = {name: schema["properties"] for name, schema in SCHEMA["$defs"].items()}
    for record, properties in records.items():
        for name, schema in properties.items():
            assert schema.get("description"), f"{record}.{name} has no description"
            quantity = "examples" in schema or "examples" in str(schema.get("anyOf", ""))
            if quantity:
                assert "[" in schema["description"], f"{record}.{name} does not name its unit"
