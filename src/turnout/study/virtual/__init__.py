"""Virtual campaigns: simulated throws as a data acquisition system would have recorded them."""
