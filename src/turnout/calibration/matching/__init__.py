"""History matching: panels whose throws meet stated facts, from ranges of what is not known."""
