"""Calibration: parameters, stages, residuals, fit, uncertainty, and the result."""
