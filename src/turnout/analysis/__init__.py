"""What a panel is like apart from one response: modes, stability, matrices, checks."""
