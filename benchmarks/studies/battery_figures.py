"""Figures of the battery: results of turnout as lines, closed forms as dots."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.signal import hilbert
from tests.verification import (
    friction_bed,
    friction_block,
    impact,
    orders,
    stick_slip,
    two_rails,
)
from tests.verification import test_beam_dynamics as dynamics
from tests.verification import test_beam_statics as statics
from tests.verification import test_laws_bushing as bushing
from tests.verification import test_laws_contact as contact
from tests.verification.beams_by_hand import Floats
from tests.verification.flutter import (
    CRITICAL,
    WINDOW,
    exact_eigenvalues,
    mass_eigenvalues,
    predicted,
    slide,
)

BLUE, ORANGE, GREEN, BLACK = "#0072B2", "#D55E00", "#009E73", "#000000"
DASHED = (0, (5, 1.5))


def new_figure(columns: int, *, rows: int = 1) -> tuple[Figure, list[Axes]]:
    """Return a figure of small axes in a row or several."""
    figure = Figure(figsize=(8.4, 2.7 * rows), layout="constrained")
    axes = list(np.ravel(figure.subplots(rows, columns)))
    for ax in axes:
        ax.grid(color="0.88", linewidth=0.6)
        ax.set_axisbelow(True)
        ax.spines[["top", "right"]].set_visible(False)
        ax.tick_params(labelsize=8)
    return figure, axes


def labelled(ax: Axes, title: str, x: str, y: str, *, legend: str = "") -> None:
    """Name axes, with a legend at a place of choice."""
    ax.set_title(title, fontsize=9)
    ax.set_xlabel(x, fontsize=8)
    ax.set_ylabel(y, fontsize=8)
    if legend:
        ax.legend(fontsize=7, frameon=False, loc=legend)


def compared(
    ax: Axes, x: Floats, found: Floats, exact: Floats, *, colour: str = BLUE, dots: int = 24
) -> None:
    """Draw a line over dots that are spread evenly over the samples."""
    some = np.unique(np.linspace(0, x.size - 1, dots).astype(int))
    ax.plot(x, found, color=colour, linewidth=1.3)
    ax.plot(x[some], exact[some], "o", color=BLACK, markersize=2.6, zorder=3)


def slope(ax: Axes, x: Floats, y: float, order: float) -> None:
    """Draw the slope of an order, through `y` at the first place."""
    x = np.asarray(x, dtype=float)
    line = y * (x / x[0]) ** order
    ax.plot(x, line, color="0.6", linewidth=0.9, linestyle="--", zorder=1)
    ax.annotate(
        f"order {abs(order):g}",
        (x[1], line[1]),
        fontsize=7,
        color="0.35",
        ha="right" if order < 0 else "left",
        va="top",
        xytext=(-6 if order < 0 else 6, -4),
        textcoords="offset points",
    )


def plain_ticks(ax: Axes, places: Floats, form: str = "g") -> None:
    """Label a logarithmic axis at the samples."""
    ax.set_xscale("log")
    ax.set_yscale("log")
    ax.set_xticks(places, [format(place, form) for place in places])
    ax.minorticks_off()


def beams() -> Figure:
    """Draw errors of frequencies and of compliances over the number of elements."""
    figure, (left, middle, right) = new_figure(3)
    counts = np.array([3, 6, 12])
    slender = np.array([dynamics.slender_errors(n) for n in counts])
    for mode, (colour, mark) in enumerate(((BLUE, "o"), (ORANGE, "s"))):
        left.plot(counts, slender[:, mode], mark + "-", color=colour, label=f"mode {mode + 1}")
    plain_ticks(left, counts)
    slope(left, counts, 0.4 * slender[0, 0], -4)
    labelled(left, "slender cantilever", "elements", "frequency error [-]", legend="upper right")
    counts = np.array([16, 32, 64])
    pinned = np.array([dynamics.pinned_errors(n) for n in counts])
    for mode, (colour, mark) in enumerate(((BLUE, "o"), (ORANGE, "s"), (GREEN, "^")), 1):
        errors = pinned[:, mode - 1]
        middle.plot(counts, errors, mark + "-", color=colour, label=f"mode {mode}")
        if mode == 1:
            slope(middle, counts, 0.5 * errors[0], -2)
    plain_ticks(middle, counts)
    labelled(middle, "stout pinned beam", "elements", "frequency error [-]", legend="upper right")
    errors = [statics.TestTaper().error(n) for n in counts]
    right.plot(counts, errors, "o-", color=BLUE)
    plain_ticks(right, counts)
    slope(right, counts, 0.5 * errors[0], -2)
    right.set_ylim(1e-5, 1e-3)
    labelled(right, "taper, 36 compliances", "elements", "largest error [-]")
    return figure


def friction() -> Figure:
    """Draw force over displacement or time for the four cases of the block."""
    figure, axes = new_figure(2, rows=2)
    away, loops = friction_block.broken_away(), friction_block.masing()
    compared(axes[0], 1e3 * away.at, away.found, away.exact)
    labelled(axes[0], "stick, breakaway, slip", "marker [mm]", "drive force [N]")
    compared(axes[1], 1e3 * loops.at, loops.found, loops.exact, dots=60)
    labelled(axes[1], "Masing loops", "displacement of the block [mm]", "friction force [N]")
    changing, falling = friction_block.changing_normal(), friction_block.let_go()
    compared(axes[2], changing.at, changing.found, changing.exact, dots=40)
    labelled(axes[2], "slip under a changing normal force", "time [s]", "drive force [N]")
    compared(axes[3], falling.at, falling.found, falling.exact)
    labelled(axes[3], "the normal force falls under a held push", "time [s]", "drive force [N]")
    axes[2].set_ylim(bottom=0)
    axes[3].set_ylim(bottom=0)
    return figure


def stick_slip_paths() -> Figure:
    """Draw displacements of the oscillator with soft and stiff foot and of the block on a belt."""
    figure, axes = new_figure(3)
    for ax, stick in zip(axes, (2e4, 2e5), strict=False):
        path = stick_slip.released(stick, steps=100)
        compared(ax, path.time, 1e3 * path.found, 1e3 * path.exact, dots=50)
        title = f"released, foot of {stick / 1e3:g} kN/m"
        labelled(ax, title, "time [s]", "displacement [mm]")
    path = stick_slip.on_a_belt(steps=100)
    compared(axes[2], path.time, 1e3 * path.found, 1e3 * path.exact, dots=60)
    labelled(axes[2], "block on a belt", "time [s]", "displacement [mm]")
    return figure


def bed() -> Figure:
    """Draw slip length, shape and errors of the rail on a friction bed."""
    figure, (left, middle, right) = new_figure(3)
    coarse, fine = (friction_bed.dragged(friction_bed.SPACINGS[k]) for k in (0, -1))
    force = np.linspace(0, fine.force[-1], 200)
    scale = friction_bed.STRENGTH / friction_bed.BETA
    left.plot(
        force / scale,
        friction_bed.slip_length(force),
        color="0.3",
        linewidth=1.0,
        label="closed form",
    )
    for found, colour, mark, spacing in (
        (coarse, ORANGE, "s", friction_bed.SPACINGS[0]),
        (fine, BLUE, "o", friction_bed.SPACINGS[-1]),
    ):
        some = slice(0, None, max(1, found.force.size // 24))
        left.plot(
            found.force[some] / scale,
            found.slip_length[some],
            mark,
            color=colour,
            markersize=3,
            label=f"chairs every {spacing:g} m",
        )
    labelled(left, "slip length", r"push $P \beta / q$ [-]", "slip length [m]", legend="upper left")
    x = np.linspace(0.0, 9.0, 400)
    exact = friction_bed.shape(fine.force[-1], x) / friction_bed.YIELD
    near = fine.x < 9.0
    middle.plot(x, exact, color="0.3", linewidth=1.0)
    middle.plot(
        fine.x[near], fine.shape[near] / friction_bed.YIELD, "o", color=BLUE, markersize=2.4
    )
    middle.axhline(-1.0, color="0.6", linewidth=0.8, linestyle="--")
    middle.axhline(1.0, color="0.6", linewidth=0.8, linestyle="--")
    middle.set_yscale("symlog", linthresh=2.0)
    middle.set_yticks([-1, 0, 1, 10, 50], ["-1", "0", "1", "10", "50"])
    middle.set_ylim(-2.2, 120)
    labelled(middle, "shape at the last push", "x [m]", "displacement [q / k]")
    spacings = np.array(friction_bed.SPACINGS)
    errors = np.array([friction_bed.errors(spacing) for spacing in spacings])
    right.plot(spacings, errors[:, 0], "o-", color=BLUE, label="slip length")
    right.plot(spacings, errors[:, 1], "s-", color=ORANGE, label="pushed end")
    plain_ticks(right, spacings)
    slope(right, spacings, 0.6 * errors[0, 1], 2)
    labelled(
        right, "convergence", "spacing of the chairs [m]", "relative error [-]", legend="upper left"
    )
    return figure


def laws() -> Figure:
    """Draw the bushing's curve and the first contact of a dropped mass."""
    figure, (left, right) = new_figure(2)
    history = bushing.held_mass(0.08, cycles=False)
    marker = history.inputs[:, 0]
    compared(
        left, 1e3 * marker, -1e-3 * history.law_force[:, 0], 1e-3 * bushing.static_force(marker)
    )
    labelled(left, "bilinear bushing", "marker [mm]", "drive force [kN]")
    fall = contact.dropped(0.05, step=2e-5, end=0.15, spectral_radius=1.0)
    height = 0.05 - contact.MASS * contact.GRAVITY / 1e6
    speed = np.sqrt(2 * contact.GRAVITY * height)
    touch = np.sqrt(2 * height / contact.GRAVITY)
    rest = contact.GRAVITY / contact.OMEGA**2
    phase = contact.OMEGA * (fall.time - touch)
    sunk = rest * (1 - np.cos(phase)) + speed / contact.OMEGA * np.sin(phase)
    near = np.abs(phase - 1.5) < 3.0
    exact = contact.CONTACT * np.where(phase > 0, np.maximum(sunk, 0.0), 0.0)
    compared(right, 1e3 * fall.time[near], 1e-3 * fall.law_force[near, 1], 1e-3 * exact[near])
    labelled(right, "first contact of a dropped mass", "time [ms]", "contact force [kN]")
    return figure


def impacts() -> Figure:
    """Draw forces on the stop and the deviation of restitution from 1."""
    figure, (left, middle, right) = new_figure(3)
    mode, rod = impact.single_mode(), impact.rod().impact
    near = np.abs(mode.time - 0.5) < 0.8
    compared(left, mode.time[near], 1e-3 * mode.force[near], 1e-3 * mode.exact[near])
    labelled(left, "swinging cantilever", "time / contact time [-]", "force on the stop [kN]")
    near = (rod.time > -1e-3) & (rod.time < 8e-3)
    compared(middle, 1e3 * rod.time[near], 1e-3 * rod.force[near], 1e-3 * rod.exact[near])
    labelled(middle, "rod", "time from touch [ms]", "force on the stop [kN]")
    counts = np.array(impact.DIVISIONS)
    right.plot(counts, impact.restitution_errors(), "o-", color=BLUE, label="default scheme")
    lossless = [np.sqrt(np.mean(impact.lost_restitution(n, 1.0) ** 2)) for n in counts]
    right.plot(counts, lossless, "s", color=ORANGE, label="spectral radius 1")
    right.plot(
        counts,
        [impact.scatter(n) for n in counts],
        color="0.3",
        linewidth=1.0,
        label="its closed form",
    )
    plain_ticks(right, counts)
    labelled(right, "restitution", "steps a contact", "rms of 1 - e [-]", legend="lower left")
    return figure


def between() -> Figure:
    """Draw forces of an object between two rails, and the blow that it passes on."""
    figure, (left, middle, right) = new_figure(3)
    static, hit = two_rails.clamped(), two_rails.blow()
    marker = 1e3 * static.marker
    compared(left, marker, 1e-3 * static.drive, 1e-3 * static.exact_drive)
    compared(left, marker, 1e-3 * static.object, 1e-3 * static.exact_object, colour=ORANGE)
    for name, colour in (("drive", BLUE), ("object", ORANGE)):
        left.plot([], [], color=colour, label=name)
    labelled(left, "clamped", "marker [mm]", "force [kN]", legend="upper left")
    near = (hit.time > -0.5) & (hit.time < 1.5)
    compared(
        middle, hit.time[near], 1e-3 * hit.force[near], 1e-3 * hit.exact_force[near], colour=ORANGE
    )
    labelled(middle, "blow: object", "time / contact time [-]", "force [kN]")
    for rail, (colour, name) in enumerate(((BLUE, "first rail"), (GREEN, "second rail"))):
        compared(
            right,
            hit.time,
            1e3 * hit.tips[:, rail],
            1e3 * hit.exact_tips[:, rail],
            colour=colour,
            dots=30,
        )
        right.plot([], [], color=colour, label=name)
    labelled(right, "blow: rails", "time / contact time [-]", "tip [mm]", legend="lower right")
    return figure


def chain() -> Figure:
    """Draw errors of the chain over element length and step."""
    figure, (left, right) = new_figure(2)
    lengths = np.array(orders.ELEMENT_LENGTHS)
    for factor, colour, mark in ((orders.SOFT_IN_SHEAR, BLUE, "o"), (orders.SHEAR, ORANGE, "s")):
        errors = np.array([orders.frequency_errors(length, factor) for length in lengths])
        label = f"shear factor {factor:g}"
        left.plot(lengths, errors[:, 0], mark + "-", color=colour, label=f"{label}, mode 1")
        left.plot(
            lengths,
            errors[:, -1],
            mark + "--",
            color=colour,
            label=f"mode {orders.MODES}",
            markerfacecolor="white",
        )
        if factor == orders.SOFT_IN_SHEAR:
            slope(left, lengths, 0.5 * errors[0, 0], 2)
    plain_ticks(left, lengths)
    left.set_ylim(1e-8, 1e-1)
    labelled(
        left,
        "element length",
        "element length [m]",
        "frequency error [-]",
        legend="upper left",
    )
    steps = 1e3 * np.array(orders.STEPS)
    for radius, colour, mark in zip(orders.RADII, (BLUE, ORANGE), "os", strict=True):
        errors = np.abs([orders.force_error(step, radius) for step in orders.STEPS])
        right.plot(steps, errors, mark + "-", color=colour, label=f"spectral radius {radius:g}")
    plain_ticks(right, steps)
    right.set_ylim(1e-3, 1.0)
    slope(right, steps, 0.5 * errors[0], 2)
    labelled(right, "step", "step [ms]", "error of the force of Drive 2 [N]", legend="upper left")
    return figure


def flutter() -> Figure:
    """Draw the mass on its plate and the panel."""
    figure, (mass, panel) = new_figure(2)
    share = np.linspace(0.0, 2.0, 161)
    mass.plot(share, [mass_eigenvalues(s * CRITICAL).real.max() for s in share], color=BLUE)
    dots = np.linspace(0.0, 2.0, 21)
    mass.plot(
        dots,
        [exact_eigenvalues(s * CRITICAL).real.max() for s in dots],
        "o",
        color="black",
        markersize=3,
    )
    labelled(mass, "Mass on a plate", "friction over its critical value", "growth rate [1/s]")
    for dashpot, colour, label in (
        ("0 N s/m", ORANGE, "no dashpots"),
        ("3.75 kN s/m", BLUE, "dashpots"),
    ):
        run = slide(dashpot)
        envelope = np.sqrt(np.sum(np.abs(hilbert(run.band(), axis=0)) ** 2, axis=1))
        shown = (run.history.time > 0.6) & (run.history.time < 1.48)
        panel.semilogy(run.history.time[shown], envelope[shown], color=colour, label=label)
    envelope = np.sqrt(np.sum(np.abs(hilbert(slide("0 N s/m").band(), axis=0)) ** 2, axis=1))
    time = slide("0 N s/m").history.time
    first = envelope[np.searchsorted(time, WINDOW[0])]
    line = np.array(WINDOW)
    panel.plot(
        line,
        first * np.exp(predicted()[1] * (line - line[0])),
        "k--",
        linewidth=2,
        label="complex modes",
    )
    labelled(panel, "Panel, 85-110 Hz", "time [s]", "chair forces [N]", legend="upper left")
    return figure
