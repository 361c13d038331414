"""Self-contained pages about runs, campaigns and studies, and the scripts that they carry."""
