"""Provenance."""

import pytest

from turnout.core.provenance import content_hash, provenance


def test_hash_depends_on_content_not_on_order() -> None:
    base = {"a": 1.0, "b": {"c": [0.1, 0.2]}}
    assert content_hash(base) == content_hash({"b": {"c": (0.1, 0.2)}, "a": 1.0})
    assert content_hash(base) != content_hash({"a": 1.0, "b": {"c": [0.2, 0.1]}})
    assert content_hash(base) != content_hash({"a": 1.0, "b": {"c": [0.1, 0.2 + 1e-16 * 2]}})


def test_hash_refuses_what_has_no_json() -> None:
    with pytest.raises(ValueError, match="not JSON compliant"):
        content_hash({"a": float("nan")})


def test_provenance_names_program_and_machine() -> None:
    assert all(provenance().values())
