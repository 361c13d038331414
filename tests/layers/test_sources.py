"""Digests of sources name every package that makes what is kept under them."""

from pathlib import Path

import pytest
from benchmarks.census import import_graph

from turnout.core.sources import KERNELS, RAILS, THROWS, digest_of_sources

SRC = Path(__file__).parents[2] / "src" / "turnout"


def module_of(path: Path) -> str:
    return ".".join(path.relative_to(SRC).with_suffix("").parts)


MODULES = {module_of(path): path for path in SRC.rglob("*.py")}
IMPORTS = {
    module_of(path): {module_of(other) for other in others}
    for path, others in import_graph(SRC).items()
}
# Messages and loading change no number; a calibration gives values, which are part of a study.
WITHOUT_NUMBERS = {"calibration"}


def closure(*first: str) -> set[str]:
    """Return the modules that some modules need, themselves included."""
    found, left = set(first), list(first)
    while left:
        for name in IMPORTS[left.pop()]:
            if name not in found and name.split(".")[0] not in WITHOUT_NUMBERS:
                found.add(name)
                left.append(name)
    return found


def covered(module: str, packages: tuple[str, ...]) -> bool:
    place = module.replace(".", "/")
    return any(place.startswith(f"{package}/") or f"{place}.py" == package for package in packages)


def test_every_compiled_module_is_in_the_digest_of_kernels() -> None:
    uses = {name for name, path in MODULES.items() if "turnout.kernels." in path.read_text("utf-8")}
    compiled = {name for name in uses if "\n@compiled" in MODULES[name].read_text("utf-8")}
    assert len(compiled) > 20
    assert {name for name in compiled if not covered(name, KERNELS)} == set()


def test_every_module_behind_a_stored_throw_is_in_its_digest() -> None:
    needed = closure("study.sweep.row", "study.sweep.labels")
    assert {name for name in needed if not covered(name, THROWS)} == set()


def test_rails_are_made_of_what_their_digest_names() -> None:
    # Panels and the machines in them give numbers, which are part of the keys where they shape
    # rails; core gives caches, laws are not reduced.
    outside = {"core", "panel", "machine", "law", "kernels"}
    needed = closure("mechanism.reduce", "mechanism.rail_sections")
    rest = {name for name in needed if name.split(".")[0] not in outside}
    assert {name for name in rest if not covered(name, RAILS)} == set()


@pytest.mark.parametrize("packages", [KERNELS, RAILS, THROWS])
def test_every_place_exists(packages: tuple[str, ...]) -> None:
    assert [name for name in packages if not (SRC / name).exists()] == []


def test_a_digest_knows_its_packages_apart() -> None:
    assert len({digest_of_sources(packages) for packages in (KERNELS, RAILS, THROWS)}) == 3
