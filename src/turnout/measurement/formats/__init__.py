"""Files of data acquisition systems: one reader per format, in its own process if needed."""
