"""The two modes that are published together: quick alone would flatter."""

from turnout.integrate.scheme import Scheme

MODES = {
    "quick": Scheme(step=4e-3, cutoff_frequency=100.0),
    "waveform": Scheme(),
}
"""Drives, gaps and labels; and all that is heard of impacts and single chairs."""
