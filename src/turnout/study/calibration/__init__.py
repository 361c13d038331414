"""Calibration: parameters, stages, misfit, fit, uncertainty, and the record that comes of them."""
