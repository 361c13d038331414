"""The page about judged throws, from verdicts as plain records."""

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

from turnout.detection.conditions import CURRENT, FORCE, TRAINED, UNITS
from turnout.detection.detector.another_switch import misfit_remark
from turnout.detection.detector.object_kinds import kinds_in_words
from turnout.detection.detector.throw_verdict import (
    ALARM,
    CANNOT,
    CAUSE,
    OBJECTS,
    SOUND,
    UNKNOWN,
)
from turnout.detection.detector.trends import LEAST_THROWS, staying_causes, trend_of
from turnout.figures.detection import trend_sheet
from turnout.figures.report.page import Page, Section, Table
from turnout.figures.report.run import picture_of
from turnout.figures.style import MILLI
from turnout.metric.finding import Finding

SAFETY = (
    "Advisory: a verdict is no safety function and replaces neither lock nor end-position sensors. "
    f"{TRAINED.capitalize()}."
)


def detection_page(
    verdicts: Sequence[Mapping[str, Any]], *, about: Mapping[str, str], quantity: str = FORCE
) -> Page:
    """Return the page about judged throws.

    Parameters
    ----------
    verdicts : sequence of mapping
        Fields of `turnout.detection.detector.throw_verdict.Verdict`, in the order of the throws.
    about : mapping of str to str
        Origin of the verdicts, by key.
    quantity : str
        Judged quantity of the drives.
    """
    counts = Counter(str(item["status"]) for item in verdicts)
    findings = [_headline(verdicts, counts)]
    lost = counts.get(CANNOT, 0) + counts.get(OBJECTS, 0)
    if lost:
        detail = f"{lost} of {len(verdicts)} throws; the table says why"
        findings.append(Finding("bad", "Could every throw be judged?", "No", detail))
    wide = [str(item["name"]) for item in verdicts if _called(item)]
    if wide:
        detail = f"inferred in {len(wide)} of {len(verdicts)} throws, the last {wide[-1]}"
        findings.append(Finding("bad", "Is a gap above its limit?", "Yes", detail))
    if remark := misfit_remark(
        [str(item["status"]) for item in verdicts], {**about, "quantity": quantity}
    ):
        findings.append(Finding("look", "Does the detector fit the switch?", "Unclear", remark))
    findings.append(Finding("fact", "May trains rely on it?", "No", SAFETY))
    staying = staying_causes(verdicts)
    if staying:
        name, (since, total) = next(iter(staying.items()))
        detail = f"{name}, since {verdicts[since]['name']} (cumulated log odds {total:.1f})"
        findings.append(Finding("look", "Does a cause stay?", "Yes", detail))
    called = [item for item in verdicts if item["status"] != SOUND]
    sections = [
        Section(
            heading="Throws",
            text="Log odds: logarithm of the likelihood ratio, object against every other cause. "
            "Gaps with their 95 % intervals are inferred from the drive forces.",
            tables=[_table(verdicts)],
        ),
    ]
    if called:
        sections.append(
            Section(heading="What to do", text="Throws not called sound.", tables=[_advice(called)])
        )
    if len(verdicts) >= LEAST_THROWS:
        sections.append(
            Section(
                heading="Trends",
                text="Straight lines through all throws that were judged. A worn clutch shows in "
                "the largest force only where the drive slips.",
                pictures=[picture_of(trend_sheet(verdicts))],
                tables=[_trends(verdicts, quantity)],
            )
        )
    return Page(
        title="Throws judged from drive forces",
        subtitle=f"{TRAINED.capitalize()}. "
        + ", ".join(f"{name} {value}" for name, value in about.items() if value),
        findings=findings,
        sections=sections,
        footer=[SAFETY],
    )


def _headline(verdicts: Sequence[Mapping[str, Any]], counts: Mapping[str, int]) -> Finding:
    question, total = "Is something trapped?", len(verdicts)
    alarms = counts.get(ALARM, 0)
    if alarms:
        return Finding("bad", question, "Yes", f"an object is called in {alarms} of {total} throws")
    others = counts.get(CAUSE, 0) + counts.get(UNKNOWN, 0)
    if others:
        detail = f"but {others} of {total} throws deviate otherwise"
        return Finding("look", question, "Not called", detail)
    sound, lost = counts.get(SOUND, 0), counts.get(CANNOT, 0) + counts.get(OBJECTS, 0)
    if not sound:
        return Finding("bad", question, "Unknown", f"none of {total} throws could be judged")
    if lost:
        detail = f"in the {sound} throws that could be judged; {lost} of {total} could not"
        return Finding("look", question, "Not called", detail)
    return Finding("good", question, "Not called", f"{sound} of {total} throws are called sound")


def _table(verdicts: Sequence[Mapping[str, Any]]) -> Table:
    limits = {gap["name"]: gap["limit"] for item in verdicts for gap in item["gaps"]}
    rows = []
    for item in verdicts:
        gaps = {gap["name"]: gap for gap in item["gaps"]}
        rows.append(
            [
                str(item["name"]),
                str(item["status"]),
                _number(item["log_ratio"], "{:+.1f}"),
                _number(item["friction"], "{:.2f}"),
                *(_gap(gaps.get(name)) for name in limits),
                str(item["reason"]) or _remark(item),
            ]
        )
    marked = frozenset(i for i, item in enumerate(verdicts) if item["status"] != SOUND)
    gap_columns = [f"{name} [mm], limit {MILLI * limit:.0f}" for name, limit in limits.items()]
    columns = ["throw", "verdict", "log odds", "friction", *gap_columns, "remark"]
    return Table("", columns, rows, marked)


def _advice(called: Sequence[Mapping[str, Any]]) -> Table:
    rows = [[str(item["name"]), str(item["status"]), str(item["advice"])] for item in called]
    return Table("", ["throw", "verdict", "next"], rows)


def _trends(verdicts: Sequence[Mapping[str, Any]], quantity: str) -> Table:
    drives = dict.fromkeys(name for item in verdicts for name in item["peaks"])
    lines = [("friction level [-]", [item["friction"] for item in verdicts], "{:.3f}")]
    for name in drives:
        peaks = [item["peaks"].get(name, float("nan")) for item in verdicts]
        label = f"largest {quantity} of drive {name} [{UNITS[quantity]}]"
        lines.append((label, peaks, "{:.2f}" if quantity == CURRENT else "{:.0f}"))
    rows = []
    for label, values, shape in lines:
        found = trend_of(values)
        if found is not None:
            change = f"{shape} ({shape} to {shape})".format(found.slope, found.low, found.high)
            said = "changes" if found.clear else "no clear change"
            rows.append([label, shape.format(found.first), shape.format(found.last), change, said])
    return Table("", ["of", "first", "last", "change in 100 throws (95 %)", "trend"], rows)


def _remark(item: Mapping[str, Any]) -> str:
    """Return object or cause, and the gaps that are called above their limits."""
    said = [_object(item)] if item["size"] else [str(item["cause"])]
    if called := _called(item):
        said.append(f"gap above its limit at {', '.join(called)}")
    return "; ".join(text for text in said if text)


def _called(item: Mapping[str, Any]) -> list[str]:
    return [str(gap["name"]) for gap in item["gaps"] if gap["called"]]


def _object(item: Mapping[str, Any]) -> str:
    size = item["size"]
    place = f"{MILLI * size['middle']:.1f} mm at {' or '.join(item['places'])}"
    return f"{place}, kind {kinds_in_words(item['kinds'])}" if item["kinds"] else place


def _gap(gap: Mapping[str, float] | None) -> str:
    if gap is None:
        return ""
    low, high = MILLI * gap["low"], MILLI * gap["high"]
    return f"{MILLI * gap['middle']:z.1f} ({low:z.1f} to {high:z.1f})"


def _number(value: float, shape: str) -> str:
    return shape.format(value) if value == value else ""
