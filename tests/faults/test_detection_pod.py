"""Bad input of `turnout pod`: one message with everything that is wrong, nothing written."""

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from turnout.cli.main import app
from turnout.core.errors import TurnoutError

GOOD = "size [mm],response [N],hit,switch\n" + "\n".join(
    f"{size},{30 * size + 17 * ((7 * size) % 5):g},{(size + switch) % 9 > 3},{switch}"
    for switch in (1, 2, 3)
    for size in range(5, 14)
)


@pytest.mark.parametrize(
    ("text", "options", "words"),
    [
        ("# nothing\n", [], "has no line with the names of the columns"),
        ("size [mm],hitt\n5,yes\n", [], 'column "hitt": unknown'),
        ("hit\nyes\n", [], "column size: missing"),
        ("size [mm]\n5\n", [], "column response or hit: missing"),
        ("size,hit\n5,yes\n", [], "has no unit"),
        ("size [mm],hit\n5,perhaps\n-3,yes\n", [], 'hit = "perhaps": must be yes or no'),
        ("size [mm],response\n5,nan\n", ["--threshold", "3"], "must be a finite number"),
        ("size [mm],hit\n5,yes\n,no\n", [], "line 3: has no size"),
        ("size [mm],hit\n5,yes\n7,no\n", [], "2 throws with objects; 10 are the least"),
        (GOOD, ["--threshold", "-5"], "take a linear response scale"),
        (GOOD, ["--threshold", "200", "--floor", "300"], "must lie between the floor"),
        (
            GOOD,
            ["--threshold", "3 mm", "--slip", "much"],
            '"mm" is a unit of length; needs one of force',
        ),
        (GOOD, ["--campaigns", "20"], "simulated campaigns = 20: must be 0, or 100 or more"),
        (GOOD, ["--link", "cauchit"], 'link = "cauchit": allowed are probit and logit'),
        (GOOD, ["-o", "pod.txt"], "the name must end in .nc or .csv"),
        (
            "size [mm],response\n" + "7,3\n" * 12,
            ["--threshold", "3"],
            "all objects are 7 mm",
        ),
    ],
)
def test_bad_input_is_refused(text: str, options: list[str], words: str, tmp_path: Path) -> None:
    file = tmp_path / "results.csv"
    file.write_text(text)
    found = CliRunner().invoke(app, ["pod", str(file), *options])
    assert isinstance(found.exception, TurnoutError), found.output
    assert words in str(found.exception)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["results.csv"]


def test_results_go_to_the_screen_to_files_and_to_json(tmp_path: Path) -> None:
    file, out, figure = (tmp_path / name for name in ("results.csv", "pod.nc", "pod.png"))
    file.write_text(GOOD)
    line = ["pod", str(file), "--threshold", "250", "--campaigns", "0"]
    shown = CliRunner().invoke(app, [*line, "-o", str(out), "--plot", str(figure)])
    assert shown.exit_code == 0, shown.exception
    assert "27 throws with objects (responses) on 3 switches" in shown.output
    assert "a90/95" in shown.output
    assert out.exists()
    assert figure.exists()
    printed = CliRunner().invoke(app, [*line, "--json", "-o", str(tmp_path / "curve.csv")])
    record = json.loads(printed.stdout)
    assert record["units"]["a90"] == "m"
    assert 5e-3 < record["a90"] < record["a90_95"]
    curve = np.genfromtxt(tmp_path / "curve.csv", delimiter=",", names=True)
    assert curve["required_size"][13] == pytest.approx(record["a90"])
