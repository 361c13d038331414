"""Run a scenario and list everything about its response that must not be.

What must hold whatever the panel: no NaN, an energy residual below 1e-6 of its scale, no contact
that pulls, no friction above its limit, every force on its law, friction that takes energy, rows in
equilibrium; and a run that ends early says when, where, why, and what to do.
"""

import hashlib
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any
from unittest.mock import patch

import numpy as np
import xarray as xr
from tests.verification.robustness_scenarios import Scenario

import turnout.throw.simulate as simulate_module
from turnout.core.scheme import Scheme
from turnout.law.table import LawTable
from turnout.mechanism.drive_machines import schedule_waits
from turnout.mechanism.mechanism import Mechanism
from turnout.panel.load import LoadedPanel
from turnout.solver.condense import base_stiffness
from turnout.solver.integration import History, RunPlan, carry_out
from turnout.solver.outcome import ADVICE, LEAST_SCALE, Code

BOOKS = 1e-6
"""Largest energy residual, as a share of its scale."""
ROUNDING = 5e-13
"""What a run that is not complete may be off besides, as a share of the energy of the folded linear
system.

Closed chairs and drives are part of that system; chairs lifted by metres, or rails that never move,
leave their balance as small differences of its large terms. Of a complete run that is 1e-14, and
1e-5 J at most.
"""
PULL = 1e-3
"""Force that a contact may pull with, or friction exceed its limit [N]."""
ROWS = 1e-9
"""Largest disagreement of the rows with the base system [m]."""
MAY_LACK = {
    "contact_time",
    "object_contact_time",
    "force_margin",
    "least_flangeway",
    "least_flangeway_x",
}
"""Labels that are NaN where there is nothing to say."""
OF_STOCK_RAIL = {"gap", "drive_gap", "end_gap", "sensor_gap", "stop_force"}
"""Channels that are NaN for a rail without a stock rail."""


@dataclass(frozen=True, slots=True)
class Run:
    """A scenario's run with all that its dataset was made from."""

    panel: LoadedPanel
    mechanism: Mechanism
    scheme: Scheme
    history: History
    dataset: xr.Dataset


def run_scenario(scenario: Scenario, *, step: float | None = None) -> Run:
    """Call `simulate`, and keep the mechanism and the history that it throws away."""
    panel, scheme = scenario.panel(), scenario.scheme(step=step)
    kept = list[tuple[Mechanism, History]]()

    def keeping(plan: RunPlan, **named: Any) -> History:
        history = carry_out(plan, **named)
        kept.append((plan.setup.arrangement.mechanism, history))
        return history

    with patch.object(simulate_module, "carry_out", keeping):
        dataset = simulate_module.simulate(
            panel,
            foreign_object=scenario.foreign_objects(),
            scheme=scheme,
            throw=False,
        )
    mechanism, history = kept[-1]
    return Run(panel, mechanism, scheme, history, dataset)


def digest(dataset: xr.Dataset) -> str:
    """Return a digest of every bit of the data variables."""
    found = hashlib.sha256()
    for name in sorted(dataset.data_vars):
        found.update(str(name).encode())
        found.update(np.ascontiguousarray(dataset[name].to_numpy()).tobytes())
    return found.hexdigest()


def faults(run: Run) -> list[str]:
    """Return what must not be, in words; empty for a sound run."""
    found = [*_message_faults(run), *_nan_faults(run)]
    if run.history.time.size:
        found += [*_contact_faults(run), *_friction_faults(run), *_law_faults(run)]
        found += _book_faults(run)
    return found


def _message_faults(run: Run) -> Iterator[str]:
    outcome = run.history.outcome
    text = outcome.message()
    if outcome.complete:
        if outcome.residual > ROWS:
            yield f"rows disagree by {outcome.residual:.1e} m"
        interval = run.scheme.output_interval
        stored = round(run.panel.schedule.end / interval) + 1
        waits = sum(wait.longest for wait in schedule_waits(run.panel))  # for machines
        if not stored <= run.history.time.size <= stored + waits / interval + 1e-6:
            yield f"complete with {run.history.time.size} of {stored} instants"
        return
    wanted = {
        "time": f"t = {outcome.time:.4f} s",
        "step": f"step {outcome.step}",
        "residual": "residual",
        "remedy": ADVICE[outcome.code],
    }
    if outcome.code is not Code.INACCURATE:
        wanted["contacts"] = "unconverged: "
    yield from (f"message without {what}" for what, part in wanted.items() if part not in text)
    expected = outcome.step // run.scheme.stride + 1
    if run.history.time.size not in (0, expected):
        yield f"partial response has {run.history.time.size} of {expected} instants"


def _nan_faults(run: Run) -> Iterator[str]:
    without = [name for name, rail in run.panel.rail.items() if not rail.has_stock_rail]
    for name, variable in run.dataset.data_vars.items():
        values = variable.to_numpy()
        if values.dtype.kind != "f" or name in MAY_LACK:
            continue
        if np.isinf(values).any():
            yield f"{name} is infinite"
        if name == "end_gap" and not run.history.time.size:
            continue
        if name in OF_STOCK_RAIL and without:
            if "rail" not in variable.dims:
                continue
            values = variable.drop_sel(rail=without).to_numpy()
        if np.isnan(values).any():
            yield f"{name} has NaN"
    for name in ("g", "q", "law_force", "friction_force", "stored", "ledger"):
        if not np.isfinite(getattr(run.history, name)).all():
            yield f"history.{name} is not finite"


def _slack(run: Run, stiffness: np.ndarray) -> np.ndarray:
    """Return the force that the scheme's gap tolerance may hide on a law [N]."""
    return np.maximum(PULL, 1.1 * run.scheme.gap_tolerance * stiffness)


def _contact_faults(run: Run) -> Iterator[str]:
    table = run.mechanism.laws
    index = run.mechanism.index
    unilateral = [law for feet in index.chair.values() for law in feet]
    unilateral += [*index.stop.values(), *index.object.values()]
    allowed = _slack(run, _largest_slopes(table))
    least = run.history.law_force.min(axis=0)
    for law in unilateral:
        if least[law] < -allowed[law]:
            yield f"{run.mechanism.law_names[law]} pulls with {-least[law]:.1e} N"


def _friction_faults(run: Run) -> Iterator[str]:
    table, history = run.mechanism.laws, run.history
    if not table.friction_row.size:
        return
    normal = np.maximum(history.law_force[:, table.friction_normal], 0.0)
    hidden = table.friction_coefficient * _slack(run, _largest_slopes(table))[table.friction_normal]
    limit = table.friction_coefficient * normal * (1 + 1e-9) + np.maximum(PULL, hidden)
    excess = (np.abs(history.friction_force) - limit).max(axis=0)
    for friction in np.flatnonzero(excess > 0.0):
        name = run.mechanism.friction_names[friction]
        yield f"friction of {name} is {excess[friction]:.1e} N above its limit"


def _law_faults(run: Run) -> Iterator[str]:
    """Compare every force with its law at the displacement: gaps, penetrations, bushings."""
    table, history = run.mechanism.laws, run.history
    allowed = _slack(run, _largest_slopes(table))
    for law in range(table.row.size):
        e = history.g[:, table.row[law]] - table.offset[law]
        if table.input_index[law] >= 0:
            e = e - history.inputs[:, table.input_index[law]]
        first, last = table.segment_start[law], table.segment_start[law + 1]
        at = first + np.searchsorted(table.segment_upper[first : last - 1], e)
        acts = (history.law_placed[law] <= history.time + 1e-9) & (
            history.time <= table.disappears[law] + 1e-9
        )
        force = np.where(acts, table.slope[at] * e + table.intercept[at], 0.0)
        off = np.abs(force - history.law_force[:, law]).max()
        if off > allowed[law] + 1e-9 * np.abs(force).max():
            yield f"{run.mechanism.law_names[law]} is {off:.1e} N off its law"


def _largest_slopes(table: LawTable) -> np.ndarray:
    return np.maximum.reduceat(table.slope, table.segment_start[:-1])


def _book_faults(run: Run) -> Iterator[str]:
    scale = float(run.dataset.attrs["energy_scale"])
    allowed = BOOKS * max(scale, LEAST_SCALE)
    folded = folded_energy(run)
    allowed += min(1e-14 * folded, 1e-5) if run.history.outcome.complete else ROUNDING * folded
    residual = float(np.abs(run.dataset["energy_residual"]).max())
    if residual > allowed and run.history.outcome.code is not Code.INACCURATE:
        yield f"energy residual {residual:.1e} J, allowed are {allowed:.1e} J of {scale:.1e} J"
    lost = float(run.dataset["energy_friction"][-1])
    if lost < -allowed:
        yield f"friction gave {-lost:.1e} J"


def folded_energy(run: Run) -> float:
    """Return the largest energy in the linear system with the base segments of all laws [J]."""
    history, table = run.history, run.mechanism.laws
    modal = np.sum((history.q @ history.model.stiffness) * history.q, axis=1)
    rows = history.g[:, table.row] ** 2 @ base_stiffness(table)
    return float(0.5 * np.max(modal + rows))
