"""Write docs/verification.md: every figure on that page comes from the functions the tests call.

    python -m tests.verification.page

Run it after a change of the solver or of a library panel and read the difference.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import xarray as xr
from matplotlib.figure import Figure
from tests.verification.agreement import Check, sb1_checks, sb2_checks
from tests.verification.battery import RUNGS, Rung
from tests.verification.facts import ALL
from tests.verification.reference import Arrays, thinned
from tests.verification.runs import DEFAULT, books, throw

DOCS = Path(__file__).parents[2] / "docs"
BLUE, ORANGE, BLACK = "#0072B2", "#D55E00", "#000000"

HEAD = """# Verification

Trust is built from below, each rung with its own reference and tolerance. The tests of every rung
are in `tests/verification`; `python -m tests.verification.page` writes the tables on this page
from the functions that the tests call, on the thinned copies of the independent answers in
`tests/verification/data`.

| rung | reference | where |
|---|---|---|
| sections | closed forms, thin walls, EN values, orders | `test_section_*.py` |
| beam element, gravity, mass | closed forms, orders in the element length | `test_beam_*.py` |
| Craig-Bampton reduction | chain of masses, full model | `test_reduction_*.py` |
| friction | closed forms: block, loops, belt, friction bed | `test_friction_*.py` |
| contact, bushing, objects | closed forms: bounce, impact, blow | `test_laws_*`, `test_impact.py` |
| integration | equilibrium, books of energy, no creep | `test_integration_*.py` |
| the whole chain | orders 2 in element length and step | `test_orders.py` |
| [point machines](machine.md) | closed forms, independent program SB3 | `test_machine_*.py` |
| vibration, flutter | closed forms, full model, growth | `test_modes.py`, `test_flutter.py` |
| rails as matrices | the rails that they came from | `test_matrices_round_trip.py` |
| changing normal force, lift-off | independent fine-step program | `test_brute_force*.py` |
| whole panels | independent programs: SB1, SB2 | `test_benchmarks.py` |
| the paper | facts a to f | `test_paper_facts.py` |
| the paper | its campaign as a sweep: facts b, c, d | `test_sweep_campaign.py` (long) |
| books of energy | closed to rounding on every run | `test_benchmarks.py` and others |
| bits | the same whatever the workers | `test_robustness_determinism.py` |

The data variables of a run are the same to the last bit in one environment, in whatever process
and with however many workers. On another machine forces, gaps and displacements agree within 1e-7
of a channel's peak: `python -m tests.verification.other_machine` throws SB1, SB2 and the default
panel again with a compiler and a linear algebra library kept to the oldest instructions, and finds
1.3e-8 at most (the object's blow in SB2), 1e-10 for drive forces.
"""

BATTERY_TEXT = """## The battery: closed forms and orders

Each rung names its reference; derivations, references and tolerances are at the top of the files.
Books of energy are asserted to close to 1e-6 in every case.
"""

SB1_TEXT = """## SB1: one prismatic rail, against Exudyn (OpenSeesPy agrees with it)

Default scheme. The chair friction is not asked for by the benchmark: its difference sits in the
stick phases of a 5 Hz ripple and shrinks with the step.
"""

SB2_TEXT = """## SB2: the whole panel in 3-D, against an independent beam program

![Drive and object forces of SB2 beside the independent program](figures/verification_sb2.png)

The benchmark lays the beam axis straight through the centroids of the tapered rail
(`rail.axis = "centroid"`). The centroids of the real rail rise by 30 mm along the taper; lateral
shear on a rising axis twists the rail. With the nodes on the straight foot line and eccentric
sections (`axis = "foot"`, the default panel) the roll at the toe is 16 % larger and Drive 1 changes
by 0.3 %: the benchmark's simplification, not an error of either program.
"""

FACTS_TEXT = """## The paper's facts on the default panel

Facts a and c were used to choose dimensions that no source gives (a: free length, c: distance of
the drives), on an earlier, simpler model; b, d, e and f were not. What disagrees, and what was
open:

- **a.** The paper tells of about 26 mm left at Drive 2 with 81 kN/m. A full cycle leaves 23.4 mm,
  because the throw is then incomplete and friction in the heel part never reverses. No choice of
  free length, friction or section moves it; a rail that is stress-free elsewhere would.
- **e.** On planed sections both drives are proportional to friction, also Drive 1 alone, which on
  symmetric sections is off by the ripple that friction locks in. Four times slower it is so too.
- **f.** The smallest object that moves an end force by 50 N grows with friction. A third link
  half-way, at the object, changes that size by 1 mm at most, but a 13 mm object then changes Drive
  2 by half as much again: the published finding that more links help detection.
- **Figure 11 of the paper** tells of Drive 1 building up to saturation for 13 and 29 mm at the TKK.
  Here a midway object gives Drive 1 1.1 and 2.5 kN. The drive springs alone yield 8 mm at 6 kN, so
  that a midway object cannot saturate Drive 1; the model is not tuned towards it.

What each refinement of the panel is worth is told [apart](effects.md).
"""


def main() -> None:
    """Write the page and its figure."""
    (DOCS / "figures").mkdir(exist_ok=True)
    parts = [HEAD, BATTERY_TEXT, *(rung_part(rung) for rung in RUNGS), SB1_TEXT]
    for case, place in (("sb1_A", None), ("sb1_B", "x = 3.9 m")):
        ds = throw("sb1", place)
        parts += [f"### {case.replace('_', ', case ')}", table(sb1_checks(ds, thinned(case)))]
        parts.append(books_line(ds))
    parts.append(SB2_TEXT)
    for case, place in (("sb2_none", None), ("sb2_sleeper6_13mm", "sleeper 6")):
        ds, name = throw("sb2", place), "without object" if place is None else "13 mm at sleeper 6"
        parts += [f"### SB2, {name}", table(sb2_checks(ds, thinned(case))), books_line(ds)]
    sb2_figure(throw("sb2", "sleeper 6"), thinned("sb2_sleeper6_13mm")).savefig(
        DOCS / "figures" / "verification_sb2.png", dpi=150
    )
    parts += [FACTS_TEXT, table([check for fact in ALL for check in fact()])]
    parts.append(books_line(throw(DEFAULT, "sleeper 6")))
    (DOCS / "verification.md").write_text("\n".join(parts), encoding="utf-8")


def rung_part(rung: Rung) -> str:
    """Draw the figure of a rung; return its text and table."""
    image = f"figures/verification_{rung.name}.png"
    rung.figure().savefig(DOCS / image, dpi=130)
    return "\n".join(
        (
            f"### {rung.title}",
            "",
            f"Reference: {rung.reference}. Where: {rung.where}.",
            "",
            f"![{rung.title}]({image})",
            "",
            rung.caption,
            "",
            table(rung.checks()),
        )
    )


def table(checks: Sequence[Check]) -> str:
    """Return checks as a table."""
    rows = ["| figure | found | allowed | unit | |", "|---|---:|---:|---|---|"]
    for check in checks:
        allowed = f"{check.low:.4g} to {check.high:.4g}"
        mark = "" if check.passed else "**outside**"
        rows.append(f"| {check.what} | {check.value:.4g} | {allowed} | {check.unit} | {mark} |")
    return "\n".join(rows) + "\n"


def books_line(ds: xr.Dataset) -> str:
    """Return one sentence on the energy of a run."""
    residual, loss = books(ds)
    scale = ds.attrs["energy_scale"]
    return (
        f"Energy: scale {scale:.0f} J, residual {residual:.0e} of it, "
        f"numerical loss {100 * loss:.2g} %. Scheme: {ds.attrs['scheme']}.\n"
    )


def sb2_figure(ds: xr.Dataset, ref: Arrays) -> Figure:
    """Draw drive and object forces of a run over those of the independent program."""
    figure = Figure(figsize=(7.5, 5.0), layout="constrained")
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(3, 2))
    times = ds["time"].to_numpy()
    for drive, colour in (("1", BLUE), ("2", ORANGE)):
        force = ds["drive_force"].sel(drive=drive).to_numpy()
        upper.plot(times, 1e-3 * force, color=colour, label=f"Drive {drive}, turnout")
        upper.plot(
            ref["time"][::5],
            -1e-3 * ref[f"drive{drive}"][::5],
            ".",
            color=BLACK,
            markersize=2.5,
            label="independent program" if drive == "2" else None,
        )
    lower.plot(times, 1e-3 * ds["object_force"].to_numpy(), color=BLUE)
    lower.plot(ref["time"], 1e-3 * ref["object"], ".", color=BLACK, markersize=2.5)
    upper.set_ylabel("drive force [kN]")
    lower.set_ylabel("object force [kN]")
    lower.set_xlabel("time [s]")
    lower.set_xlim(0, float(times[-1]))
    lower.set_ylim(bottom=min(0.0, float(1e-3 * np.min(ref["object"]))) - 0.05)
    upper.legend(frameon=False, ncols=3, loc="lower center", bbox_to_anchor=(0.5, 1.0))
    for axes in (upper, lower):
        axes.grid(alpha=0.3)
        axes.spines[["top", "right"]].set_visible(False)
    return figure


if __name__ == "__main__":
    main()
