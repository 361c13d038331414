"""Campaigns whose generator differs from the model that is calibrated to them, with hidden truths.

    python -m benchmarks.studies.hard_campaigns [hard|further|unlisted] [--out DIR] [--seed N]
                                                [--case NAME ...] [--panel PANEL] [--write]

Each case is a documented campaign folder of 14 recordings at 1 kHz: amplifier volts, noise, mains
hum and drift, friction that scatters by 2 % from throw to throw. The truth is solved by turnout in
waveform mode, but with another mesh, step, damping and number of modes than a fit uses, on a switch
that the fitted panel cannot describe (friction of single chairs, other sections, a bushing that is
soft over its first 2 mm, a clutch that slips elsewhere in each throw), and through measuring chains
that differ from the stated one. Equations are therefore shared with the model and only the states
differ; campaigns by independent programs are the harder test.

The truth of a case is what its parameter means on that switch: friction is the mean over the chairs
weighted by their normal force while the rail slides, a slip level the mean over the throws, the
stiffness of a bushing the slope beyond its soft zone. For each case the table has error, interval,
whether it covers, the verdict and the causes that are named; `--write` puts it on the page, in a
part of its group and seed (`hard-N`, `hard-further-N`), whose words around it are written by hand.
Cases that name chairs, sections or fastenings of `sb1` (chairs, sections, longer) need that panel,
and those with tables of a bushing (bushing, play, knee) one whose drives slip with 10 kN/m as well.
With `--out` a run that was stopped goes on, and one that is whole is only written: delete a
`-result.json` to calibrate its case again.
"""

import argparse
import json
import shutil
import tempfile
import time
from pathlib import Path
from typing import Any

from benchmarks.page import EVIDENCE, put_section
from benchmarks.studies.hard_cases import (
    ALL,
    GROUPS,
    K1,
    K2,
    MU,
    S1,
    S2,
    Hard,
    Values,
    make,
)
from turnout.calibration.calibrate import calibrate
from turnout.calibration.stages import default_plan
from turnout.core.errors import TurnoutError
from turnout.measurement.campaign.build_campaign import build_campaign_dataset
from turnout.panel.load import load_panel

PAGE = EVIDENCE / "calibration.md"
NAMED = 3


def result_of(
    case: Hard, folder: Path, *, truth: Values, throws: Path, panel_name: str
) -> dict[str, Any]:
    """Calibrate to a campaign as a user would, and compare with the truth."""
    panel = load_panel(panel_name, overrides=case.start)
    began = time.process_time()
    try:
        built = build_campaign_dataset(folder)
        said = [*built.remarks, *(r for item in built.excluded for r in item.reasons)]
        if built.dataset is None:
            return {
                "verdict": "refused",
                "causes": [_named(text) for text in said[:NAMED]],
                "values": {},
                "seconds": 0.0,
            }
        found = calibrate(built.dataset, panel, plan=default_plan(panel), folder=throws).calibration
    except TurnoutError as error:
        return {"verdict": "refused", "causes": [_named(str(error))], "values": {}, "seconds": 0.0}
    values = {}
    for item in (item for item in found.parameters if item.name in truth):
        low, high = item.interval
        values[item.name] = {
            "error": item.value / truth[item.name] - 1.0,
            "interval": [low / truth[item.name] - 1.0, high / truth[item.name] - 1.0],
            "covered": bool(low <= truth[item.name] <= high),
            "state": item.state,
        }
    causes = list(found.causes)
    said = [text for text in said if "swapped" in text or "dead channel of drive" in text]
    return {
        "verdict": "does not follow" if found.distrust else "follows",
        "causes": [*(_named(text) for text in said[:1]), *causes][:NAMED],
        "values": values,
        "seconds": time.process_time() - began,
        "distrust": list(found.distrust),
        "warnings": list(found.warnings),
    }


def _named(text: str) -> str:
    """Return a remark on a recording with its subject first, as causes have it."""
    name = next((name for name in ("swapped channels", "dead channel") if name in text), "")
    return text if not name or text.startswith(f"{name}:") else f"{name}: {text}"


def _is_right(case: Hard, causes: list[str]) -> bool:
    """Return True if the cause is among those that are named, with its drive if it has one."""
    return any(
        text.split(":")[0] == case.cause and (not case.drive or f"drive {case.drive}" in text)
        for text in causes
    )


def table(
    results: dict[str, dict[str, Any]], *, group: str, seed: int, panel_name: str
) -> list[str]:
    """Return the table of cases, and their sums."""
    words = "" if panel_name == "sb1" else f"--panel {panel_name} "
    words += "" if set(results) >= set(GROUPS[group]) else "".join(f"--case {n} " for n in results)
    lines = [
        f"14 recordings each, panel `{panel_name}`, seed {seed}; written by `python -m "
        f"benchmarks.studies.hard_campaigns {group} {words}--seed {seed} --out DIR --write`. "
        "Per value: error ± half the 95 % interval in %, and a star where it misses the truth.",
        "",
        "| what differs | friction | k1 | level 1 | k2 | level 2 | verdict | causes named | "
        "processor time |",
        "|---|---|---|---|---|---|---|---|--:|",
    ]
    for name, item in results.items():
        cells = [_cell(item["values"].get(key)) for key in (MU, K1, S1, K2, S2)]
        causes = "; ".join(text.split(":")[0] for text in item["causes"]) or "-"
        said = f"{item['verdict']} | {causes} | {item['seconds']:.0f} s"
        lines.append(f"| {ALL[name].what} | {' | '.join(cells)} | {said} |")
    follows = [item for item in results.values() if item["verdict"] == "follows"]
    given = [v for item in follows for v in item["values"].values() if v["state"] == "fitted"]
    right = [name for name, item in results.items() if _is_right(ALL[name], item["causes"])]
    wanted = [name for name in results if ALL[name].cause]
    lines += [
        "",
        f"Follows in {len(follows)} of {len(results)} cases; {sum(v['covered'] for v in given)} of "
        f"{len(given)} intervals then given hold the truth; the right cause is among those named "
        f"in {len(right)} of {len(wanted)}.",
    ]
    return lines


def _cell(value: dict[str, Any] | None) -> str:
    if value is None:
        return "-"
    if value["state"] != "fitted":
        return str(value["state"])
    reach = 50.0 * (value["interval"][1] - value["interval"][0])
    star = "" if value["covered"] else " *"
    return f"{100 * value['error']:+.2f} ± {reach:.2f}{star}"


def _kept_result(name: str, out: Path, *, seed: int, panel_name: str) -> dict[str, Any]:
    """Make and calibrate a case, or read its kept result."""
    case, folder = ALL[name], out / f"{name}-{seed}"
    made, done = out / f"{name}-{seed}.json", out / f"{name}-{seed}-result.json"
    if done.exists():
        kept = dict(json.loads(done.read_text(encoding="utf-8")))
        return kept | {"causes": [_named(text) for text in kept["causes"]]}
    if not made.exists():
        # Of a run that was stopped.
        shutil.rmtree(folder, ignore_errors=True)
        truth = make(case, folder, seed=seed, panel_name=panel_name)
        made.write_text(json.dumps(truth), encoding="utf-8")
    truth = json.loads(made.read_text(encoding="utf-8"))
    result = result_of(case, folder, truth=truth, throws=out / "throws", panel_name=panel_name)
    done.write_text(json.dumps(result), encoding="utf-8")
    return result


def main() -> None:
    """Make and calibrate the cases, print the table, and put it on the page if asked to."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path)
    parser.add_argument("--case", choices=list(ALL), action="append")
    parser.add_argument("group", nargs="?", choices=list(GROUPS), default="hard")
    parser.add_argument("--seed", type=int, default=24)
    parser.add_argument("--panel", default="sb1")
    parser.add_argument("--write", action="store_true")
    given = parser.parse_args()
    out = given.out or Path(tempfile.mkdtemp())
    out.mkdir(parents=True, exist_ok=True)
    results = {}
    for name in given.case or GROUPS[given.group]:
        results[name] = _kept_result(name, out, seed=given.seed, panel_name=given.panel)
        print(f"{name}: {json.dumps(results[name])}", flush=True)
    lines = table(results, group=given.group, seed=given.seed, panel_name=given.panel)
    print("\n".join(lines))
    if given.write:
        kind = "" if given.group == "hard" else f"{given.group}-"
        kind += "" if given.panel == "sb1" else f"{given.panel}-"
        heading = f"Where model or sensors are wrong, seed {given.seed}"
        put_section(PAGE, name=f"hard-{kind}{given.seed}", heading=heading, lines=lines)


if __name__ == "__main__":
    main()
