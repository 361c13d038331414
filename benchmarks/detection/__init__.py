"""Open benchmark of foreign-object detection: throws, metrics, methods, tables."""
