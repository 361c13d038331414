"""Every installed package has a licence that is allowed where it is needed; the page names it."""

from importlib.metadata import Distribution

import pytest
from tests.unit.licences import (
    NOT_HERE,
    OF_PYTHON,
    PAGE,
    PERMISSIVE,
    STATIC,
    WEAK,
    bundled_licence,
    canonical,
    copyleft_rows,
    groups,
    installed,
    libraries,
    licence_of,
    parts,
    rows,
)

INSTALLED = installed()
PINNED = [item for item in INSTALLED if canonical(item.metadata["Name"]) in groups()]


def name(item: Distribution) -> str:
    return str(item.metadata["Name"])


@pytest.mark.parametrize("item", INSTALLED, ids=name)
def test_the_licence_is_one_that_is_allowed(item: Distribution) -> None:
    licence = licence_of(item)
    assert licence, f"{name(item)} names no licence that is known: {item.metadata.get('License')}"
    if name(item) in WEAK:
        needed_by = groups().get(canonical(name(item)), set())
        assert "core" not in needed_by, f"{name(item)} ({licence}) may not be needed by the core"
        return
    unknown = set(parts(licence)) - PERMISSIVE
    assert not unknown, f"{name(item)}: {unknown} is not on the list of permissive licences"


@pytest.mark.parametrize("item", INSTALLED, ids=name)
def test_every_bundled_library_was_looked_up(item: Distribution) -> None:
    unknown = sorted({library for library in libraries(item) if not bundled_licence(library)})
    assert not unknown, f"{name(item)} brings {unknown}: look up their licences"


def test_all_that_is_installed_is_pinned() -> None:
    loose = {canonical(name(item)) for item in INSTALLED} - set(groups()) - OF_PYTHON
    assert not loose, f"not in constraints.txt: {sorted(loose)}; run bin/pin.py"


def test_the_page_names_every_package_and_every_copyleft_library() -> None:
    page = PAGE.read_text(encoding="utf-8").splitlines()
    wrong = [row for row in [*rows().values(), *copyleft_rows()] if row not in page]
    assert not wrong, "run python -m tests.unit.licences:\n" + "\n".join(wrong)
    missing = [
        name for name in groups() if not any(line.startswith(f"| {name} |") for line in page)
    ]
    assert not missing
    assert not any("| ? |" in line for line in page)
    assert all(any(item in line for line in page) for item in NOT_HERE)
    assert all(any(library in line for line in page) for _, library, _ in STATIC)


@pytest.mark.parametrize(
    ("library", "licence"),
    [("libgfortran", "GPL-3.0"), ("libquadmath", "LGPL-2.1"), ("libgeos_c", "LGPL-2.1")],
)
def test_copyleft_libraries_are_named_so(library: str, licence: str) -> None:
    assert licence in bundled_licence(library)
    assert bundled_licence("libunheard") == ""


@pytest.mark.parametrize(("licence", "allowed"), [("MIT", True), ("GPL-3.0-only", False)])
def test_a_copyleft_licence_is_not_permissive(licence: str, allowed: bool) -> None:
    assert (set(parts(licence)) <= PERMISSIVE) == allowed
