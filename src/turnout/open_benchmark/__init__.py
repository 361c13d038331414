"""The open benchmark of foreign-object detection: throws, metrics, baselines, tables."""
