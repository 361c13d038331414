"""Plain-language findings of a run."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import xarray as xr

from turnout.metric.channel_features import final_value
from turnout.metric.key_figure import peak_note
from turnout.metric.summary import (
    ends_inaccurate,
    numerical_warning,
    slip_text,
    wheel_texts,
)
from turnout.throw.checks import (
    SWITCHED_OFF,
    Check,
    checks,
    direction_of,
    format_force,
    margins,
    unmet,
)
from turnout.throw.verdict import (
    Verdict,
    object_items,
    verdict,
)

HEADLINE = "Outcome"
"""The question that the headline of a run answers; always given."""

Severity = Literal["good", "look", "bad", "fact"]


@dataclass(frozen=True, slots=True)
class Finding:
    """A question about a throw, and its answer.

    Attributes
    ----------
    level : str
        "good", "look" (should be checked), "bad", or "fact" (a fact without a judgement).
    question : str
        Such as "Locked?".
    answer : str
        In a word or two.
    detail : str
        Which, where, when, by what margin.
    meaning : str
        Consequence for trains, in a sentence without terms; of the headline alone.
    """

    level: Severity
    question: str
    answer: str
    detail: str
    meaning: str = ""


def findings(dataset: xr.Dataset) -> list[Finding]:
    """Return the findings of a run, the answer to "was the object detected?" first.

    Parameters
    ----------
    dataset : xarray.Dataset
        One run, simulated or measured; questions that its channels cannot answer are left out.

    Returns
    -------
    list of Finding

    Examples
    --------
    >>> run = xr.Dataset({"locked": ("time", [False, True])}, {"time": [0.0, 1.0]})
    >>> [(item.question, item.answer) for item in findings(run)]
    [('Outcome', 'Not judged'), ('Locked?', 'Yes')]
    """
    if not dataset.sizes.get("time", 0):
        reason = str(dataset.attrs.get("outcome_message", "it holds no instant"))
        return [Finding("bad", HEADLINE, "Nothing to judge", reason)]
    made = checks(dataset)
    judged = verdict(dataset, made)
    found = [*_complete(dataset), headline(judged, dataset), *_states(dataset, made)]
    found += [*_slipped(dataset, made), *_nearest(made)]
    found += [*_object(dataset), *_of_wheels(dataset, made)]
    warning = numerical_warning(dataset) if "energy_numerical" in dataset else None
    if warning is not None:
        found.append(Finding("look", "Can the numbers be trusted?", "With care", warning))
    unknown = judged.kind == "not judged" and bool(object_items(dataset))
    return _without_praise(found) if judged.missed or unknown else found


# What accepts a movement; not good while an object is trapped.
_ACCEPTS = (
    *("Locked?", "In control?", "Did a drive slip?"),
    *("Least margin to slip", "Least flangeway", "Least gauge"),
)


def _without_praise(found: list[Finding]) -> list[Finding]:
    """Take the good level from the checks that an object has passed, or may have."""
    return [
        replace(item, level="look") if item.question in _ACCEPTS and item.level == "good" else item
        for item in found
    ]


def _complete(dataset: xr.Dataset) -> list[Finding]:
    if dataset.attrs.get("complete", True):
        return []
    message = str(dataset.attrs.get("outcome_message", "ended early"))
    if ends_inaccurate(dataset):
        return [Finding("bad", "Can the numbers be trusted?", "No", message)]
    return [Finding("bad", "Is the run whole?", "No", f"{message}; what follows holds until then")]


def headline(found: Verdict, dataset: xr.Dataset) -> Finding:
    """Return a verdict as an answer."""
    detail = found.text.partition(": ")[2].rstrip(".")
    if found.kind in ("not judged", "depends on how it breaks"):
        answer = f"{found.kind[0].upper()}{found.kind[1:]}"
        return Finding("look", HEADLINE, answer, detail, found.meaning)
    if found.missed:
        return Finding("bad", HEADLINE, "Undetected object", detail, found.meaning)
    if found.kind.startswith("detected"):
        return Finding("good", HEADLINE, "Object detected", detail, found.meaning)
    if object_items(dataset) and not bool(dataset.get("object_touched", True)):
        return Finding("look", HEADLINE, "Object never touched", detail)
    level: Severity = "good" if found.kind == "sound" else "bad"
    return Finding(level, HEADLINE, found.head, detail, found.meaning)


def _answer(asked: Sequence[Check], question: str) -> tuple[Severity, str, str]:
    """Return level, question and answer, of a refusal with its movements."""
    out = unmet(asked)
    if any(check.met is None for check in asked):
        return "look", question, "No" if out else "Not judged"
    if not out:
        return "good", question, "Yes"
    where = list(dict.fromkeys(direction_of(check.movement) for check in out))
    all_of = len(where) == len({check.movement for check in asked}) or not where[0]
    return "bad", question, "No" if all_of else f"No, not after {' and '.join(where)}"


def _states(dataset: xr.Dataset, made: Sequence[Check]) -> Iterator[Finding]:
    """Yield lock and sensors at the rests, with the deciding value of each."""
    rule = dataset.attrs.get("lock_rule")
    for kind, question in (("lock", "Locked?"), ("control", "In control?")):
        asked = [check for check in made if check.kind == kind]
        if not asked:
            continue
        parts = [f"by the rule '{rule}'"] if rule and kind == "lock" else []
        for check in asked:
            # A refusal without numbers names its movement itself.
            named = check.movement is None or (check.met is False and not check.numbers)
            after = "" if named else f"after {direction_of(check.movement)} "
            text = check.said if check.numbers else "" if check.met else check.text
            parts += [f"{after}{text}"] if text else []
        yield Finding(*_answer(asked, question), "; ".join(parts) or "at the end")


def _slipped(dataset: xr.Dataset, made: Sequence[Check]) -> list[Finding]:
    if "drive_slipping" not in dataset:
        return []
    found = unmet(made, "slip")
    if not found:
        machines = "drive_power" in dataset
        text = "no clutch or bushing slipped" if machines else "every drive followed its marker"
        return [Finding("good", "Did a drive slip?", "No", text)]
    slipped = dict.fromkeys(check.drive for check in found if check.criterion != SWITCHED_OFF)
    names = ", ".join(slipped or dict.fromkeys(check.drive for check in found))
    answer = f"Yes, drive {names}" if slipped else f"No, but drive {names} has not arrived"
    detail = "; ".join(slip_text(dataset, check) for check in found)
    return [Finding("look", "Did a drive slip?", answer, detail)]


def _nearest(made: Sequence[Check]) -> list[Finding]:
    """Return the drive with the least force left if none has slipped, and its margin."""
    left = margins(made)
    if not left or unmet(made, "slip"):
        return []
    least = min(left, key=lambda check: check.share)
    detail = f"drive {least.drive} {direction_of(least.movement)}: {least.numbers}, {least.left}"
    level: Severity = "look" if least.tight else "good"
    return [Finding(level, "Least margin to slip", f"{100 * least.share:.1f} %", detail)]


def _object(dataset: xr.Dataset) -> list[Finding]:
    if "object_touched" not in dataset or not dataset["object_touched"]:
        return []
    detail = f"first touched at t = {float(dataset['contact_time']):.2f} s"
    if "object_force" not in dataset:
        return [Finding("fact", "Force on the object", "not known", detail)]
    force = dataset["object_force"]
    detail += f"; {format_force(force.max())} at most{peak_note(dataset)}"
    return [Finding("fact", "Force on the object", format_force(final_value(force)), detail)]


def _of_wheels(dataset: xr.Dataset, made: Sequence[Check]) -> Iterator[Finding]:
    """Yield the room that passing wheels have."""
    for kind, text in wheel_texts(dataset).items():
        met = [check.met for check in made if check.kind == kind]
        level: Severity = "fact" if not met else "good" if met[0] else "look"
        answer, _, detail = text.partition(" at ")
        yield Finding(level, f"Least {kind}", answer, f"at {detail}")
