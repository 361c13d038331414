"""Shared foundations: units, files, caches, problems in documents, progress."""
