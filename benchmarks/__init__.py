"""Costs of turnout, measured by commands that write pages of the documentation."""
