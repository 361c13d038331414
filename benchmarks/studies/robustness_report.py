"""Write docs/evidence/robustness.md from the results of the long job."""

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from statistics import median, quantiles
from typing import Any

PAGE = Path(__file__).parents[2] / "docs" / "evidence" / "robustness.md"
Record = dict[str, Any]
LIMITS = (0.005, 0.02, 0.2)
"""Shares of the energy scale that the table of losses counts beyond."""

HEAD = """# Robustness

The job below draws random panels and throws them. The library panels are changed by overrides,
small panels are written from nothing: one or two rails, with and without stock rails, one to six
drives, feet, links and movements in any number. Stiffnesses are spread over six decades around
their defaults (drives from 1 kN/m to 1 GN/m), friction from 0 to 1, for all chairs or chair by
chair; movements follow each other at once, rests have no length, all chairs are lifted off or
stick; up to three objects from 1 mm to the opening stand at any station, some of them placed while
the rail is closed. Steps are 0.5 to 4 ms, cut-offs 100 Hz to none.

Each run must come to its end, or stop with a message that names time, step, residual, contacts and
a remedy and keeps the response until then. Every run, whole or partial, must be free of NaN, close
its energy balance to 1e-6 of its scale, and keep every law: no contact pulls by more than 1 mN
(or the scheme's gap tolerance times its stiffness, if that is more), no friction is above its
limit, no force is off its law, friction in sum takes energy. A run that comes to its end with an
open balance must say so itself (`inaccurate`). Where the balance is a small difference of large
terms, as under chairs lifted by metres, rounding is allowed for: 5e-13 of the energy in the linear
system with all closed chairs folded in, of a whole run 1e-14 and 1e-6 J at most. A run that stops
early is repeated with steps of 0.1 ms; if that one comes to its end, the first counts as a defect.
Every tenth run, and all that take more than 3 s, are repeated and ended by Ctrl-C at a random time.

    python -m benchmarks.studies.robustness run --count 2000 --out DIR
    python -m benchmarks.studies.robustness report DIR
    python -m benchmarks.studies.robustness show INDEX

The first command can be killed and started again; the second writes this page; the third repeats
one scenario. The same job is the test `test_robustness_long.py`, left out unless selected with
`-m long`.
"""


LOSSES = """The energy balance closes, whatever the step; the share of numerical dissipation shows
whether the step is small enough. Many of these scenarios are hard blows: a rail thrown in 0.3 s
against stops or an object of a thousand times the usual stiffness, without damping. Then a large
step loses or makes energy of the order of what there is, and the summary of a run says so; take a
smaller step.
"""


def write_page(results: Sequence[Record], job: Record) -> str:
    """Write the page, whose part on hostile input stays; return its text."""
    _, heading, hostile = PAGE.read_text(encoding="utf-8").partition("\n## Hostile input\n")
    text = page(results, job) + heading + hostile
    PAGE.write_text(text)
    return text


def page(results: Sequence[Record], job: Record) -> str:
    """Return the page for the results of a job."""
    parts = [HEAD, "## Result\n", _table(_figures(results, job), ("figure", "value"))]
    parts += ["## Outcomes by kind of panel\n", _by(results, "kind")]
    parts += ["## Outcomes by what is extreme\n", _by(results, "special")]
    parts += ["## Numerical dissipation\n", LOSSES, _losses(results)]
    parts.append("## Runs that stopped early\n")
    parts.append(_early(results))
    parts.append("## Defects\n")
    parts.append(_defects(results))
    return "\n".join(parts)


def _figures(results: Sequence[Record], job: Record) -> list[tuple[str, str]]:
    ran = [record for record in results if "steps" in record]
    stopped = [record for record in ran if record.get("deaf", 0.0) > 0.0]
    seconds = [record["seconds"] for record in results]
    low, high = (quantiles(seconds, n=20)[k] for k in (0, 18))
    early = sum(not record["complete"] for record in results)
    defects = sum(bool(record["faults"]) or record.get("fine") == "COMPLETE" for record in results)
    return [
        ("runs", str(len(results))),
        ("complete", str(len(results) - early)),
        ("stopped early", f"{early} ({100 * early / len(results):.2f} %; allowed 1 %)"),
        ("defects", str(defects)),
        ("steps in all", f"{sum(record['steps'] for record in ran):,}"),
        ("halved steps", f"{sum(record['halved'] for record in ran):,}"),
        ("runs with halved steps", str(sum(record["halved"] > 0 for record in ran))),
        ("largest energy residual", _worst(ran, "residual", "of the scale")),
        ("largest numerical loss or gain", _worst(ran, "numerical", "of the scale")),
        ("median numerical loss or gain", f"{median(_numbers(ran, 'numerical')):.1e} of the scale"),
        ("runs ended by Ctrl-C on their way", str(len(stopped))),
        ("longest time from Ctrl-C to the end", _worst(stopped, "deaf", "s")),
        ("of them more than 1 s", str(sum(record["deaf"] > 1.0 for record in stopped))),
        ("time a run, median", f"{median(seconds):.2f} s"),
        ("time a run, 5 % to 95 %", f"{low:.2f} s to {high:.2f} s"),
        ("longest run", f"{max(seconds):.1f} s"),
        ("kernels", job["kernels"]),
        ("machine", f"{job['machine']}, {job['workers']} workers, Python {job['python']}"),
        ("seed", f"{job['seed']} and the index of the scenario"),
    ]


def _numbers(results: Sequence[Record], key: str) -> list[float]:
    return [record[key] for record in results if record[key] == record[key]]


def _worst(results: Sequence[Record], key: str, unit: str) -> str:
    known = [record for record in results if record[key] == record[key]]
    if not known:
        return "none"
    worst = max(known, key=lambda record: float(record[key]))
    return f"{worst[key]:.1e} {unit} (scenario {worst['index']}, {worst['kind']})"


def _by(results: Sequence[Record], key: str) -> str:
    counts = Counter((record[key], record["outcome"]) for record in results)
    outcomes = sorted({record["outcome"] for record in results})
    rows = [
        (kind, *(str(counts[kind, outcome]) for outcome in outcomes))
        for kind in sorted({record[key] for record in results})
    ]
    return _table(rows, (key, *(name.lower().replace("_", " ") for name in outcomes)))


def _losses(results: Sequence[Record]) -> str:
    rows = []
    for step in sorted({record["step"] for record in results if "numerical" in record}):
        shares = _numbers([r for r in results if r["step"] == step and "steps" in r], "numerical")
        above = [f"{100 * sum(x > limit for x in shares) / len(shares):.1f} %" for limit in LIMITS]
        rows.append((f"{1e3 * step:g} ms", str(len(shares)), f"{median(shares):.1e}", *above))
    return _table(rows, ("step", "runs", "median share", "above 0.5 %", "above 2 %", "above 20 %"))


def _early(results: Sequence[Record]) -> str:
    rows = [
        (
            str(record["index"]),
            f"{record['kind']}, {record['special']}",
            str(record.get("message", record["faults"][:1])).replace("|", "/"),
            record.get("fine", "-").lower().replace("_", " "),
        )
        for record in results
        if not record["complete"]
    ]
    return _table(rows, ("index", "scenario", "message", "at 0.1 ms")) if rows else "None.\n"


def _defects(results: Sequence[Record]) -> str:
    def reported(record: Record) -> str:
        converges = ["complete at 0.1 ms"] if record.get("fine") == "COMPLETE" else []
        return "; ".join([*converges, *record["faults"]][:3]).replace("|", "/")

    rows = [(str(r["index"]), r["kind"], reported(r)) for r in results if reported(r)]
    return _table(rows, ("index", "scenario", "what")) if rows else "None.\n"


def _table(rows: Sequence[tuple[str, ...]], head: tuple[str, ...]) -> str:
    def line(cells: Sequence[str]) -> str:
        return f"| {' | '.join(cells)} |"

    return "\n".join([line(head), line(["---"] * len(head)), *map(line, rows), ""])
