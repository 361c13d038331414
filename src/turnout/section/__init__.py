"""Cross-sections: from an outline to the numbers that a beam needs, along the rail."""
