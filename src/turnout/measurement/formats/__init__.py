"""Files of data acquisition systems: one reader a format, in a process of its own where needed."""
