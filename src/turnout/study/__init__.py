"""Studies: which throws to make, drawn from grids, distributions and fields."""
