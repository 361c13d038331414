"""Slopes of the library machines' currents with load and voltage, beside machines on record.

    python -m benchmarks.studies.current_or_power

Writes a section of docs/evidence/machines.md and docs/figures/current_or_power.png; closed forms,
at a quarter of the force at which the clutch slips.
"""

from collections.abc import Iterator
from typing import NamedTuple

from matplotlib.figure import Figure

from benchmarks.page import DOCS, EVIDENCE, put_section
from turnout.figures.style import COLOURS, new_figure, rendered
from turnout.machine.machine_file import load_machines, machine_names
from turnout.machine.motor_kind import line_resistance
from turnout.machine.steady import clutch_force, supply_slopes

PER_100_WATT, PER_VOLT = (-97.0, -47.0), (23.0, 28.0)
"""Of six three-phase machines, 1,010 throws (SwitchMonitor, linhuanwen) [mA]."""


class Slopes(NamedTuple):
    """Point and slopes of a library machine, in mA per 100 W and per volt."""

    name: str
    kind: str
    resistance: float
    current: float
    power: float
    per_100_watt: float
    per_volt: float

    @property
    def worth(self) -> float:
        """What 100 W of load are worth in volts of supply."""
        return abs(self.per_100_watt / self.per_volt)


def library_slopes() -> Iterator[Slopes]:
    """Yield the slopes of each machine of the library."""
    for file in machine_names():
        for name, machine in load_machines(file).machine.items():
            point, per_volt, per_watt = supply_slopes(machine, force=0.25 * clutch_force(machine))
            yield Slopes(
                name,
                "three-phase" if machine.motor.of_kind.alternating else "DC",
                line_resistance(machine.supply) + machine.motor.resistance,
                point.current,
                point.power,
                1e5 * per_watt,
                1e3 * per_volt,
            )


def section(found: list[Slopes]) -> list[str]:
    """Return the part of the page that this program writes."""
    lines = [
        "At a quarter of the force at which the clutch slips, closed form; written by "
        "`python -m benchmarks.studies.current_or_power`. On record are six three-phase machines "
        "in 1,010 throws (SwitchMonitor, linhuanwen).",
        "",
        "![Slopes of the currents with load and voltage](../figures/current_or_power.png)",
        "",
        "| machine | motor | R with line | current | power | per 100 W | per volt "
        "| 100 W are worth |",
        "|---|---|--:|--:|--:|--:|--:|--:|",
        "| on record | three-phase | 12 to 16 ohm | 2.26 to 2.52 A | 310 to 455 W | -97 to -47 mA "
        "| 23 to 28 mA | 2 to 4 V |",
    ]
    lines += [
        f"| `{s.name}` | {s.kind} | {s.resistance:.1f} ohm | {s.current:.2f} A | {s.power:.0f} W "
        f"| {s.per_100_watt:+.0f} mA | {s.per_volt:+.1f} mA | {s.worth:.1f} V |"
        for s in found
    ]
    return lines


def draw(found: list[Slopes]) -> Figure:
    """Draw both slopes of each machine beside the range on record, which is of three phases."""
    figure, axes = new_figure(2)
    kinds = {"three-phase": ("o", COLOURS[0]), "DC": ("s", COLOURS[1])}
    rows = (("mA per 100 W\nof load", PER_100_WATT), ("mA per volt\nof supply", PER_VOLT))
    for ax, (label, span) in zip(axes, rows, strict=True):
        ax.axhspan(*span, color="0.85", label="three-phase machines on record")
        ax.axhline(0.0, color="0.5", linewidth=0.6)
        for kind, (marker, colour) in kinds.items():
            own = [s for s in found if s.kind == kind]
            values = [s.per_100_watt if ax is axes[0] else s.per_volt for s in own]
            style = {"linestyle": "", "color": colour, "label": f"library, {kind}"}
            ax.plot([s.name for s in own], values, marker, **style)
        ax.set_ylabel(label)
        ax.margins(x=0.05, y=0.2)
    axes[0].set_yscale("symlog", linthresh=100.0)
    ticks = (-100, -50, 0, 50, 100, 500, 1000)
    axes[0].set_yticks(ticks, [f"{tick:+d}" if tick else "0" for tick in ticks])
    axes[0].set_ylim(-150.0, 1500.0)
    axes[0].set_title(
        "Current or power? With load a current of three phases falls, a direct one rises"
    )
    axes[1].legend(loc="lower left", frameon=False, fontsize=8)
    return figure


def main() -> None:
    """Write table and figure."""
    found = list(library_slopes())
    put_section(
        EVIDENCE / "machines.md",
        name="current-or-power",
        heading="Current or power",
        lines=section(found),
    )
    (DOCS / "figures" / "current_or_power.png").write_bytes(rendered(draw(found), ".png"))


if __name__ == "__main__":
    import argparse

    argparse.ArgumentParser(description=__doc__).parse_args()
    main()
