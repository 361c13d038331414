"""A truth that is not the model's own: the same switch, solved more finely and otherwise."""

from dataclasses import replace

from turnout.panel.load import LoadedPanel
from turnout.response.scheme import Scheme

# What a finer truth changes; a fit that finds its parameters again does not profit from sharing
# the errors of mesh, modes and steps with what it is fitted to.
MESH, MODES, STEPS = 0.5, 2.0, 0.25
SPECTRAL_RADIUS = 0.8


def finer_panel(panel: LoadedPanel) -> LoadedPanel:
    """Return a panel with elements half as long and superelement modes up to twice the frequency.

    Examples
    --------
    >>> from turnout.panel.load import load_panel
    >>> finer_panel(load_panel("sb1")).discretisation.element_length
    0.05
    """
    mesh = panel.discretisation
    return panel.with_overrides(
        {
            "discretisation.element_length": MESH * mesh.element_length,
            "discretisation.superelement_cutoff": MODES * mesh.superelement_cutoff,
        }
    )


def finer_scheme(scheme: Scheme | None = None) -> Scheme:
    """Return a scheme with steps of a quarter, modes to twice the frequency and other damping.

    Parameters
    ----------
    scheme : Scheme, optional
        What it is finer than; default the default.

    Examples
    --------
    >>> finer_scheme().describe()
    'generalised-alpha, spectral radius 0.8, step 0.25 ms, cut-off 600 Hz'
    """
    base = scheme or Scheme()
    return replace(
        base,
        step=STEPS * base.step,
        cutoff_frequency=MODES * base.cutoff_frequency,
        spectral_radius=SPECTRAL_RADIUS,
        output_interval=0.0,
    )
