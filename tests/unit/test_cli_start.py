"""The user's face: quick to import, and complete."""

import re
import subprocess
import sys

import pytest
import typer
from typer.testing import CliRunner

from turnout.cli.main import app, main

HEAVY = ("numba", "numpy", "xarray", "pandas", "pydantic", "matplotlib", "pint", "scipy")


@pytest.mark.parametrize(
    ("arguments", "loaded", "heavy"),
    [
        (["--version"], set(), set()),
        (["--help"], None, set()),
        (["panel", "list", "--help"], {"panel", "match"}, {"pydantic"}),
    ],
    ids=["version", "help", "panel list"],
)
def test_one_command_loads_no_other_and_help_nothing_slow(
    arguments: list[str], loaded: set[str] | None, heavy: set[str]
) -> None:
    code = (
        "import sys\n"
        "from turnout.cli.main import COMMANDS, main\n"
        f"sys.argv = ['turnout', *{arguments!r}]\n"
        "try:\n"
        "    main()\n"
        "except SystemExit:\n"
        "    pass\n"
        "names = {place.partition(':')[0] for place, _ in COMMANDS.values()} | {'match'}\n"
        "print(*(name for name in names if f'turnout.cli.{name}' in sys.modules))\n"
        f"print(*(name for name in {HEAVY!r} if name in sys.modules))\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    commands, found = done.stdout.split("\n")[-3:-1]
    assert loaded is None or set(commands.split()) == loaded
    assert set(found.split()) == heavy


ENDING = """
import atexit, gc, sys
from turnout.cli.main import main
before = gc.get_freeze_count()
atexit.register(lambda: print(gc.get_freeze_count() - before > 10_000))
sys.argv = ["turnout", "--version"]
try:
    main()
finally:
    print(gc.get_freeze_count() == before)
"""


def test_the_end_of_the_process_alone_looks_through_nothing_that_was_loaded() -> None:
    done = subprocess.run(
        [sys.executable, "-c", ENDING], capture_output=True, text=True, check=True
    )
    assert done.stdout.split()[-2:] == ["True", "True"]


def test_an_error_while_a_command_loads_is_no_unknown_command(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    class Broken:
        def __getattr__(self, name: str) -> None:
            raise KeyError(name)

    monkeypatch.setitem(sys.modules, "turnout.cli.pod", Broken())
    assert isinstance(CliRunner().invoke(app, ["pod", "--help"]).exception, KeyError)
    assert "No such command" in CliRunner().invoke(app, ["pods"]).output


GROUPS = ([], ["panel"], ["machine"], ["campaign"], ["sweep"])


def commands() -> list[list[str]]:
    """Return every command as the words that name it."""
    root = typer.main.get_command(app)
    found = []
    for name, item in root.commands.items():  # type: ignore[attr-defined]
        inner = getattr(item, "commands", None)
        found += [[name]] if inner is None else [[name, below] for below in inner]
    return found


@pytest.mark.parametrize("group", GROUPS, ids=" ".join)
def test_short_help_is_whole(group: list[str]) -> None:
    lines = CliRunner().invoke(app, [*group, "--help"]).output.splitlines()
    assert not [line for line in lines[1:] if line.endswith("...")]


@pytest.mark.parametrize("command", commands(), ids=" ".join)
def test_help_names_values_by_words_and_short_options_mean_the_same(command: list[str]) -> None:
    text = CliRunner().invoke(app, [*command, "--help"]).output
    assert re.findall(r"<[a-z\[\] ]+>", text) == []
    assert set(re.findall(r"-[a-z], --[a-z]+", text)) <= {"-o, --out", "-q, --quiet"}
    assert "  --out " not in text
    assert "  --quiet " not in text


def test_completion_is_offered(monkeypatch: pytest.MonkeyPatch) -> None:
    # Typer looks for the shell among the parents of the process, where a test may have none.
    monkeypatch.setattr("typer.completion._get_shell_name", lambda: "bash")
    done = CliRunner().invoke(app, ["--show-completion"], prog_name="turnout")
    assert "_TURNOUT_COMPLETE" in done.output


@pytest.mark.parametrize(
    ("refused", "terminal", "coloured"),
    [(False, True, True), (True, True, False), (False, False, False)],
    ids=["terminal", "NO_COLOR", "file"],
)
def test_colour_in_a_terminal_unless_it_is_refused(
    refused: bool,
    terminal: bool,
    coloured: bool,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.delenv("NO_COLOR", raising=False)
    if refused:
        monkeypatch.setenv("NO_COLOR", "1")
    monkeypatch.setattr("sys.argv", ["turnout", "simulate", "nowhere.toml"])
    monkeypatch.setattr(sys.stderr, "isatty", lambda: terminal)
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 2
    assert ("\x1b" in capsys.readouterr().err) == coloured
