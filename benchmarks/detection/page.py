"""The tables and figures of docs/evidence/open-benchmark.md, from the folder of a benchmark.

`python -m benchmarks.detection page DIR` writes them after `run`. Conditions that were not run are
left out, and the page says so.
"""

import json
import re
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from benchmarks.detection.make_throws import CARD, read_throws_file
from benchmarks.detection.order import margins_of, order_changes, order_table
from benchmarks.detection.run_methods import (
    MAIN,
    OURS,
    RESULTS,
    Conditions,
    conditions_for,
    methods_for,
    numbers_digest,
)
from benchmarks.detection.tables import (
    budget_table,
    kind_table,
    markdown_table,
    merit_table,
    millimetres,
    place_table,
    said_table,
)
from benchmarks.page import DOCS, EVIDENCE, put

MACHINES = Conditions(track="machines").name
PAGE = EVIDENCE / "open-benchmark.md"
FIGURES = {"roc.png": "benchmark_roc.png", "pod.png": "benchmark_pod.png"}
Results = Mapping[str, Mapping[str, Any]]


def stored(folder: Path, conditions: Conditions) -> dict[str, dict[str, Any]]:
    """Return the results that are there, by method, in the order of the tables."""
    place = folder / RESULTS / conditions.name
    paths = {item.name: place / f"{item.name}.json" for item in methods_for(conditions)}
    return {
        name: json.loads(path.read_text(encoding="utf-8"))
        for name, path in paths.items()
        if path.exists()
    }


def by_method(conditions: list[Conditions], results: Mapping[str, Results]) -> str:
    """Return a90 mid-span at equal false alarms of each method, by conditions."""
    names = list(dict.fromkeys(name for own in conditions for name in results[own.name]))
    titles = {name: item["title"] for own in conditions
              for name, item in results[own.name].items()}  # fmt: skip
    heads = ["a90 4-8 at equal rate [mm]", *(f"{own.track[:-1]} {own.channels}, {own.history} "
             f"known, {own.discrepancy:.0%}" for own in conditions)]  # fmt: skip
    rows = []
    for name in names:
        found = [results[own.name].get(name) for own in conditions]
        rows.append([titles[name], *(
            "" if item is None else millimetres(item["score"]["equal_mid_span"]) for item in found
        )])  # fmt: skip
    return markdown_table(heads, rows)


def known_throws(folder: Path) -> int:
    """Return the length of the longest history of a switch."""
    whole = read_throws_file(folder, recorded=False)
    history = whole["switch"].to_numpy()[whole["role"].to_numpy() == "history"]
    return int(max((history == switch).sum() for switch in set(history.tolist())))


def write_page(folder: Path) -> None:
    """Write the page."""
    known = known_throws(folder)
    found = {own: stored(folder, own) for own in conditions_for(known)}
    wanted = [own for own, methods in found.items() if OURS in methods]
    results = {own.name: found[own] for own in wanted}
    margins = {own.name: margins_of(folder, own, results[own.name]) for own in wanted}
    text = PAGE.read_text(encoding="utf-8")
    first, alone = results[MAIN[0].name], results.get(MAIN[1].name)
    changes = "\n".join(f"- {line}" for line in order_changes(wanted, margins))
    text = put(text, "order", f"{order_table(wanted, results, margins)}\n\n{changes}")
    text = put(text, "by method", by_method(wanted, results))
    text = put(text, "with history", f"{merit_table(first)}\n\n{place_table(first)}")
    text = put(text, "kinds", kind_table(first))
    text = put(text, "said", said_table(first))
    text = put(text, "budget", budget_table(first))
    text = put(text, "numbers", f"Digest of all of them: `{numbers_digest(folder, results)}`")
    if MACHINES in results:
        text = put(text, "machines", merit_table(results[MACHINES]))
    if alone is not None:
        text = put(text, "no history", merit_table(alone))
    card = (folder / CARD).read_text(encoding="utf-8")
    text = put(text, "card", re.split(r"\n- ", card.split("\n\n", 2)[2])[0].strip())
    PAGE.write_text(text, encoding="utf-8")
    for name, figure in FIGURES.items():
        shutil.copyfile(folder / name, DOCS / "figures" / figure)
