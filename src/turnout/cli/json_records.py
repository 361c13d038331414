"""Records of results that commands print with `--json`, in SI, with their units."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, fields
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import numpy as np
    import xarray as xr

    from turnout.calibration.drive_law.compare import LawComparison
    from turnout.calibration.result import Calibration
    from turnout.calibration.validation.acceptance import Acceptance
    from turnout.cli.show import CheckThrows
    from turnout.measurement.campaign.build_campaign import BuiltCampaign
    from turnout.measurement.chain.apply import MappedChannel
    from turnout.measurement.recording import Recording
    from turnout.metric.panel_check import Concern
    from turnout.metric.sensitivity import OutputEffects
    from turnout.metric.test_piece import PieceLimit
    from turnout.panel.load import LoadedPanel
    from turnout.study.study import Study
    from turnout.study.sweep.forecast import Forecast

JsonRecord = dict[str, Any]

RUN_UNITS = {"energy_scale": "J", "wall_time": "s", "start_difference": "N"}
PANEL_UNITS = {
    **{"x": "m", "closed_gap": "m", "least_flangeway": "m", "least_flangeway_x": "m"},
    **{"force": "N", "limit": "N", "size": "m", "largest": "m", "gap": "m"},
    **{"drive_force": "N", "piece_force": "N", "largest_force": "N"},
}
MODE_UNITS = {"frequency": "Hz", "growth_rate": "1/s", "superelement_cutoff": "Hz"}
MODE_UNITS |= {"largest_x": "m"}
CHANNEL_UNITS = {"rate": "1/s", "start": "s", "duration": "s"}
PLAN_UNITS = {"throw_time": "s", "duration": "s", "disk": "byte", "disk_free": "byte"}
VALIDATION_UNITS = {"rms": "N", "spread": "N", "contact": "s", "slope": "1", "peak": "N"}
VALIDATION_UNITS |= {"plateau": "N", "nominal": "N"}
# Units of the screen in SI.
SI_UNIT, SI_SIZE = {"kN": "N", "A": "A"}, {"kN": 1e3, "A": 1.0}


def run_record(dataset: "xr.Dataset") -> tuple[JsonRecord, dict[str, str]]:
    """Return a run: verdict, key figures, energies, and the units of its keys."""
    from turnout.metric.checks import checks
    from turnout.metric.key_figure import key_figures
    from turnout.metric.summary import numerical_share, residual_share, start_difference
    from turnout.metric.verdict import break_note, verdict

    figures, made = key_figures(dataset) if dataset.sizes.get("time", 0) else [], checks(dataset)
    judged, note = verdict(dataset, made), break_note(dataset)
    attributes = dataset.attrs
    balanced = float(attributes.get("energy_scale", 0.0)) > 0 and "energy_residual" in dataset
    record = {
        "panel": attributes.get("panel"),
        "panel_hash": attributes.get("panel_hash"),
        "overrides": json.loads(attributes.get("overrides", "{}")),
        "foreign_objects": json.loads(attributes.get("foreign_objects", "[]")),
        "complete": bool(attributes["complete"]),
        "outcome": attributes["outcome"],
        "outcome_message": attributes["outcome_message"],
        "verdict": {**asdict(judged), "meaning": judged.meaning},
        "checks": [asdict(check) for check in made],
        **({"break_note": note} if note else {}),
        "figures": {item.key: item.value for item in figures},
        "labels": {item.key: item.label for item in figures},
        "energy_scale": attributes.get("energy_scale"),
        "energy_residual_share": residual_share(dataset) if balanced else None,
        "numerical_dissipation_share": numerical_share(dataset) if balanced else None,
        "loaded_by": attributes.get("loaded_by"),
        "start_difference": start_difference(dataset),
        "wall_time": attributes.get("wall_time"),
    }
    return record, {**RUN_UNITS, **{item.key: item.unit for item in figures}}


def panel_record(panel: "LoadedPanel", thrown: "CheckThrows | None" = None) -> JsonRecord:
    """Return a panel with every value and its origin, and the results of its throws."""
    from turnout.cli.show import places_of_gap
    from turnout.figures.report.values import value_groups
    from turnout.mechanism.rest import resting_gap

    record: JsonRecord = {
        "panel": panel.name,
        "panel_hash": panel.hash,
        "description": " ".join(panel.description.split()),
        "values": [
            {"group": heading, "key": leaf.below, "value": leaf.text, "origin": leaf.origin}
            for heading, leaves in value_groups(panel)
            for leaf in leaves
        ],
    }
    if thrown is None:
        x = places_of_gap(panel)
        gaps = {name: resting_gap(panel, name, x, closed=True) for name in panel.rail}
        return {**record, "x": x, "closed_gap": gaps, "throw": None}
    return {**record, **_closed_gaps(panel, thrown.dataset), "throw": _throws(thrown)}


def _closed_gaps(panel: "LoadedPanel", dataset: "xr.Dataset") -> JsonRecord:
    from turnout.metric.slip import last_instant_at

    if not dataset.sizes["time"]:
        return {"x": [], "closed_gap": {}}
    gaps: dict[str, np.ndarray] = {}
    for name, rail in panel.rail.items():
        if not rail.has_stock_rail:
            continue
        closed = last_instant_at(dataset, to="closed" if rail.closes == "+y" else "open")
        gaps[name] = closed["gap"].sel(rail=name).values
    return {"x": dataset["x"].values, "closed_gap": gaps}


def _throws(thrown: "CheckThrows") -> JsonRecord:
    from turnout.metric.slip import margins

    dataset = thrown.dataset
    ended = bool(dataset.sizes["time"])
    results = {
        item.name: getattr(thrown, item.name) for item in fields(thrown) if item.name != "dataset"
    }
    return {
        "complete": bool(dataset.attrs["complete"]),
        "outcome": dataset.attrs["outcome"],
        "margins": [asdict(item) for item in margins(dataset)] if ended else [],
        "least_flangeway": float(dataset["least_flangeway"]) if ended else None,
        "least_flangeway_x": float(dataset["least_flangeway_x"]) if ended else None,
        **results,
    }


CHECK_UNITS = {"size": "m", "largest": "m"}


def check_record(
    file: str,
    panel: "LoadedPanel",
    found: "Sequence[Concern]",
    dataset: "xr.Dataset | None",
    pieces: "Sequence[PieceLimit]",
) -> JsonRecord:
    """Return the result of a panel check: warnings, how its throw ended, least test pieces."""
    return {
        "file": file,
        "panel": panel.name,
        "panel_hash": panel.hash,
        "warnings": found,
        "thrown": dataset is not None,
        "complete": None if dataset is None else bool(dataset.attrs["complete"]),
        "outcome": None if dataset is None else dataset.attrs["outcome"],
        "lock_rule": panel.lock.rule,
        "test_pieces": pieces,
    }


def mode_record(
    dataset: "xr.Dataset", panel: "LoadedPanel", factors: Sequence[float]
) -> JsonRecord:
    """Return frequencies and motions of every mode, and the stability of sliding."""
    from turnout.metric.stability import friction_stability

    sliding = bool(panel.movement and panel.chair)
    stability = [friction_stability(panel, friction_factor=item) for item in factors if sliding]
    return {
        "modes": [
            {
                "system": str(mode["system"].item()),
                "number": int(mode["number"]),
                "frequency": float(mode["frequency"]),
                "damping_ratio": float(mode["damping_ratio"]),
                "motion_share": {
                    str(kind): float(mode["motion_share"].sel(motion=kind))
                    for kind in mode["motion"].values
                },
                "largest_rail": str(mode["largest_rail"].item()),
                "largest_x": float(mode["largest_x"]),
            }
            for mode in (dataset.isel(mode=at) for at in range(dataset.sizes["mode"]))
        ],
        "stability": [
            {
                "friction_factor": item.friction_factor,
                "stable": item.stable,
                "worst": item.worst,
                "superelement_cutoff": item.superelement_cutoff,
            }
            for item in stability
        ],
    }


def recording_record(recording: "Recording", kind: str, *, steps: int) -> JsonRecord:
    """Return the channels of a recording."""
    from turnout.measurement.recording import overview

    return {
        "source": recording.source,
        "format": kind,
        "start_time": recording.start_time,
        "channels": [overview(item, steps=steps) for item in recording.channels.values()],
        "problems": recording.problems,
    }


def quantity_record(dataset: "xr.Dataset", rows: "Sequence[MappedChannel]") -> JsonRecord:
    """Return the quantities of a recording, each with its unit."""
    return {
        "source": dataset.attrs["source"],
        "start": float(dataset["time"][0]),
        "end": float(dataset["time"][-1]),
        "rate": 1.0 / float(dataset["time"][1] - dataset["time"][0]),
        "quantities": [
            {
                **{item.name: getattr(row, item.name) for item in fields(row)},
                "least": SI_SIZE[row.unit] * row.least,
                "largest": SI_SIZE[row.unit] * row.largest,
                "unit": SI_UNIT[row.unit],
            }
            for row in rows
        ],
        "problems": [text for text in str(dataset.attrs["problems"]).split("\n") if text],
    }


def campaign_record(campaign: "BuiltCampaign") -> JsonRecord:
    """Return movements, exclusions with reasons, and remarks of a campaign."""
    sheet = campaign.sheet
    return {
        "title": sheet.title,
        "recorder": campaign.recorder,
        "synthetic": bool(sheet.synthetic),
        "movements": len(sheet.runs),
        "usable": len(sheet.runs) - len(campaign.excluded),
        "from_cache": campaign.reused,
        "excluded": [
            {"movement": item.run.name, "reasons": item.reasons} for item in campaign.excluded
        ],
        "remarks": campaign.remarks,
    }


def calibration_record(calibration: "Calibration") -> tuple[JsonRecord, dict[str, str]]:
    """Return a calibration, and the unit of each parameter."""
    names = (
        *("panel", "panel_hash", "data", "movements", "parameters", "covariance", "stages"),
        *(
            "scatter",
            "posterior",
            "findings",
            "warnings",
            "causes",
            "fitted_causes",
            "sensors",
            "chain",
            "effects",
        ),
    )
    record = {name: getattr(calibration, name) for name in names}
    record |= {"trustworthy": not calibration.distrust, "reasons": calibration.distrust}
    return record, {item.name: item.unit for item in calibration.parameters}


def validation_record(
    verdict: "Acceptance", remarks: Sequence[str], laws: "LawComparison | None" = None
) -> JsonRecord:
    """Return verdict, errors of each channel, and the comparison of drive laws."""
    return {
        "valid": verdict.accepted,
        "text": verdict.text,
        "reasons": verdict.reasons,
        "judged": verdict.judged,
        "used": verdict.used,
        "cover": verdict.cover,
        "power": verdict.power,
        "channels": [
            {
                **{item.name: getattr(part, item.name) for item in fields(part)},
                "spreads": part.spreads,
            }
            for part in verdict.channels
        ],
        "remarks": [*verdict.remarks, *remarks],
        "drive_laws": laws,
    }


def study_record(study: "Study", found: "Forecast | None", *, workers: int) -> JsonRecord:
    """Return the size of a study and, after trial throws, its time and disk space."""
    return {
        "study": study.name,
        "seed": study.seed,
        "panel": study.panel.name,
        "panel_hash": study.panel.hash,
        "scenarios": study.count,
        "inputs": [*study.variables, *(field.name for field in study.fields)],
        "channels": study.output.channels,
        "workers": workers,
        "throw_time": found.throw_time if found else None,
        "duration": found.duration(study.count, workers=workers) if found else None,
        "disk": found.disk(study) if found else None,
        "faults": found.faults if found else [],
    }


def map_record(labels: "xr.Dataset", cells: "xr.Dataset") -> tuple[JsonRecord, dict[str, str]]:
    """Return end states of a sweep and its map over two inputs."""
    from turnout.metric.sweep_map import STATES, end_state
    from turnout.metric.verdict import break_note

    state, note = end_state(labels).to_numpy(), break_note(labels)
    quantities = [str(name) for name in cells.data_vars if name != "state"]
    units = {name: str(cells[name].attrs.get("units", "")) for name in (*quantities, "x", "y")}
    record = {
        "sweep": labels.attrs.get("name"),
        "missing": int(labels.attrs["missing"]),
        "states": {name: int((state == number).sum()) for number, name in enumerate(STATES)},
        **({"break_note": note} if note else {}),
        "x_input": cells.attrs["x_input"],
        "y_input": cells.attrs["y_input"],
        "x": cells["x"].values,
        "y": cells["y"].values,
        "state": [[STATES[item] for item in row] for row in cells["state"].values],
        **{name: cells[name].values for name in quantities},
    }
    return record, {name: unit for name, unit in units.items() if unit not in ("", "1")}


def effects_record(
    labels: "xr.Dataset", found: "Sequence[OutputEffects]", *, notes: Mapping[str, str]
) -> JsonRecord:
    """Return Sobol indices and main effects of each output."""
    return {
        "sweep": labels.attrs.get("name"),
        "missing": int(labels.attrs["missing"]),
        "outputs": [
            {
                "name": item.output.name,
                "unit": item.output.units,
                "indices": item.indices,
                "effects": item.effects,
                "note": notes.get(item.output.name),
            }
            for item in found
        ],
    }
