"""What a switch panel is: records, library, loader, checks."""
