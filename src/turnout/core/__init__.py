"""What every part may use: units, files, caches, problems in documents, progress."""
