"""What README and the quick start ask a newcomer to type, run as it stands in an empty folder."""

import contextlib
import os
import re
import shlex
import signal
import subprocess
import sys
import urllib.request
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from turnout.cli.main import app

ROOT = Path(__file__).parents[2]
PAGES = ("README.md", "docs/use/install.md")
PROGRAM = "sh bin/turnout "


def text_of(page: str) -> str:
    return (ROOT / page).read_text(encoding="utf-8")


def blocks(page: str, language: str) -> list[str]:
    """Return the fenced blocks of a language."""
    return re.findall(rf"^```{language}\n(.*?)^```", text_of(page), flags=re.M | re.S)


def commands(page: str) -> list[str]:
    """Return the lines that start the program, in blocks and within sentences."""
    lines = [line for block in blocks(page, "sh") for line in block.splitlines()]
    lines += re.findall(r"`([^`\n]+)`", text_of(page))
    return [line.strip() for line in lines if line.strip().startswith(PROGRAM)]


# The studio serves until Ctrl-C, so it has a test of its own.
SERVING = f"{PROGRAM}studio"
ALL_COMMANDS = sorted({line for page in PAGES for line in commands(page)} - {SERVING})


@cache
def printed(command: str, folder: Path) -> str:
    """Run a command in a folder, by this process, which has all loaded; return what it prints."""
    with contextlib.chdir(folder):
        done = CliRunner().invoke(app, shlex.split(command.removeprefix(PROGRAM)))
    assert done.exit_code == 0, (done.output, done.exception)
    return done.stdout


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("newcomer")


def test_there_is_something_to_run() -> None:
    assert len(ALL_COMMANDS) >= 3
    assert all(blocks(page, "python") for page in PAGES)


@pytest.mark.parametrize("command", ALL_COMMANDS)
def test_commands_run_and_write_what_they_name(command: str, folder: Path) -> None:
    assert printed(command, folder)
    for name in re.findall(r"--(?:out|plot) (\S+)", command):
        assert (folder / name).stat().st_size > 1000


def test_the_studio_serves_until_ctrl_c(folder: Path) -> None:
    assert SERVING in commands("README.md")
    line = [sys.executable, "-m", "turnout", "studio", "--panel", "sb2", "--no-browser"]
    path = os.pathsep.join(map(os.path.abspath, sys.path))
    with subprocess.Popen(
        line,
        cwd=folder,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": path, "PYTHONUNBUFFERED": "1"},
    ) as process:
        try:
            assert process.stdout is not None
            address = process.stdout.readline().removeprefix("studio: ").strip()
            with urllib.request.build_opener(urllib.request.HTTPCookieProcessor()).open(
                address, timeout=60
            ) as page:
                assert b"turnout studio" in page.read()
            process.send_signal(signal.SIGINT)
            _, said = process.communicate(timeout=60)
        finally:
            process.kill()
    assert process.returncode == 130
    assert said == "turnout: the studio has ended\n"


def test_the_output_that_the_readme_shows(folder: Path) -> None:
    """Line by line, up to the dots that shorten one."""
    (shown,) = blocks("README.md", "text")
    (command,) = [line for line in commands("README.md") if "simulate" in line]
    lines = printed(command, folder).splitlines()
    for line in shown.splitlines():
        start = line.split("...")[0]
        assert any(found.startswith(start) for found in lines), line


@pytest.mark.parametrize("page", PAGES)
def test_python_blocks_run(page: str, folder: Path) -> None:
    (block,) = blocks(page, "python")
    names: dict[str, Any] = {}
    with contextlib.chdir(folder):
        exec(compile(block, page, "exec"), names)
    assert bool(names["ds"]["object_touched"])


def test_no_line_needs_a_program_that_is_not_installed() -> None:
    """After the first line there is no `turnout` on the path, only `sh bin/turnout`."""
    typed = [line for block in blocks("README.md", "sh") for line in block.splitlines()]
    typed += re.findall(r"`([^`\n]+)`", text_of("README.md"))
    assert [line for line in typed if line.startswith("turnout ")] == []


@pytest.mark.parametrize("page", ["README.md", "CONTRIBUTING.md", "CHANGELOG.md", "docs/project"])
def test_links_of_pages_that_the_documentation_leaves_out_lead_to_files(page: str) -> None:
    files = sorted((ROOT / page).glob("*.md")) if (ROOT / page).is_dir() else [ROOT / page]
    links = [
        (path, link)
        for path in files
        for link in re.findall(r"\]\(([^)#\s]+)", path.read_text(encoding="utf-8"))
        if "://" not in link
    ]
    assert [link for path, link in links if not (path.parent / link).exists()] == []


def test_commands_of_a_checkout_stand_in_evidence_only() -> None:
    """Who has installed turnout has neither `benchmarks` nor `tests`."""
    pages = [path for part in ("use", "theory") for path in (ROOT / "docs" / part).glob("*.md")]
    assert len(pages) > 30
    text = "\n".join(path.read_text(encoding="utf-8") for path in pages)
    assert re.findall(r"python -m (?:benchmarks|tests)\S*", text) == []
