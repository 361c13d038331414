"""Condense reduced rails to modes and residual flexibility, block by block."""
