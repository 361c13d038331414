"""Point machines: DC motor, clutch, gear, stroke, circuit; and one machine on a one-mass rail."""
