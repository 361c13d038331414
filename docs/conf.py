"""Sphinx settings; built with warnings as errors by .ci/run."""

import sys
from importlib.metadata import version as version_of
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

project = "turnout"
author = "The turnout developers"
copyright = "2026, The turnout developers"
version = release = version_of("turnout")

extensions = [
    *("myst_nb", "sphinx.ext.autodoc", "sphinx.ext.autosummary", "sphinx.ext.napoleon"),
    "equations",
]
# The reference is read from the docstrings; types stand there in words.
autodoc_typehints = "none"
autodoc_member_order = "bysource"
autosummary_generate = False
napoleon_google_docstring = False
napoleon_use_ivar = True
napoleon_use_rtype = False
add_module_names = False
myst_enable_extensions = ["deflist", "dollarmath"]
myst_heading_anchors = 3
# Pages for contributors are read in the sources.
exclude_patterns = ["_build", "project"]
# The notebooks are run each time, and a cell that fails fails the build.
nb_execution_mode = "force"
nb_execution_raise_on_error = True
nb_execution_timeout = 600
nb_merge_streams = True
html_theme = "furo"
html_title = "turnout"
# Equations are MathML in the page: nothing to load (equations.py).
html_math_renderer = "mathml"
html_static_path = ["_static"]
html_css_files = ["equations.css"]
