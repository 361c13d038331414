"""Scalar laws as data: one piecewise-linear table, friction rows that name their normal law."""
