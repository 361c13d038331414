"""Validation: what a calibrated model predicts of movements that it has not seen."""
