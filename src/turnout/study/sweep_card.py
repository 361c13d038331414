"""The card of a dataset: what it is, how it was made, its ranges, versions and splits."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from turnout.files.atomic import write_atomic
from turnout.files.provenance import provenance
from turnout.metric.features import FEATURES
from turnout.study.study import Study
from turnout.study.sweep_batch import SPLITS
from turnout.study.sweep_file import Stored
from turnout.study.sweep_folder import CARD
from turnout.study.sweep_index import Index, index_of, label_arrays
from turnout.study.sweep_row import OUTCOMES, UNUSABLE

Labels = Mapping[str, Stored]

_TOLD = frozenset(("outcome", "reason", "attempts", "condition", "split", *FEATURES))
MOST_REASONS = 10
MOST_TEXTS = 16


def write_card(folder: Path, study: Study) -> None:
    """Write the card of a sweep into its folder, from what is stored there.

    Parameters
    ----------
    folder : Path
        Of the sweep, with at least one batch.
    study : Study
        What was thrown.
    """
    index = index_of(folder)
    write_atomic(folder / CARD, card(index, label_arrays(index, names=_TOLD), study))


def card(index: Index, labels: Labels, study: Study) -> str:
    """Return the card as Markdown.

    Parameters
    ----------
    index : Index
        Of the sweep.
    labels : mapping of str to Stored
        From `label_arrays`.
    study : Study
        What was thrown.
    """
    made = provenance()
    known = index.attributes
    kept = ", ".join(f"`{name}`" for name in study.output.channels) or "none"
    return f"""# {study.name}

{study.description or "No description was given."}

**Simulated, not measured.** {index.scenario.size} throws of panel `{study.panel.name}`
(hash {study.panel.hash[:12]}), one a scenario. Made with turnout {known["version"]} (sources
{known["code"]}), Python {made["python"]} on {made["platform"]}.

- study digest {study.digest[:16]}, seed {study.seed}
- scheme: {study.scheme.describe()}; a throw that did not get to its end was made again with half
  the step (`attempts`)
- histories kept: {kept}, single precision, every {1e3 * study.output.interval:g} ms
- labels and features are taken from every instant that the solver kept, in double precision
- SI units; forces and displacements are positive in the closing direction

Read it with `turnout.study.sweep_read.open_sweep(folder)`: one dataset with the dimensions
scenario and time. Where a scenario is not complete numbers are NaN and logical values -1.

## Outcomes

{_outcomes(labels, missing=known["missing"])}

## Inputs

{_inputs(labels)}

## Features

By drive and direction of movement; times count from the onset of the movement.

{_features(labels)}

## Splits

By condition, never by row: all scenarios of a condition are in the same part (`split`), so that a
test sees no switch that was trained on. A part is chosen by a hash of the condition and the seed.

{_splits(labels)}
"""


def _outcomes(labels: Labels, *, missing: int) -> str:
    outcome, reason = labels["outcome"].values, labels["reason"].values
    lines = ["| outcome | scenarios |", "|---|---|"]
    lines += [f"| {name} | {int((outcome == name).sum())} |" for name in OUTCOMES]
    lines.append(f"| not thrown yet | {missing} |")
    again = int((labels["attempts"].values > 1).sum())
    lines += ["", f"{again} scenarios took a second attempt."]
    bad = reason[np.isin(outcome, UNUSABLE)]
    kinds, counts = np.unique(bad.astype(str), return_counts=True)
    order = np.argsort(-counts, kind="stable")[:MOST_REASONS]
    lines += [f"- {counts[at]} x {kinds[at]}" for at in order]
    return "\n".join(lines)


def _inputs(labels: Labels) -> str:
    lines = ["| input | unit | least | largest | values |", "|---|---|---|---|---|"]
    for name, variable in labels.items():
        if "input" not in variable.attributes:
            continue
        values = variable.values
        units = str(variable.attributes["units"])
        if values.dtype.kind == "O":
            texts = sorted(set(values.tolist()))
            shown = ", ".join(texts[:MOST_TEXTS]) + (" ..." if len(texts) > MOST_TEXTS else "")
            lines.append(f"| `{name}` | {units} | | | {len(texts)}: {shown} |")
        else:
            distinct = np.unique(values).size
            ends = f"{float(np.min(values)):.6g} | {float(np.max(values)):.6g}"
            lines.append(f"| `{name}` | {units} | {ends} | {distinct} |")
    return "\n".join(lines)


def _features(labels: Labels) -> str:
    lines = ["| feature | unit | meaning | least | largest |", "|---|---|---|---|---|"]
    for name, feature in FEATURES.items():
        values = labels[name].values if name in labels else np.array([np.nan])
        known = values[np.isfinite(values)]
        ends = f"{known.min():.6g} | {known.max():.6g}" if known.size else "- | -"
        lines.append(f"| `{name}` | {feature.units} | {feature.long_name} | {ends} |")
    return "\n".join(lines)


def _splits(labels: Labels) -> str:
    split, condition = labels["split"].values, labels["condition"].values
    lines = ["| split | conditions | scenarios |", "|---|---|---|"]
    for name in SPLITS:
        mine = split == name
        lines.append(f"| {name} | {len(set(condition[mine].tolist()))} | {int(mine.sum())} |")
    return "\n".join(lines)
