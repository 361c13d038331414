"""The plotting script that pages carry in themselves, from our own files."""

from functools import cache
from importlib.resources import files

PLOTLY_VERSION = "4.1.1"
"""Of plotly.js, bundle "basic": lines, bars and pies."""


@cache
def plotly_script() -> str:
    """Return plotly.js (bundle "basic") as a text that may stand in a page's ``<script>``.

    It is MIT-licensed; licence, origin and what was changed are beside it in ``vendor``.

    Returns
    -------
    str
        Defines ``Plotly``; holds neither ``</script`` nor a web address.

    Examples
    --------
    >>> PLOTLY_VERSION in plotly_script()[:80]
    True
    """
    vendored = files("turnout.report").joinpath("vendor", "plotly-basic.min.js")
    return vendored.read_text(encoding="utf-8")
