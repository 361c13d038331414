"""Sphinx settings; built with warnings as errors by .ci/run."""

from importlib.metadata import version as version_of

from docutils import nodes
from docutils.utils.math import MathError
from docutils.utils.math.latex2mathml import tex2mathml
from sphinx.application import Sphinx
from sphinx.util import logging
from sphinx.writers.html5 import HTML5Translator

project = "turnout"
author = "The turnout developers"
copyright = "2026, The turnout developers"
version = release = version_of("turnout")

extensions = [
    *("myst_nb", "sphinx.ext.autodoc", "sphinx.ext.autosummary", "sphinx.ext.napoleon"),
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
# Equations are MathML in the page: nothing to load, with or without a network.
html_math_renderer = "mathml"


def _render(translator: HTML5Translator, node: nodes.Element, *, block: bool) -> None:
    """Write an equation as MathML; one that docutils cannot read fails the build."""
    try:
        equation = tex2mathml(node.astext(), as_block=block)
    except MathError as error:
        logging.getLogger(__name__).warning("equation: %s", error, location=node)
        equation = translator.encode(node.astext())
    translator.body.append(f"<div>{equation}</div>\n" if block else equation)
    raise nodes.SkipNode


def setup(app: Sphinx) -> None:
    """Register the renderer of equations."""
    app.add_html_math_renderer(
        "mathml",
        inline_renderers=(lambda translator, node: _render(translator, node, block=False), None),
        block_renderers=(lambda translator, node: _render(translator, node, block=True), None),
    )
