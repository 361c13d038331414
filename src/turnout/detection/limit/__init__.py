"""What can be seen of a foreign object at all: bound, known place, what-if, bands, day plan."""
