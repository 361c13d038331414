"""A panel as mechanics: reduced rails, law table, names. Nothing here knows time."""
