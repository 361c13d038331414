"""Keep constraints.txt: one version of each package, with the digests of all its files.

    python bin/pin.py              # look up the digests again, versions as they are
    python bin/pin.py --newest     # the newest of everything that pyproject.toml allows
    python bin/pin.py --print uq   # what pip needs for turnout with extra uq; --require-hashes

Standard library only, and `uv` where versions are looked up. Which index that is uv knows, from its
own settings; no address of it is written.
"""

import re
import shutil
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Iterable, Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
CONSTRAINTS = ROOT / "constraints.txt"
HEAD = """\
# The versions that bin/turnout, bin/test and .ci/run install, for Python 3.11 to 3.14, with the
# digests of all their files. Made by bin/pin.py: see CONTRIBUTING.md.
"""
OLDEST_PYTHON = "3.11.2"
"""Of Debian 12; some packages want a later 3.11."""
CORE, BUILD = "core", "build"
FOR = "    # for "
EDITABLE = "editables"
"""What the build backend needs besides for an installation that can be edited."""


class PinError(Exception):
    """Versions cannot be looked up; the text says what to do."""


def blocks(text: str) -> Iterator[tuple[str, set[str]]]:
    """Yield each package's lines, and who needs it: "core", "build" or an extra.

    A block begins with `name==version` and ends with the line that says what it is for.
    """
    lines: list[str] = []
    for line in text.splitlines():
        if line.startswith("#") or not line.strip():
            continue
        if line.startswith(FOR):
            yield "\n".join(lines), set(line.removeprefix(FOR).split(", "))
            lines = []
        else:
            lines.append(line)
    if lines:
        message = f"constraints.txt: {lines[0]} does not say what it is for; run bin/pin.py"
        raise PinError(message)


def selected(text: str, groups: Iterable[str]) -> str:
    """Return the requirements of some groups, each with its digests, for `pip --require-hashes`."""
    wanted = set(groups)
    known: set[str] = set()
    chosen = []
    for block, needed_by in blocks(text):
        known |= needed_by
        if wanted & needed_by:
            chosen.append(f"{block}\n")
    if wanted - known:
        unknown, there = ", ".join(sorted(wanted - known)), ", ".join(sorted(known))
        message = f"constraints.txt knows nothing for {unknown}; there are {there}"
        raise PinError(message)
    return "".join(chosen)


def name_of(requirement: str) -> str:
    """Return the name of a requirement in the form that indexes use.

    >>> name_of("Sphinx_Basic.ng[all]>=1; python_version < '3.12'")
    'sphinx-basic-ng'
    """
    found = re.match(r"[A-Za-z0-9._-]+", requirement)
    return re.sub(r"[-_.]+", "-", found.group(0) if found else "").lower()


def compiled(source: Path, *options: str) -> str:
    """Return what uv resolves for all platforms and Pythons.

    Raises
    ------
    PinError
        When there is no uv, or it finds no solution or no index.
    """
    uv = shutil.which("uv")
    if uv is None:
        message = "no uv on the path; install it, for example with `python -m pip install uv`"
        raise PinError(message)
    command = [uv, "pip", "compile", "--quiet", "--universal", "--python-version", OLDEST_PYTHON]
    command += ["--no-annotate", "--no-header", "--no-emit-index-url", "--no-emit-find-links"]
    run = subprocess.run(
        [*command, *options, str(source)], cwd=ROOT, capture_output=True, text=True, check=False
    )
    if run.returncode != 0:
        message = f"uv found no solution:\n{run.stderr.strip()}"
        raise PinError(message)
    return run.stdout


def pinned(text: str) -> list[str]:
    """Return the lines `name==version; marker` of a compiled list, without digests."""
    found = [line.rstrip(" \\") for line in text.splitlines() if re.match(r"[A-Za-z0-9]", line)]
    return [line for line in found if "==" in line]


def renewed(*, newest: bool) -> str:
    """Look everything up and return the text of constraints.txt."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    extras = sorted(project["project"]["optional-dependencies"])
    with tempfile.TemporaryDirectory() as folder:
        build, now, then = (Path(folder, f"{name}.txt") for name in ("build", "now", "then"))
        build.write_text("\n".join([*project["build-system"]["requires"], EDITABLE]))
        now.write_text("" if newest else "\n".join(pinned(CONSTRAINTS.read_text(encoding="utf-8"))))
        toml = ROOT / "pyproject.toml"
        every = compiled(
            toml, str(build), "--all-extras", "--generate-hashes", "--constraint", str(now)
        )
        then.write_text("\n".join(pinned(every)))
        fixed = ("--constraint", str(then))
        core = {name_of(line) for line in pinned(compiled(toml, *fixed))}
        needed = {CORE: core, BUILD: {name_of(line) for line in pinned(compiled(build, *fixed))}}
        for extra in extras:
            found = {name_of(line) for line in pinned(compiled(toml, *fixed, "--extra", extra))}
            needed[extra] = found - core
    return HEAD + "".join(_marked(every, needed))


def _marked(every: str, needed: dict[str, set[str]]) -> Iterator[str]:
    """Yield the blocks of a compiled list, each with who needs it."""
    for block in re.split(r"\n(?=[A-Za-z0-9])", every.strip()):
        users = [group for group, names in needed.items() if name_of(block) in names]
        yield f"{block.rstrip()}\n{FOR}{', '.join(users)}\n"


def main(arguments: list[str]) -> int:
    """Renew constraints.txt, or print a part of it; return the exit code."""
    try:
        if arguments[:1] == ["--print"]:
            text = CONSTRAINTS.read_text(encoding="utf-8")
            print(selected(text, [CORE, BUILD, *arguments[1:]]), end="")
            return 0
        if arguments not in ([], ["--newest"]):
            print(__doc__, file=sys.stderr)
            return 2
        text = renewed(newest=bool(arguments))
    except PinError as error:
        print(f"pin: {error}", file=sys.stderr)
        return 1
    if "://" in text:
        print("pin: an address would be written; nothing was", file=sys.stderr)
        return 1
    CONSTRAINTS.write_text(text, encoding="utf-8")
    print(f"pin: {len(pinned(text))} versions written to {CONSTRAINTS.name}")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
