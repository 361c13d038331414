"""From a history of reduced coordinates to a dataset in the terms of the schema."""
