"""Features of datasets, whether simulated or measured."""
