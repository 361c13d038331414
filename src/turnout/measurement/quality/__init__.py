"""Whether a throw was recorded well enough to be used."""
