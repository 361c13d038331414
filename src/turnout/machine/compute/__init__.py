"""Compiled equations of a point machine: arrays in, arrays out."""
