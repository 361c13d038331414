"""Reading and writing files: unit-bearing TOML, atomic writes, provenance, progress."""
