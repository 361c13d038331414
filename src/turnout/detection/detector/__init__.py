"""The detector: training, a switch's history, the likelihood ratio, verdicts."""
