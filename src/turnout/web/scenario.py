"""The throw of a page as a command, a script, or a panel file."""

import json
import math
import shlex

from turnout.core.errors import FileError
from turnout.core.toml import parse_toml, with_value
from turnout.panel.foreign_object import ForeignObject
from turnout.panel.load import LoadedPanel, library_names, panel_from_file
from turnout.web.request import RunRequest

TRAPPED = "trapped"
"""Name of the object in a written panel file."""
STIFFNESS = "object_defaults.stiffness"
ORIGIN = "assumption: set in the studio"
"""Origin of changed values in a written panel file."""


def command_line(panel: LoadedPanel, request: RunRequest) -> str:
    """Return the command that computes the same throw.

    Parameters
    ----------
    panel : LoadedPanel
        As it was loaded, without the changes of the page.
    request : RunRequest
        Changes and object.

    Examples
    --------
    >>> from turnout.panel.load import load_panel
    >>> asked = {"panel": "", "object": {"size": "13 mm", "at": "sleeper 6"}}
    >>> command_line(load_panel("sb2"), RunRequest.model_validate(asked))
    'turnout simulate sb2 --object 13mm@sleeper6'
    """
    words = ["turnout", "simulate", file_of(panel)]
    if request.object is not None:
        words += ["--object", f"{request.object.size}@{request.object.at}".replace(" ", "")]
    for key, value in _settings(panel, request).items():
        words += ["--set", f"{key}={value}"]
    return shlex.join(words)


def python_script(panel: LoadedPanel, request: RunRequest) -> str:
    """Return a script that computes the same throw."""
    lines = ["import turnout", "", f"panel = turnout.load_panel({file_of(panel)!r})"]
    settings = _settings(panel, request)
    stiffness = settings.pop(STIFFNESS, None)
    if settings:
        lines.append("panel = panel.with_settings([")
        lines += [f"    {f'{key}={value}'!r}," for key, value in settings.items()]
        lines.append("])")
    if request.object is None:
        lines.append("ds = turnout.simulate(panel)")
    else:
        given = request.object
        more = f", stiffness={given.stiffness!r}" if stiffness else ""
        lines += [
            f"trapped = turnout.ForeignObject({given.size!r}, at={given.at!r}{more})",
            "ds = turnout.simulate(panel, foreign_object=trapped)",
        ]
    return "\n".join([*lines, "print(ds.turnout.verdict().text)", ""])


def panel_toml(text: str, panel: LoadedPanel, request: RunRequest) -> str:
    """Return a panel file with the changes of the page and its object written into it.

    Parameters
    ----------
    text : str
        The file that the panel was loaded from; its comments stay.
    panel : LoadedPanel
        The panel with the changes made.
    request : RunRequest
        Changes and object.

    Raises
    ------
    FileError
        When the text cannot be changed so that it gives this panel.
    """
    changed = text
    for key, value in request.settings.items():
        literal = json.dumps(value)  # a text of JSON is one of TOML too
        changed = with_value(changed, tuple(key.split(".")), literal, comment=ORIGIN)
    source = f"{panel.name}.toml"
    if panel_from_file(parse_toml(changed, source=source)).hash != panel.hash:
        message = (
            f"{source}: these changes cannot be written as single values of the file; "
            "save the command line instead"
        )
        raise FileError(message)
    if request.object is None:
        return changed
    given = request.object
    quoted = {"size": given.size, "at": given.at, "stiffness": given.stiffness}
    rows = [f"{name} = {json.dumps(value)}" for name, value in quoted.items() if value is not None]
    return "\n".join([changed.rstrip("\n"), "", f"[object.{TRAPPED}]", *rows, ""])


def file_of(panel: LoadedPanel) -> str:
    """Return the library name of a panel, or the name of its file without its folder."""
    if panel.source in library_names():
        return panel.source
    return panel.source.replace("\\", "/").rpartition("/")[2]


def _settings(panel: LoadedPanel, request: RunRequest) -> dict[str, float | str]:
    """Return changed values by key, among them the stiffness of the object if it is changed."""
    settings = {
        key: value.replace(" ", "", 1) if isinstance(value, str) else value
        for key, value in request.settings.items()
    }
    given = request.object
    if given is not None and given.stiffness is not None:
        own = ForeignObject(given.size, given.at, stiffness=given.stiffness).stiffness
        if own is not None and not math.isclose(float(own), panel.object_defaults.stiffness):
            settings[STIFFNESS] = given.stiffness.replace(" ", "")
    return settings
