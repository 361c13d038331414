"""Equations of the documentation as MathML, which browsers show without scripts or a network.

docutils converts TeX. What it writes differently from TeX is mended here: bold letters, subscripts
of accented letters, the height of bars, and the space beside names such as "ln".
"""

import html
import re
import xml.etree.ElementTree as ET

from docutils import nodes
from docutils.utils.math import MathError
from docutils.utils.math.latex2mathml import tex2mathml
from sphinx.application import Sphinx
from sphinx.util import logging
from sphinx.writers.html5 import HTML5Translator

NAMESPACE = "http://www.w3.org/1998/Math/MathML"
APPLY = "\u2061"
"""Between a function and its argument; browsers give it no width."""

BOLD = re.compile(r"\\boldsymbol\s*(?:\\?[A-Za-z]+|\{[^{}]*\})")
"""docutils would make all that follows bold."""

UNBRACED = re.compile(r"\\[td]?frac\s*\d")
"""docutils reads the digits of `\\frac12` as one number."""


def mathml(equation: str, *, block: bool) -> str:
    r"""Return an equation as MathML.

    Examples
    --------
    >>> mathml(r"\dot u_C", block=False).count("<msub><mover><mi>u</mi>")
    1
    """
    if UNBRACED.search(equation):
        message = f"write the arguments of fractions in braces: {equation}"
        raise MathError(message)
    text = tex2mathml(BOLD.sub(r"{\g<0>}", equation), as_block=block)
    text = re.sub(r"&(?!lt|gt|amp)\w+;", lambda found: html.unescape(found[0]), text)
    root = ET.fromstring(re.sub(r">\s+<", "><", text.replace(f' xmlns="{NAMESPACE}"', "")))
    for element in root.iter():
        _unstack_accent(element)
        _fix_bar(element)
    for element in list(root.iter()):
        _space_words(element)
    return ET.tostring(root, encoding="unicode")


def _unstack_accent(element: ET.Element) -> None:
    """Move the subscript of an accented letter from below it to its side."""
    inner = element[0] if element.tag == "msup" else element
    if inner.tag != "munderover" or inner[2].get("stretchy") != "false":
        return
    letter, subscript, accent = inner
    accented = ET.Element("mover")
    accented.extend((letter, accent))
    superscript = list(element)[1:] if element.tag == "msup" else []
    element.tag = "msubsup" if superscript else "msub"
    element[:] = [accented, subscript, *superscript]


def _fix_bar(element: ET.Element) -> None:
    """Keep a bar whose size is not stated as high as its line, close to what it encloses."""
    if element.tag == "mo" and element.text in ("|", "‖") and "minsize" not in element.attrib:
        element.set("stretchy", "false")
        element.set("form", "prefix" if element.get("class") == "mathopen" else "postfix")


def _is_word(element: ET.Element) -> bool:
    base = element[0] if element.tag in ("msub", "msup", "msubsup") else element
    return base.tag == "mi" and len(base.text or "") > 1 and (base.text or "").isalpha()


def _space_words(element: ET.Element) -> None:
    """Put a thin space between the name of a function and a letter or number beside it."""
    if element.tag not in ("math", "mrow", "mtd", "mstyle", "msqrt"):
        return
    spaced: list[ET.Element] = []
    for child in element:
        if child.text == APPLY:
            continue
        beside = spaced and "mo" not in (child.tag, spaced[-1].tag)
        if beside and (_is_word(child) or _is_word(spaced[-1])):
            spaced.append(ET.Element("mspace", {"width": "0.1667em"}))
        spaced.append(child)
    element[:] = spaced


def _write(translator: HTML5Translator, node: nodes.Element, *, block: bool) -> None:
    """Write an equation into a page; one that cannot be read fails the build."""
    try:
        equation = mathml(node.astext(), block=block)
    except MathError as error:
        logging.getLogger(__name__).warning("equation: %s", error, location=node)
        equation = translator.encode(node.astext())
    translator.body.append(f'<div class="math">{equation}</div>\n' if block else equation)
    raise nodes.SkipNode


def setup(app: Sphinx) -> None:
    """Register the renderer."""
    app.add_html_math_renderer(
        "mathml",
        inline_renderers=(lambda translator, node: _write(translator, node, block=False), None),
        block_renderers=(lambda translator, node: _write(translator, node, block=True), None),
    )
