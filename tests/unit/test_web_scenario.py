"""A throw of the page as a command, a script and a panel file: each gives the same throw."""

import shlex

import pytest
from tests.unit.simulated import sb2_panel

import turnout
from turnout.core.errors import FileError
from turnout.core.toml import parse_toml, with_value
from turnout.panel.foreign_object import parse_object
from turnout.panel.load import library_text, load_panel, panel_from_file
from turnout.web import tasks
from turnout.web.request import RunRequest
from turnout.web.scenario import command_line, panel_toml, python_script

SETTINGS = {
    "chair.friction_coefficient": 0.3,
    "drive.2.stiffness": "300 kN/m",
    "movement.return.extra_time.2": "0.3 s",
    "movement.return.duration": "3 s",
}


def asked(stiffness: str = "30 kN/mm") -> RunRequest:
    trapped = {"size": "13 mm", "at": "x = 3.65 m", "stiffness": stiffness}
    return RunRequest.model_validate({"panel": "", "object": trapped, "settings": SETTINGS})


def test_a_process_begins_with_the_kernels_of_a_loaded_start(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    thrown = []
    monkeypatch.setattr(tasks, "simulate", lambda panel, **_: thrown.append(panel))
    tasks.Opening(load_panel("sb2"), {})()
    loaded = [drive.over_travel_closed > 0 for panel in thrown for drive in panel.drive.values()]
    assert any(loaded)
    assert not all(loaded)


def test_the_command_names_panel_object_and_changes() -> None:
    words = shlex.split(command_line(sb2_panel(), asked()))
    assert words[:3] == ["turnout", "simulate", "sb2"]
    trapped = parse_object(words[words.index("--object") + 1])
    assert (trapped.size, trapped.at) == (0.013, "x=3.65m")
    settings = [words[at + 1] for at, word in enumerate(words) if word == "--set"]
    changed = sb2_panel().with_settings(settings)
    expected = SETTINGS | {"object_defaults.stiffness": "30 kN/mm"}
    assert changed.hash == sb2_panel().with_overrides(expected, si=False).hash
    assert "object_defaults" not in command_line(sb2_panel(), asked("40 kN/mm"))


def test_a_name_from_a_link_cannot_run_a_command() -> None:
    evil = RunRequest.model_validate(
        {"panel": "", "object": {"size": "13 mm", "at": "$(rm -r ~); `id`"}}
    )
    words = shlex.split(command_line(sb2_panel(), evil))
    assert words[-1] == "13mm@$(rm-r~);`id`"


def test_the_script_computes_the_throw(capsys: pytest.CaptureFixture[str]) -> None:
    script = python_script(sb2_panel(), asked())
    names: dict[str, object] = {}
    exec(compile(script, "throw.py", "exec"), names)
    dataset = names["ds"]
    assert capsys.readouterr().out.strip() == dataset.turnout.verdict().text  # type: ignore[attr-defined]
    trapped = turnout.ForeignObject("13 mm", "x = 3.65 m", stiffness="30 kN/mm")
    changed = sb2_panel().with_overrides(SETTINGS, si=False)
    same = turnout.simulate(changed, foreign_object=trapped)
    assert dataset["drive_force"].equals(same["drive_force"])  # type: ignore[index]


@pytest.mark.parametrize("name", ["sb2", "uic60-760-1-15"])
def test_the_panel_file_holds_changes_and_object(name: str) -> None:
    panel = turnout.load_panel(name).with_overrides(SETTINGS, si=False)
    text = panel_toml(library_text(name), panel, asked())
    written = panel_from_file(parse_toml(text, source="written.toml"))
    trapped = written.object["trapped"]
    assert (trapped.size, trapped.at, trapped.stiffness) == (0.013, "x = 3.65 m", 3e7)
    alone = panel_toml(library_text(name), panel, asked().model_copy(update={"object": None}))
    assert panel_from_file(parse_toml(alone, source="written.toml")).hash == panel.hash
    assert written.origins["drive.2.stiffness"].text == "set in the studio"


def test_a_text_that_gives_another_panel_is_refused() -> None:
    changed = sb2_panel().with_overrides(SETTINGS, si=False)
    with pytest.raises(FileError, match="save the command line instead"):
        panel_toml(library_text("uic60-760-1-15"), changed, asked())


@pytest.mark.parametrize(
    ("text", "path", "expected"),
    [
        ("a.b = 1 # c\n", ("a", "b"), "a.b = 2  # n\n"),
        ("a = [1,\n 2]\n", ("a",), "a = 2  # n\n"),
        ('[x."y.z"]\nq = """\nb = 1\n"""', ("x", "y.z", "q"), '[x."y.z"]\nq = 2  # n'),
        ("[x]\nb = 1", ("y", "z"), "[x]\nb = 1\n\n[y]\nz = 2  # n\n"),
        ("[x]\ny = { '2' = 1 } # c\n", ("x", "y", "2"), "[x]\ny = { '2' = 2 } # c\n"),
    ],
)
def test_a_value_is_changed_where_it_is(text: str, path: tuple[str, ...], expected: str) -> None:
    assert with_value(text, path, "2", comment="n") == expected
