"""Bring .venv up to date with pyproject.toml and constraints.txt; called by bin/setup.

Standard library only. A start that finds everything in place costs a few milliseconds. Several
starts at once wait for the first; one that was cut short is begun again from an empty folder. No
file of another package is installed whose digest is not in constraints.txt.
"""

import fcntl
import hashlib
import importlib.util
import json
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from pin import BUILD, CONSTRAINTS, CORE, PinError, blocks, selected

ROOT = Path(__file__).resolve().parents[1]
VENV = ROOT / ".venv"
PYTHON = VENV / "bin" / "python"
STAMP = VENV / "turnout-setup.json"
UNFINISHED = VENV / "turnout-setup-unfinished"
PINS = VENV / "turnout-pins.txt"


class SetupError(Exception):
    """Set-up cannot go on; the text says what to do."""


def say(text: str) -> None:
    """Write one line for the person in front of the screen, apart from the program's output."""
    print(f"turnout: {text}", file=sys.stderr, flush=True)


def fingerprint() -> str:
    """Return a digest of all that decides what has to be installed, and where."""
    digest = hashlib.sha256(f"{ROOT}\n".encode())
    for name in ("pyproject.toml", "constraints.txt", "bin/prepare.py", "bin/pin.py"):
        digest.update((ROOT / name).read_bytes())
    return digest.hexdigest()


def version_of(python: Path) -> str | None:
    """Return what `python -V` says, or None where it does not run (its system Python is gone)."""
    try:
        run = subprocess.run([python, "-V"], capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        return None
    return run.stdout.strip()


def installed() -> dict[str, object]:
    """Return what the last finished set-up left as its stamp, or an empty one."""
    try:
        stamp = json.loads(STAMP.read_text())
    except (OSError, ValueError):
        return {}
    return stamp if isinstance(stamp, dict) else {}


def recorded_extras(stamp: dict[str, object]) -> set[str]:
    """Return the extras that a stamp names."""
    extras = stamp.get("extras")
    return set(extras) if isinstance(extras, list) else set()


def is_ready(extras: set[str]) -> bool:
    """Return whether .venv holds what the files ask for now, with these extras."""
    stamp = installed()
    return (
        not UNFINISHED.exists()
        and stamp.get("fingerprint") == fingerprint()
        and extras <= recorded_extras(stamp)
        and stamp.get("python") == version_of(PYTHON)
    )


@contextmanager
def locked() -> Iterator[None]:
    """Hold the set-up lock; the system frees it however this process ends."""
    with (ROOT / ".venv.lock").open("w") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            say("another start is installing; waiting for it")
            fcntl.flock(file, fcntl.LOCK_EX)
        yield


def install_ensurepip() -> None:
    """Let apt-get install what Debian and Ubuntu leave out of Python, or say how to."""
    package = f"python{sys.version_info.major}.{sys.version_info.minor}-venv"
    if shutil.which("apt-get") is None:
        text = f"{sys.executable} has no ensurepip, so it cannot make .venv; install it, or uv"
        raise SetupError(text)
    if os.geteuid() != 0:
        text = (
            "this Python cannot make a virtual environment; run once, as root:\n"
            f"    apt-get update && apt-get install --yes {package}\n"
            "or install uv, which needs no root; then repeat your line"
        )
        raise SetupError(text)
    say(f"Python lacks ensurepip: installing {package} with apt-get")
    environment = {**os.environ, "DEBIAN_FRONTEND": "noninteractive"}
    install = ["apt-get", "install", "--yes", "-qq", "--no-install-recommends", package]
    for command in (["apt-get", "update", "-qq"], install):
        run = subprocess.run(
            command, env=environment, stdin=subprocess.DEVNULL, capture_output=True, text=True
        )
        if run.returncode != 0:
            print(run.stdout, run.stderr, sep="", file=sys.stderr)
            text = f"apt-get failed; install {package} yourself, then repeat your line"
            raise SetupError(text)


def make_environment() -> None:
    """Make .venv afresh, with pip in it."""
    if VENV.exists():
        say("making .venv again: the one there is not complete")
        shutil.rmtree(VENV)
    has_ensurepip = all(importlib.util.find_spec(name) for name in ("venv", "ensurepip"))
    uv = None if has_ensurepip else shutil.which("uv")
    if not has_ensurepip and uv is None:
        install_ensurepip()
    VENV.mkdir()
    UNFINISHED.touch()
    if uv is None:
        command = [sys.executable, "-m", "venv", str(VENV)]
    else:
        command = [uv, "venv", "--quiet", "--seed", "--allow-existing"]
        command += ["--python", sys.executable, str(VENV)]
    if subprocess.run(command, stdin=subprocess.DEVNULL, stdout=sys.stderr).returncode != 0:
        text = "the virtual environment .venv could not be made; the lines above say why"
        raise SetupError(text)


def has_pip() -> bool:
    """Return whether the Python of .venv runs and has pip."""
    command = [str(PYTHON), "-I", "-c", "import pip"]
    return (
        version_of(PYTHON) is not None
        and subprocess.run(command, capture_output=True).returncode == 0
    )


def pip_install(*arguments: str) -> None:
    """Install into .venv what is named, and nothing that it depends on."""
    command = [str(PYTHON), "-m", "pip", "install", "--no-input", "--progress-bar=off"]
    command += ["--disable-pip-version-check", "--no-deps", *arguments]
    run = subprocess.run(
        command,
        cwd=ROOT,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    if run.returncode != 0:
        print(*run.stdout.splitlines()[-20:], sep="\n", file=sys.stderr)
        if run.returncode > 0:
            UNFINISHED.unlink(missing_ok=True)
        text = (
            "installing failed; the lines above are pip's own. Is there a way to a package index?\n"
            "Its address, proxies and certificates are set with `pip config` or PIP_... variables. "
            "A file\nwhose digest is not in constraints.txt is refused: it is not what was tested."
        )
        raise SetupError(text)


def prepare(extras: set[str]) -> None:
    """Install this checkout, editable, with `extras` and those installed before."""
    text = CONSTRAINTS.read_text(encoding="utf-8")
    try:
        known = set().union(*(needed_by for _, needed_by in blocks(text)))
        wanted = sorted(extras | (recorded_extras(installed()) & known))
        pins = selected(text, [CORE, BUILD, *wanted])
    except PinError as error:
        raise SetupError(str(error)) from None
    if UNFINISHED.exists() or not has_pip():
        say("first start: installing into .venv, which takes a minute or two")
        make_environment()
    else:
        say("bringing .venv up to date with what this line needs")
    stamp = {"fingerprint": fingerprint(), "extras": wanted, "python": version_of(PYTHON)}
    UNFINISHED.touch()
    STAMP.unlink(missing_ok=True)
    # The build backend comes from constraints.txt too, so nothing is fetched unpinned.
    PINS.write_text(pins, encoding="utf-8")
    pip_install("--require-hashes", "--requirement", str(PINS))
    pip_install("--no-build-isolation", "--editable", ".")
    STAMP.write_text(json.dumps(stamp, indent=1))
    UNFINISHED.unlink()


def main(extras: set[str]) -> int:
    """Return 0 once .venv is in order, 1 after having said what is wrong."""
    if is_ready(extras):
        return 0
    try:
        with locked():
            if not is_ready(extras):
                prepare(extras)
    except SetupError as error:
        say(str(error))
        return 1
    except OSError as error:
        say(f"set-up cannot write here: {error}")
        return 1
    except KeyboardInterrupt:
        say("set-up stopped; the next start begins it again")
        return 130
    return 0


if __name__ == "__main__":
    sys.exit(main(set(sys.argv[1:])))
