"""The numerical scheme of a run, for faces that do not know the integration behind it."""

from turnout.integrate.scheme import MODES, Mode, Scheme, chosen_scheme

__all__ = ["MODES", "Mode", "Scheme", "chosen_scheme"]
