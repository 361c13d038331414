"""What turnout costs, measured by commands that write pages of the documentation."""
