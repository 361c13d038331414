"""The measuring chain: from the columns of a recording to newtons and amperes."""
