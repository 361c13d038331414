"""Reduction of linear structures: matrices in, smaller matrices out; knows no rails."""
