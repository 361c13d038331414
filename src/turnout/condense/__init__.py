"""From reduced rails to modes and flexibility: blocks solved apart, dependent rows."""
