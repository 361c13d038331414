"""Reduction of linear structures, matrices to smaller matrices, independent of rails."""
