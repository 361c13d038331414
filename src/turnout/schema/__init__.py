"""The table of channels that simulations and measurements share."""
