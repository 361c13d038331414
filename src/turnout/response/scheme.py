"""The numerical scheme of a run, for faces that do not know the integration behind it."""

from turnout.integrate.scheme import MODES, Scheme

__all__ = ["MODES", "Scheme"]
