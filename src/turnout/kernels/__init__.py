"""Compiled kernels: compilation and its cache, interruption, eight numbers at a time."""
