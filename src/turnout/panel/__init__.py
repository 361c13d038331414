"""Switch panels: records, library, loader, checks."""
