"""Lines and record of `turnout machine fit --three-phase`."""

import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

from turnout.cli.output import picked

if TYPE_CHECKING:
    from turnout.calibration.machine_estimates.current_fit import Estimate, NotIdentified
    from turnout.calibration.machine_estimates.three_phase import ThreePhaseFit

QUANTITIES = ("current", "per_volt", "per_watt", "resistance", "saturation", "loss", "rotor")
THREE_PHASE_UNITS = {
    **{"voltage": "V", "rated_voltage": "V", "power": "W", "current": "A", "per_volt": "A/V"},
    **{"per_watt": "A/W", "resistance": "ohm", "loss": "W", "leakage": "ohm"},
    **{"left_by_circuit": "A", "left_by_line": "A"},
}


def three_phase_record(fits: Sequence["ThreePhaseFit"]) -> dict[str, Any]:
    """Return the record that `turnout machine fit --three-phase --json` prints."""
    from turnout.calibration.machine_estimates.three_phase import NOT_SEPARATED

    machines = []
    for fit in fits:
        values = {name: getattr(fit, name) for name in QUANTITIES}
        unknown = {n: v for n, v in values.items() if hasattr(v, "reason")}
        reasons = {name: value.reason for name, value in unknown.items()}
        ranges = {n: [v.low, v.high] for n, v in unknown.items() if math.isfinite(v.low)}
        machines.append(
            picked(fit, "drive", "throws", "missing", "voltage", "power", "rated_voltage")
            | {name: None if name in reasons else value for name, value in values.items()}
            | {"not_identified": reasons, "ranges": ranges}
            | {"leakage": fit.leakage, "verdict": fit.verdict}
            | {"left_by_circuit": fit.left[0], "left_by_line": fit.left[1]}
        )
    return {"drives": [], "three_phase": machines, "not_separated": list(NOT_SEPARATED)}


def three_phase_lines(fits: Sequence["ThreePhaseFit"]) -> list[str]:
    """Return the lines that `turnout machine fit --three-phase` prints."""
    from turnout.calibration.machine_estimates.three_phase import NOT_SEPARATED

    lines: list[str] = []
    for fit in fits:
        if not fit.throws:
            lines.append(f"drive {fit.drive}: {fit.verdict}")
            continue
        without = f"; not recorded: {', '.join(fit.missing)}" if fit.missing else ""
        lines.append(f"drive {fit.drive} ({fit.throws} throws{without}), as the recorder sees it")
        lines += [f"  {name:<17}{text}" for name, text in _rows(fit)]
    return [*lines, "not separated", *(f"  {text}" for text in NOT_SEPARATED)]


def _rows(fit: "ThreePhaseFit") -> Iterator[tuple[str, str]]:
    point = [f"{fit.voltage:.1f} V"] if math.isfinite(fit.voltage) else []
    point += [f"{fit.power:.0f} W"] if math.isfinite(fit.power) else []
    yield "reference", " and ".join(point)
    load = f" and {fit.power:.0f} W" if math.isfinite(fit.power) else ", at the mean load"
    at = f"current at {fit.rated_voltage:g} V{load}"
    yield "current", _stated(fit.current, "A", 3, what=at)
    what = "over throws" if "P" in fit.missing else "over throws, same power"
    yield "per volt", _stated(fit.per_volt, "mA/V", 1, scale=1e3, what=what)
    what = "within throws, same voltage"
    yield "per 100 W", _stated(fit.per_watt, "mA", 1, scale=1e5, what=what)
    yield "line + stator", _stated(fit.resistance, "ohm", 2, what="of a phase, as warm as it was")
    what = "d ln i/d ln psi of the main branch, Gamma circuit"
    yield "saturation", _stated(fit.saturation, "", 2, what=what)
    yield "iron + friction", _stated(fit.loss, "W", 0, what="with the rod off")
    if fit.leakage is not None:
        yield (
            "leakage",
            f"{fit.leakage.value:.1f} ohm ± {fit.leakage.deviation:.1f} allowed for, by "
            f"{f'{fit.leakage.count} inrushes' if fit.leakage.count > 1 else 'assumption'}",
        )
    yield "rotor", _stated(fit.rotor, "ohm", 1, what="")
    yield "verdict", fit.verdict


def _stated(
    value: "Estimate | NotIdentified", unit: str, digits: int, *, scale: float = 1.0, what: str
) -> str:
    """Return value and 95 % interval, or why there is none."""
    if hasattr(value, "reason"):
        low, high = (f"{scale * v:.{digits}f}" for v in (value.low, value.high))
        known = f"somewhere from {low} to {high} {unit}".rstrip() + "; "
        return f"not identified: {known if math.isfinite(value.low) else ''}{value.reason}"
    shown = [f"{scale * v:.{digits}f}" for v in (value.value, value.low, value.high)]
    return f"{shown[0]}{f' {unit}' if unit else ''} [{shown[1]}, {shown[2]}], {what}"
