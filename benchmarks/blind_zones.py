"""Blind zones of the reference case: the tables and the figure of docs/detection-limit.md.

    python -m benchmarks.blind_zones FOLDER [--sound 1500] [--states 100]

FOLDER keeps the throws, as that of `turnout limit` does; what is there is not thrown again.
"""

import argparse
from pathlib import Path

from turnout.detection.limit import limit_map
from turnout.detection.reference import Conditions
from turnout.detection.throws import Throws, closing_time, throw_all
from turnout.plot.limit import plot_limit
from turnout.plot.style import rendered

FIGURE = Path(__file__).parents[1] / "docs" / "figures" / "blind_zones.png"
CASES = {
    "no history": Conditions(),
    "5 throws": Conditions(history=5),
    "20 throws": Conditions(history=20),
    "no history, 1/10,000": Conditions(false_alarm_rate=1e-4),
    "20 throws, 1/10,000": Conditions(history=20, false_alarm_rate=1e-4),
    "no history, 3 %": Conditions(discrepancy=0.03),
    "20 throws, 3 %": Conditions(discrepancy=0.03, history=20),
    "no history, 10 %": Conditions(discrepancy=0.10),
    "20 throws, 10 %": Conditions(discrepancy=0.10, history=20),
    "no history, Matern 3/2": Conditions(kernel="matern 3/2"),
    "20 throws, Matern 3/2": Conditions(kernel="matern 3/2", history=20),
}


def main() -> None:
    """Throw what is missing, print the table as Markdown, write the figure."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("folder", type=Path)
    options.add_argument("--sound", type=int, default=1500)
    options.add_argument("--states", type=int, default=100)
    given = options.parse_args()
    throws = throw_all(None, given.folder, sound=given.sound, states=given.states, workers=2)
    print(table(throws))
    found = limit_map(throws, CASES["no history"], closing=closing_time())
    print(dict(found.attrs))
    FIGURE.write_bytes(rendered(plot_limit(found), ".png"))


def table(throws: Throws) -> str:
    """Return a90 in millimetres by case and place, as Markdown."""
    names = [place.replace("sleeper ", "").replace("drive ", "D") for place in throws.places]
    lines = [f"| | {' | '.join(names)} |", f"|---|{'--|' * len(names)}"]
    floor: list[float] = []
    for title, conditions in CASES.items():
        found = limit_map(throws, conditions, closing=closing_time())
        if not floor:
            floor = [1e3 * float(value) for value in found["touch_floor"]]
            lines.append(_line("touch floor", floor))
        for channel in ("both drives", "drive 1", "drive 2"):
            one = found.sel(channel=channel)
            if channel == "both drives":
                lines.append(_line(title, [1e3 * float(value) for value in one["a90"]]))
            elif title in ("no history", "20 throws"):
                alone = f"{title}, {channel} alone"
                lines.append(_line(alone, [1e3 * float(value) for value in one["a90"]]))
        if title in ("no history", "20 throws"):
            one = found.sel(channel="both drives")
            for end in ("low", "high"):
                values = [1e3 * float(value) for value in one[f"a90_{end}"]]
                lines.append(_line(f"{title}, {end} end of 95 %", values))
    return "\n".join(lines)


def _line(title: str, values: list[float]) -> str:
    cells = [f"{value:.1f}" if value == value else "beyond" for value in values]
    return f"| {title} | {' | '.join(cells)} |"


if __name__ == "__main__":
    main()
