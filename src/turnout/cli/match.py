"""The command `turnout panel match`: panels that meet facts, from ranges of unknown values."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from turnout.cli.options import (
    FIGURE,
    File,
    WorkersOption,
    argument,
    gives,
    option,
)
from turnout.cli.output import Output, resumable
from turnout.cli.watch import cores, watched
from turnout.core.value_text import count_text, shown_unit

if TYPE_CHECKING:
    from turnout.calibration.matching.facts import Facts
    from turnout.calibration.matching.match import Matching
    from turnout.calibration.matching.survey import Floats, Gain, Range, Survey

MOST_PAIR_PARAMETERS = 8
"""Parameters of the pair plot: those of which the facts leave least."""


@gives(
    "panel match",
    quiet=True,
    study=File("--study FILE.toml", "Write panels far apart as a study."),
    plot=FIGURE,
)
def match_command(
    output: Output,
    facts: str = argument("FACTS", "Facts file (.toml), or paper-facts."),
    folder: Path = option(
        "--folder DIR", "Keeps the panels; run again to continue.", default=Path("matching")
    ),
    count: int = option("--count N", "Accepted panels wanted.", default=200, min=10),
    most: int = option("--most N", "Panels tried at most.", default=4000, min=100),
    choose: int = option("--choose N", "Panels written to --study.", default=50, min=2),
    workers: WorkersOption = 0,
) -> None:
    """Collect panels whose throws meet facts, and rank the measurements to make next.

    Ranges, facts and possible measurements are in FACTS. Panels are tried in waves, drawn where
    emulators of the earlier ones leave facts possible.
    """
    from turnout.calibration.matching.facts import load_facts
    from turnout.calibration.matching.match import farthest_points, match_panel, panel_workers
    from turnout.calibration.matching.survey import survey

    read, chosen = load_facts(facts), None
    with (
        resumable("run the same command to continue"),
        watched("panels", quiet=output.quiet) as watch,
        panel_workers(read, workers or cores()) as processes,
    ):
        found = match_panel(
            read, folder, count=count, most=most, workers=processes, report=watch.sweep
        )
        shown = survey(read, found.points, folder, workers=processes, report=watch.sweep)
    if output["study"] is not None and len(found.points):
        chosen = found.points[farthest_points(found.points, choose)]
    record = match_record(found, shown)
    output.show(*match_lines(found, shown.points, record))
    if output["study"] is not None and len(found.points) < choose:
        output.show("", few_text(len(found.points)))
    _write(output, read, shown.points, chosen)
    output.json(lambda: record)


def few_text(count: int) -> str:
    """Return the words about a study with fewer panels than were to be chosen.

    Examples
    --------
    >>> few_text(0)
    'the study is not written: no panel meets all facts'
    >>> few_text(1)
    'the study has 1 panel that meets all facts'
    """
    if not count:
        return "the study is not written: no panel meets all facts"
    meet = "meets" if count == 1 else "meet"
    return f"the study has {count_text(count, 'panel')} that {meet} all facts"


def _write(output: Output, facts: "Facts", points: "Floats", chosen: "Floats | None") -> None:
    from turnout.calibration.matching.survey import accepted_study, ranges
    from turnout.figures.pairs import plot_pairs

    study, plot = output["study"], output["plot"]
    if study is not None and chosen is not None:
        output.write(study, accepted_study(facts, chosen, name=study.stem))
    if plot is not None and len(points) > 2:
        left = [item.left for item in ranges(facts, points)]
        numbers = sorted(sorted(range(len(left)), key=left.__getitem__)[:MOST_PAIR_PARAMETERS])
        values, bounds = {}, {}
        for number in numbers:
            item = facts.parameters[number]
            name, factor = _axis(item.name, item.unit)
            values[name] = factor * item.value(points[:, number])
            bounds[name] = (factor * item.minimum, factor * item.maximum)
        title = f"{facts.name}: {len(points)} panels within the stated ranges"
        output.figure(plot, plot_pairs, values, bounds=bounds, title=title)


def _axis(name: str, unit: str) -> tuple[str, float]:
    """Return the label of an axis, and the factor from SI to its unit."""
    shown, size = shown_unit(unit)
    return (f"{name} [{shown}]" if shown else name), 1.0 / size


def match_record(found: "Matching", shown: "Survey") -> dict[str, Any]:
    """Return a matching for `--json`, in SI."""
    from turnout.calibration.matching.survey import (
        answer_rows,
        combinations,
        measurement_gains,
        ranges,
    )

    facts, points = found.facts, shown.points
    known = len(points) > 2
    return {
        "facts": facts.name,
        "panel": facts.panel.name,
        "panel_hash": facts.panel.hash,
        "tried": len(found.tried),
        "accepted": len(points),
        "throws": sum(item.throws for item in found.tried) + shown.throws,
        "processor_time": sum(item.seconds for item in found.tried),
        "waves": waves(found),
        "ranges": ranges(facts, points) if known else [],
        "combinations": combinations(facts, points) if known else [],
        "measurements": measurement_gains(facts, points, shown.measured, shown.answers)
        if known
        else [],
        "answers": answer_rows(facts.answers, shown.answers) if known else [],
    }


def waves(found: "Matching") -> list[dict[str, float]]:
    """Return panels tried and accepted, and the share of the ranges left, wave by wave."""
    rows = []
    for wave in sorted({item.wave for item in found.tried}):
        own = [item for item in found.tried if item.wave == wave]
        rows.append(
            {
                "wave": wave + 1,
                "tried": len(own),
                "accepted": sum(item.accepted for item in own),
                "share": own[0].share,
            }
        )
    return rows


def match_lines(found: "Matching", points: "Floats", record: Mapping[str, Any]) -> list[str]:
    """Return a matching, and what its record says, as lines for the screen."""
    from turnout.calibration.matching.survey import FEWEST, fixed_direction

    facts, minutes = found.facts, record["processor_time"] / 60.0
    lines = [
        f"{len(points)} of {len(found.tried)} panels meet all {len(facts.facts)} facts "
        f"({record['throws']} throws, {minutes:.0f} min of processor time)"
    ]
    if len(points) < FEWEST:
        return [*lines, f"too few to describe; at least {FEWEST} are needed"]
    lines += ["", f"{'parameter':<26}{'stated':>22}{'5 ... 95 % accepted':>26}{'left':>7}"]
    lines += [_range_line(item) for item in record["ranges"]]
    pairs = record["combinations"]
    lines += ["", "strongly correlated (rank):" if pairs else "no pair is strongly correlated"]
    lines += [f"  {item.first} and {item.second}: {item.correlation:+.2f}" for item in pairs]
    fixed = ", ".join(f"{share:+.2f} {name}" for share, name in fixed_direction(facts, points))
    lines += ["", f"fixed most, in shares of the ranges: {fixed}"]
    if facts.measurements:
        lines += ["", f"{'further measurement':<44}{'precision':>12}{'panels left':>13}"]
        lines += [_gain_line(item) for item in record["measurements"]]
    if facts.answers:
        lines += ["", f"{'answer':<52}{'5 %':>10}{'50 %':>10}{'95 %':>10}"]
        lines += [_answer_line(row) for row in record["answers"]]
    return lines


def _range_line(item: "Range") -> str:
    label, factor = _axis("", item.unit)
    stated = f"{factor * item.minimum:.4g} ... {factor * item.maximum:.4g}"
    accepted = f"{factor * item.low:.4g} ... {factor * item.high:.4g}{label.replace(' ', ' ')}"
    return f"{item.name:<26}{stated:>22}{accepted:>26}{100 * item.left:>6.0f} %"


def _gain_line(item: "Gain") -> str:
    label, factor = _axis("", item.unit)
    precision = f"{factor * item.precision:.3g}{label}"
    return f"{item.name:<44}{precision:>12}{100 * item.left:>11.0f} %"


def _answer_line(row: "dict[str, float | str]") -> str:
    label, factor = _axis(str(row["name"]), str(row["unit"]))
    cells = "".join(f"{factor * float(row[name]):>10.3g}" for name in ("low", "median", "high"))
    return f"{label:<52}{cells}"
