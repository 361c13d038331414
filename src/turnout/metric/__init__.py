"""Features of simulated and measured datasets."""
