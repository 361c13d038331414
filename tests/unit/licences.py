"""Which licences packages may have, what their wheels bundle, and the page that names both.

``python -m tests.unit.licences`` writes docs/project/licences.md from what is installed; rows of
packages that are not installed here (other extras, other systems) stay as they are.
"""

import re
import sys
from functools import cache
from importlib.metadata import Distribution, distributions
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "project" / "licences.md"
CONSTRAINTS = ROOT / "constraints.txt"

PERMISSIVE = {
    *("0BSD", "Apache-2.0", "BSD", "BSD-2-Clause", "BSD-3-Clause", "CC0-1.0", "HPND", "ISC"),
    *("MIT", "MIT-0", "MIT-CMU", "PSF", "PSF-2.0", "Unlicense", "Zlib"),
    *("Apache-2.0 WITH LLVM-exception", "Public domain"),
}
"""What any part may have."""

WEAK = {
    "certifi": "MPL-2.0",
    "hypothesis": "MPL-2.0",
    "pathspec": "MPL-2.0",
    "asammdf": "LGPL-3.0-or-later",
    "npTDMS": "LGPL-3.0-only",
    "dwdatareader": "MIT, around a closed library of Dewesoft",
    "exudyn": "its own, like BSD-3-Clause",
    "openseespy": "its own: commercial redistribution needs a licence",
    "openseespylinux": "its own: commercial redistribution needs a licence",
}
"""Licences that ask for more; such a package may not be needed by the core."""

STATED: dict[str, str] = {
    # name: what the licence file says where the metadata do not
    "docutils": "Public domain AND BSD-2-Clause",
}

NOT_HERE = {
    "appnope": "BSD-2-Clause",
    "cffi": "MIT-0",
    "colorama": "BSD",
    "pycparser": "BSD-3-Clause",
}
"""Packages of other systems, read from their metadata once."""

OF_PYTHON = {"pip", "setuptools", "wheel", "turnout", "uv"}
"""Not in constraints.txt: what makes the environment, and this project."""

SPOKEN = {
    "Apache Software License": "Apache-2.0",
    "Apache 2.0": "Apache-2.0",
    "BSD License": "BSD",
    "BSD 3-Clause": "BSD-3-Clause",
    "ISC License (ISCL)": "ISC",
    "ISC License": "ISC",
    "MIT License": "MIT",
    "Python Software Foundation License": "PSF",
    "GNU Lesser General Public License v3 or later (LGPLv3+)": "LGPL-3.0-or-later",
    "Mozilla Public License 2.0 (MPL 2.0)": "MPL-2.0",
    "Historical Permission Notice and Disclaimer (HPND)": "HPND",
}
"""Names in the metadata of older packages, and what they are."""


class Bundled(NamedTuple):
    """A library in a wheel: its name as a pattern, what it is, its licence."""

    pattern: str
    what: str
    licence: str


COPYLEFT = [
    Bundled(r"libgfortran", "GNU Fortran runtime", "GPL-3.0 with the GCC runtime exception"),
    Bundled(r"libquadmath", "quadruple precision", "LGPL-2.1-or-later"),
    Bundled(r"libgomp", "GNU OpenMP runtime", "GPL-3.0 with the GCC runtime exception"),
    Bundled(r"libgcc_s", "GCC runtime", "GPL-3.0 with the GCC runtime exception"),
    Bundled(r"libgeos(_c)?|geos(_c)?", "GEOS", "LGPL-2.1"),
    Bundled(r"libzmq", "ZeroMQ", "MPL-2.0"),
]
"""Libraries whose licences ask for more; they are linked at run time and can be replaced."""

PERMISSIVE_LIBRARIES = {
    **dict.fromkeys(("libaec", "libsz"), "BSD-2-Clause"),
    **dict.fromkeys(("libhdf5", "libhdf5_hl"), "BSD-3-Clause"),
    **dict.fromkeys(("libscipy_openblas", "libscipy_openblas64_"), "BSD-3-Clause"),
    **dict.fromkeys(("libXau", "libxcb", "libharfbuzz", "liblcms2"), "MIT"),
    **dict.fromkeys(("libavif", "libopenjp2"), "BSD-2-Clause"),
    **dict.fromkeys(("libbrotlicommon", "libbrotlidec"), "MIT"),
    **dict.fromkeys(("libwebp", "libwebpdemux", "libwebpmux", "libsharpyuv", "libzstd"), "BSD"),
    "libfreetype": "FTL, like BSD",
    "libjpeg": "IJG, BSD-3-Clause and Zlib",
    "libglfw": "Zlib",
    "liblzma": "0BSD",
    "libpng16": "libpng",
    "libtiff": "libtiff, like MIT",
    "libsodium": "ISC",
}
"""Libraries in folders `*.libs` of wheels that ask for no more than their notice."""

STATIC = [
    ("lxml", "GNU libiconv, in wheels for macOS and Windows", "LGPL-2.1"),
]
"""Bundled without a file of its own, so that no test can see it."""


def canonical(name: str) -> str:
    """Return a name in the form that indexes use."""
    return re.sub(r"[-_.]+", "-", name).lower()


def installed() -> list[Distribution]:
    """Return what is installed here, by name."""
    found = {canonical(item.metadata["Name"]): item for item in distributions()}
    return [found[name] for name in sorted(found)]


@cache
def groups() -> dict[str, set[str]]:
    """Return who needs each package of constraints.txt: "core", "build" or extras."""
    sys.path.insert(0, str(ROOT / "bin"))
    from pin import blocks, name_of  # a script, not a package

    found: dict[str, set[str]] = {}
    for block, needed_by in blocks(CONSTRAINTS.read_text(encoding="utf-8")):
        found.setdefault(name_of(block), set()).update(needed_by)
    return found


def licence_of(item: Distribution) -> str:
    """Return the licence of a package in one line, as SPDX where that is known; else empty."""
    metadata = item.metadata
    name = metadata["Name"]
    for known in (WEAK, STATED):
        if name in known:
            return known[name]
    if expression := metadata.get("License-Expression"):
        return str(expression)
    classes = [
        text.rsplit(" :: ", 1)[1]
        for text in metadata.get_all("Classifier") or []
        if text.startswith("License :: OSI Approved :: ")
    ]
    spoken = [*classes, (metadata.get("License") or "").split("\n")[0].strip()]
    for text in filter(None, spoken):
        short = SPOKEN.get(text, text)
        if set(parts(short)) <= PERMISSIVE:
            return short
    return ""


def parts(expression: str) -> list[str]:
    """Return the single licences of an SPDX expression.

    >>> parts("BSD-2-Clause AND (MIT OR Apache-2.0 WITH LLVM-exception)")
    ['BSD-2-Clause', 'MIT', 'Apache-2.0 WITH LLVM-exception']
    """
    return [part.strip(" ()") for part in re.split(r" AND | OR ", expression)]


@cache
def libraries(item: Distribution) -> tuple[str, ...]:
    """Return the shared libraries of a wheel: all in its `*.libs`, copyleft ones anywhere."""
    found = []
    for file in item.files or []:
        name = re.split(r"[-.]", file.name)[0]
        folder = file.parts[0] if len(file.parts) > 1 else ""
        own = folder.endswith(".libs") or ".dylibs" in file.parts
        shared = re.search(r"\.(so|dylib|dll)\b", file.name)
        if own or (shared and any(re.fullmatch(known.pattern, name) for known in COPYLEFT)):
            found.append(name)
    return tuple(found)


def bundled_licence(library: str) -> str:
    """Return the licence of a bundled library; empty where it has not been looked up."""
    for known in COPYLEFT:
        if re.fullmatch(known.pattern, library):
            return known.licence
    return PERMISSIVE_LIBRARIES.get(library, "")


def rows() -> dict[str, str]:
    """Return a line of the page for each package of constraints.txt that is installed here."""
    needed = groups()
    found = {}
    for item in installed():
        name = canonical(item.metadata["Name"])
        if name in needed:
            found[name] = row(name, licence_of(item), needed[name])
    return found


def row(name: str, licence: str, needed_by: set[str]) -> str:
    """Return a line of the page."""
    return f"| {name} | {licence} | {', '.join(sorted(needed_by))} |"


def copyleft_rows() -> list[str]:
    """Return a line for each copyleft library that wheels installed here bring."""
    found = []
    for item in installed():
        for known in COPYLEFT:
            names = sorted({lib for lib in libraries(item) if re.fullmatch(known.pattern, lib)})
            if names:
                place = canonical(item.metadata["Name"])
                found.append(
                    f"| {place} | `{'`, `'.join(names)}` | {known.what} | {known.licence} |"
                )
    return found


HEAD = """# Licences

turnout is under BSD-3-Clause, and so is all that it carries except the plotting library of its
pages (MIT, in `src/turnout/figures/report/vendor`). It contains none of the packages below; they
are installed beside it. What the core needs is permissive; a licence that asks for more is only in
an extra. A test compares this page with what is installed.

## Libraries in wheels

Some wheels carry shared libraries under other licences than their own. If you pass on an
environment, such as a container, you pass on these too; each is linked at run time and can be
replaced.

| package | files | what | licence |
|---|---|---|---|
"""


def page() -> str:
    """Return the page: rows of what is installed, and those that were there of all else."""
    needed = groups()
    before = PAGE.read_text(encoding="utf-8").splitlines() if PAGE.exists() else []
    table = {line.split("|")[1].strip(): line for line in before if line.count("|") == 4}
    table |= {name: row(name, text, needed[name]) for name, text in NOT_HERE.items()}
    table |= rows()
    here = {canonical(item.metadata["Name"]) for item in installed()}
    elsewhere = [
        line
        for line in before
        if line.count("|") == 5 and "`" in line and line.split("|")[1].strip() not in here
    ]
    lines = [HEAD + "\n".join(sorted(copyleft_rows() + elsewhere))]
    lines += [
        f"| {name} | in its own files | {what} | {licence} |" for name, what, licence in STATIC
    ]
    lines += ["", "## Packages", "", "| package | licence | for |", "|---|---|---|"]
    lines += [table.get(name, row(name, "?", needed[name])) for name in sorted(needed)]
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
