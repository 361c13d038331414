"""What is wrong with a study file is reported all at once, with key, value, what is allowed."""

from pathlib import Path

import pytest

from turnout.calibration.load_study import load_study, study_from_file
from turnout.core.errors import FileError, StudyError
from turnout.core.toml import parse_toml

HEAD = 'schema_version = 1\nname = "test"\npanel = "uic60-760-1-15"\n'
SIZE = '[[variable]]\nkey = "object.size"\nvalues = ["5 mm", "13 mm"]\n'
PLACE = '[[variable]]\nkey = "object.at"\nvalues = ["sleeper 6"]\n'
FRICTION = '[[variable]]\nkey = "chair.friction_coefficient"\n'
DRAWN = FRICTION + 'distribution = "uniform"\nminimum = 0.1\nmaximum = 0.3\n'
STIFF = (
    '[[variable]]\nkey = "drive.1.stiffness"\ndistribution = "uniform"\n'
    'minimum = "500 kN/m"\nmaximum = "900 kN/m"\n'
)
FIELD = (
    '[[field]]\nkey = "chair.friction_coefficient"\ndistribution = "normal"\nmean = 0.2\n'
    'standard_deviation = 0.05\ncorrelation_length = "2 m"\n'
)
TEMPERATURE = '[[variable]]\nkey = "temperature"\nvalues = ["-30 degC", "20 degC"]\n'
LAW = '[temperature_law]\nreference = "20 degC"\ncoefficient = '
FAULTS = {
    "unknown key": ('sed = 1\n' + SIZE + PLACE, "sed: unknown key; nearest is 'seed'"),
    "unknown variable": (
        '[[variable]]\nkey = "drive.2.stifness"\nvalues = ["1 kN/m"]\n',
        "nearest is 'drive.2.stiffness'",
    ),
    "no such member": (
        '[[variable]]\nkey = "drive.7.stiffness"\nvalues = ["900 kN/m"]\n',
        "matches nothing in this panel; nearest is 'drive.2.stiffness'",
    ),
    "wrong dimension": (SIZE.replace('"5 mm"', '"5 kN"') + PLACE, '"kN" is a unit of force'),
    "no unit": (SIZE.replace('"5 mm"', "5") + PLACE, "has no unit, 5 would be 5 m"),
    "not allowed by the panel": (FRICTION + "values = [0.2, 2.5]\n", "must be at most 2"),
    "reaches below zero": (
        FRICTION + 'distribution = "normal"\nmean = 0.2\nstandard_deviation = 0.1\n'
        "[sampling]\ncount = 4\n",
        "must be at least 0",
    ),
    "field reaches below zero": (FIELD + "[sampling]\ncount = 4\n", "must be at least 0"),
    "no room": (SIZE.replace("13 mm", "150 mm") + PLACE, "larger than the opening"),
    "no such place": (SIZE + PLACE.replace("6", "66"), "there is no sleeper '66'"),
    "off the rail": (
        SIZE + '[[variable]]\nkey = "object.x"\nvalues = ["90 m"]\n',
        "is not on rail 'straight'",
    ),
    "no place": (SIZE, "give its place as one of the variables"),
    "no size": (PLACE, 'an object needs a size; give a variable "object.size"'),
    "nothing varies": ("", "nothing varies, so there is no scenario"),
    "no scenario": (DRAWN + "[sampling]\ncount = 0\n", "at least 1, or there is no scenario"),
    "no values": (FRICTION + "values = []\n", "needs at least one value"),
    "no power of two": (
        DRAWN + '[sampling]\nmethod = "sobol"\ncount = 100\n',
        "must be a power of 2 for 'sobol'; near is 128",
    ),
    "impossible range": (
        DRAWN.replace("0.3", "0.05") + "[sampling]\ncount = 4\n",
        "maximum: must be more than `minimum`",
    ),
    "range that is no number": (
        DRAWN.replace("0.3", "nan") + "[sampling]\ncount = 4\n",
        "maximum = nan: must be a finite number",
    ),
    "parameter of another": (
        DRAWN + "mode = 0.2\n[sampling]\ncount = 4\n",
        "mode: is none of distribution 'uniform'",
    ),
    "parameter missing": (
        DRAWN.replace("maximum = 0.3\n", "") + "[sampling]\ncount = 4\n",
        "maximum: is required for distribution 'uniform'",
    ),
    "unknown distribution": (
        DRAWN.replace("uniform", "unifrm") + "[sampling]\ncount = 4\n",
        "there is none of this name; nearest is 'uniform'",
    ),
    "not said how often": (DRAWN, "is drawn, so say how often in a table [sampling]"),
    "contradicting correlation": (
        DRAWN + STIFF + "[sampling]\ncount = 4\n[[correlation]]\n"
        'between = ["drive.1.stiffness", "drive.2.stiffness"]\nrank_correlation = 0.5\n',
        '"drive.2.stiffness": is not a drawn variable; nearest is',
    ),
    "correlation beyond one": (
        DRAWN + STIFF + "[sampling]\ncount = 4\n[[correlation]]\n"
        'between = ["chair.friction_coefficient", "drive.1.stiffness"]\nrank_correlation = 1.5\n',
        "must be less than 1",
    ),
    "rule of nothing": (
        SIZE + PLACE + '[rule]\nincrease = "object.sze"\n',
        "is not a variable with values; nearest is 'object.size'",
    ),
    "rule that falls": (
        SIZE.replace('"5 mm", "13 mm"', '"13 mm", "5 mm"') + PLACE
        + '[rule]\nincrease = "object.size"\n',
        "its values must rise",
    ),
    "temperature without law": (TEMPERATURE, "say what it does in a table [temperature_law]"),
    "temperature beyond friction": (TEMPERATURE + LAW + '"0.03 1/K"\n', "must stay more than 0"),
    "unknown channel": (SIZE + PLACE + '[output]\nchannels = ["drive_forc"]\n', "drive_forc: no"),
    "unknown scheme": (SIZE + PLACE + '[scheme]\nstp = "1 ms"\n', "nearest is 'step'"),
    "unknown mode": (SIZE + PLACE + '[scheme]\nmode = "quik"\n', "nearest is 'quick'"),
    "mode of numbers": (SIZE + PLACE + "[scheme]\nmode = 3\n", "scheme.mode = 3: is no mode"),
    "rate too high": (SIZE + PLACE + '[output]\nrate = "10 kHz"\n', "at most 1000 Hz"),
    "ragged list": (
        '[[together]]\nkeys = ["object.at", "object.size"]\nrows = [["sleeper 6"]]\n',
        "has 1 values for 2 keys",
    ),
    "unknown split": (SIZE + PLACE + 'split = ["x"]\n', 'split = "x": is no variable'),
}  # fmt: skip


@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_is_reported(name: str) -> None:
    text, words = FAULTS[name]
    if "split =" in text or "sed =" in text:
        # Keys of the file itself stand before its tables.
        line = next(item for item in text.splitlines() if item.startswith(("split", "sed")))
        text = line + "\n" + text.replace(line + "\n", "")
    with pytest.raises(StudyError) as caught:
        study_from_file(parse_toml(HEAD + text, source="test.toml", folder=Path.cwd()))
    assert words in str(caught.value)
    assert len(caught.value.problems) == 1, caught.value.problems


def test_all_faults_come_at_once() -> None:
    text = HEAD + "sed = 3\n" + SIZE.replace("5 mm", "5") + PLACE.replace("6", "66") + DRAWN
    with pytest.raises(StudyError) as caught:
        study_from_file(parse_toml(text, source="test.toml", folder=Path.cwd()))
    assert len(caught.value.problems) == 4
    for words in ("sed", "has no unit", "there is no sleeper '66'", "[sampling]"):
        assert words in str(caught.value)


def test_an_unknown_study_and_an_unknown_panel_are_reported(tmp_path: Path) -> None:
    with pytest.raises(FileError, match="nearest is 'paper-campaign'"):
        load_study("paper-campain")
    file = tmp_path / "study.toml"
    file.write_text(HEAD.replace("uic60-760-1-15", "uic60-760-1-16") + SIZE + PLACE)
    with pytest.raises(FileError, match="no library panel is called"):
        load_study(file)
