"""The figure of flutter: growth over friction, and a vibration that grows and one that does not."""

import numpy as np
from matplotlib.figure import Figure
from scipy.signal import hilbert
from tests.verification.flutter import (
    CRITICAL,
    WINDOW,
    exact_eigenvalues,
    mass_eigenvalues,
    predicted,
    slide,
)

from benchmarks.studies.battery_figures import BLUE, ORANGE, labelled, new_figure


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
