"""Sweeps: all throws of a study, in processes or on a cluster, stored in batches."""
