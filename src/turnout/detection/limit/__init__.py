"""Limits of the detection of a foreign object: bound, known place, what-if, bands, day plan."""
