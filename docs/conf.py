"""Sphinx settings; built with warnings as errors by .ci/run."""

from importlib.metadata import version as version_of

project = "turnout"
author = "The turnout developers"
copyright = "2026, The turnout developers"
version = release = version_of("turnout")

extensions = ["myst_parser"]
myst_enable_extensions = ["deflist", "dollarmath"]
myst_heading_anchors = 3
exclude_patterns = ["_build"]
html_theme = "furo"
html_title = "turnout"
