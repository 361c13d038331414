"""Tests, in folders that say why each exists; the marker is taken from the folder."""
