"""Studies: sets of throws drawn from grids, distributions and fields."""
