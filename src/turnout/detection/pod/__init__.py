"""Probability of detection from throws with known objects: regression, a90/95, ROC."""
