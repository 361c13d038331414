"""Several runs for one question: checks, campaigns, sweeps, calibration."""
