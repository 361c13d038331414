"""Static equilibrium and implicit time stepping of a mechanism: arrays in, arrays out."""
