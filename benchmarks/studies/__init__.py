"""Programs that measure at length or write pages of results; each says how in its head."""
