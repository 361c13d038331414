"""The two modes that are published together: quick alone would flatter."""

from turnout.core.scheme import Scheme

MODES = {mode: Scheme.of(mode) for mode in ("quick", "waveform")}
"""Drives, gaps and labels; and all that is heard of impacts and single chairs."""
