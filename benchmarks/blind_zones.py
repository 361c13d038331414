"""Blind zones of the reference case: the tables and the figure of docs/evidence/blind-zones.md.

    python -m benchmarks.blind_zones FOLDER [--sound 3000] [--states 100] [--skip-known]

FOLDER keeps the throws, as that of `turnout limit` does; what is there is not thrown again.
"""

import argparse
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from turnout.detection.limit.known_place_map import known_place_map
from turnout.detection.limit.limit_map import limit_map, sound_throws
from turnout.detection.reference import Conditions
from turnout.detection.throws import Throws, closing_time, stored_throws, throw_all
from turnout.figures.limit import plot_limit
from turnout.figures.style import rendered

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
    """Make the missing throws, print the table as Markdown, write the figure."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("folder", type=Path)
    options.add_argument("--sound", type=int, default=3000)
    options.add_argument("--states", type=int, default=100)
    options.add_argument("--skip-known", action="store_true")
    options.add_argument("--as-is", action="store_true", help="read FOLDER, throw nothing")
    given = options.parse_args()
    if given.as_is:
        throws = stored_throws(None, given.folder)
    else:
        throws = throw_all(None, given.folder, sound=given.sound, states=given.states, workers=2)
    began = time.process_time()
    found = limit_map(throws, CASES["no history"], closing=closing_time())
    print(f"a map from throws: {time.process_time() - began:.1f} s of processor time")
    print(table(throws))
    for history in (0, 20):
        claimed = optimism(throws, Conditions(history=history))
        print(f"history {history}: index of detection {100 * claimed:.1f} % too large")
    FIGURE.write_bytes(rendered(plot_limit(found), ".png"))
    for title in () if given.skip_known else ("no history", "20 throws"):
        began = time.process_time()
        known = known_place_map(throws, CASES[title], closing=closing_time())
        print(f"{title}, known place: {time.process_time() - began:.0f} s of processor time")
        for name in ("known_a90", "known_a90_low", "known_a90_high"):
            print(_line(f"{title}, {name}", [1e3 * float(value) for value in known[name]]))
        rates = [1e3 * float(known[f"known_alarm_rate_{end}"].mean()) for end in ("low", "high")]
        print(f"alarms of drawn sound throws, mean interval: {rates} per thousand")
        if title == "no history":
            FIGURE.write_bytes(rendered(plot_limit(found.merge(known, compat="override")), ".png"))


def optimism(throws: Throws, conditions: Conditions) -> float:
    r"""Return the excess of an index from half of the sound throws over the one of the others.

    The best test of one half, :math:`w = C_A^{-1} s`, has the index
    :math:`w^T s / \sqrt{w^T C_B w}` on the other; thrown sizes whose index lies between 2 and 6
    count.
    """
    halves = [
        sound_throws(
            replace(
                throws, sound=throws.sound[part::2], switch=throws.switch[part::2],
                level=throws.level[part::2],
            ),
            conditions, closing=closing_time(),
        )
        for part in (0, 1)
    ]  # fmt: skip
    near = halves[0].nearest(throws.level[throws.states])
    found = []
    for own, other in (halves, halves[::-1]):
        for state, level in enumerate(near):
            change = throws.change[state].reshape(-1, *throws.change.shape[-2:])
            signatures = own.features(change)
            signatures = signatures[np.isfinite(signatures).all(axis=1)]
            weights = np.linalg.solve(own.covariances[level], signatures.T)
            gain = np.einsum("ij,ji->i", signatures, weights)
            spread = np.einsum("ji,jk,ki->i", weights, other.covariances[level], weights)
            used = (gain > 2.0**2) & (gain < 6.0**2)
            found.append(np.sqrt(gain[used]) / (gain[used] / np.sqrt(spread[used])))
    return float(np.concatenate(found).mean() - 1.0)


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
