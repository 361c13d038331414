"""A self-contained page: findings first, then sections of tables and charts, and its script.

The plotting script that pages carry in themselves, from our own files. A self-contained page:
findings first, then sections of tables and charts.
"""

import base64
import json
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from html import escape
from importlib.resources import files

from turnout.figures.sheet import MOST_POINTS, Sheet, sheet_record
from turnout.metric.finding import HEADLINE, Finding

PLOTLY_VERSION = "4.1.1"
"""Of plotly.js, bundle "basic": lines, bars and pies."""

FEW_POINTS = 260
"""Points of a line among hundreds: bins of 20 ms over a movement."""


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
    vendored = files("turnout.figures.report").joinpath("vendor", "plotly-basic.min.js")
    return vendored.read_text(encoding="utf-8")


MEDIA = {".pdf": "application/pdf", ".png": "image/png", ".svg": "image/svg+xml"}
# The page loads nothing from elsewhere; its content security policy enforces that.
POLICY = (
    "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; "
    "img-src data: blob:; base-uri 'none'; form-action 'none'"
)


@dataclass(frozen=True, slots=True)
class Picture:
    """A figure of a page: its sheet, the same on paper as files by suffix, points of a line."""

    sheet: Sheet
    files: Mapping[str, bytes]
    most: int = MOST_POINTS


@dataclass(frozen=True, slots=True)
class Table:
    """A table: heading, names of columns, rows of texts, and numbers of rows to mark."""

    heading: str
    columns: Sequence[str]
    rows: Sequence[Sequence[str]]
    marked: frozenset[int] = frozenset()


@dataclass(frozen=True, slots=True)
class Heat:
    """A table of numbers coloured by size: NaN is an empty cell, framed ones are set off.

    Attributes
    ----------
    heading : str
        With the unit.
    rows, columns : sequence of str
        Names of both sides.
    values, framed : sequence of sequences
        By row and column.
    """

    heading: str
    rows: Sequence[str]
    columns: Sequence[str]
    values: Sequence[Sequence[float]]
    framed: Sequence[Sequence[bool]]


@dataclass(frozen=True, slots=True, kw_only=True)
class Section:
    """A part of a page under a heading.

    Attributes
    ----------
    heading : str
        Of the part.
    text : str
        Plain text below it.
    pictures, tables : sequence
        Its content, in this order.
    heats : sequence of Heat
        Coloured tables, before these.
    folded : bool
        Whether its pictures after the first are opened only by a click.
    """

    heading: str
    text: str = ""
    pictures: Sequence[Picture] = ()
    tables: Sequence[Table] = ()
    heats: Sequence[Heat] = ()
    folded: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class Page:
    """Content of a report page; the first finding is its headline."""

    title: str
    subtitle: str
    findings: Sequence[Finding]
    sections: Sequence[Section]
    synthetic: bool = False
    footer: Sequence[str] = field(default_factory=tuple)


def page_html(page: Page) -> str:
    """Return a page as one file that needs no other.

    Parameters
    ----------
    page : Page
        Its content.

    Returns
    -------
    str
        HTML with its styles, script and data inside.

    Examples
    --------
    >>> page = Page(title="A < B", subtitle="", findings=[], sections=[])
    >>> "<h1>A &lt; B</h1>" in page_html(page)
    True
    """
    body = [
        _head(page),
        _findings(page.findings),
        _links(page.sections),
        *(_section(number, section) for number, section in enumerate(page.sections)),
        f"<footer class='soft'>{'<br>'.join(map(escape, page.footer))}</footer>",
    ]
    charts = any(section.pictures for section in page.sections)
    scripts = f"<script>{plotly_script()}</script><script>{asset('charts.js')}</script>"
    return (
        "<!DOCTYPE html>\n<html lang='en'><head><meta charset='utf-8'>"
        f'<meta http-equiv="Content-Security-Policy" content="{POLICY}">'
        "<meta name='viewport' content='width=device-width, initial-scale=1'>"
        f"<title>{escape(page.title)}</title><style>{asset('page.css')}</style></head>\n<body>"
        + "\n".join(body)
        + (scripts if charts else "")
        + "</body></html>\n"
    )


@cache
def asset(name: str) -> str:
    """Return one of the texts that pages are made of."""
    return files("turnout.figures.report").joinpath("assets", name).read_text(encoding="utf-8")


def data_address(content: bytes, suffix: str) -> str:
    """Return a file as an address that holds it."""
    return f"data:{MEDIA[suffix]};base64,{base64.b64encode(content).decode('ascii')}"


def _head(page: Page) -> str:
    synthetic = "<p class='synthetic'>Synthetic: simulated, not measured</p>"
    return (
        f"<header><div><h1>{escape(page.title)}</h1>"
        f"<p class='soft'>{escape(page.subtitle)}</p></div>"
        f"{synthetic if page.synthetic else ''}</header>"
    )


def _findings(found: Sequence[Finding]) -> str:
    if not found:
        return ""
    first, *others = found
    asked = "" if first.question == HEADLINE else f"<span>{escape(first.question)}</span>"
    meaning = f"<p>{_words(first.meaning)}</p>" if first.meaning else ""
    cards = "".join(
        f"<li class='card {item.level}'><div class='question'>{escape(item.question)}</div>"
        f"<div class='answer'>{_words(item.answer)}</div>"
        f"<div class='detail'>{_words(item.detail)}</div></li>"
        for item in others
    )
    return (
        f"<div class='outcome {first.level}'>{asked}<strong>{escape(first.answer)}</strong>"
        f"{meaning}{_words(first.detail)}</div><ul class='cards'>{cards}</ul>"
    )


def _words(text: str) -> str:
    """Return a text in which no number is parted from its unit at the end of a line."""
    return re.sub(r"(?<=\d) (?=(?:mm|m|kN|s|%)\b|%)", "\u00a0", escape(text))


def _links(sections: Sequence[Section]) -> str:
    links = "".join(
        f"<a href='#part-{number}'>{escape(section.heading)}</a>"
        for number, section in enumerate(sections)
    )
    return f"<nav aria-label='Parts of this page'>{links}</nav>"


def _section(number: int, section: Section) -> str:
    parts = [f"<p>{escape(section.text)}</p>"] if section.text else []
    parts += [_heat(heat) for heat in section.heats]
    parts += [
        _picture(picture, folded=section.folded and number > 0)
        for number, picture in enumerate(section.pictures)
    ]
    parts += [_table(table) for table in section.tables]
    content = "".join(parts)
    return f"<section id='part-{number}'><h2>{escape(section.heading)}</h2>{content}</section>"


def _picture(picture: Picture, *, folded: bool) -> str:
    sheet = picture.sheet
    record = json.dumps(sheet_record(sheet, most=picture.most), separators=(",", ":")).replace(
        "</", "<\\/"
    )
    links = "".join(
        f"<a download='{escape(sheet.name)}{suffix}' href='{data_address(content, suffix)}'>"
        f"{suffix.removeprefix('.').upper()}</a>"
        for suffix, content in picture.files.items()
    )
    download = f"<span class='files'>Download: {links}</span>" if links else ""
    heading = "" if folded else f"<h3>{escape(sheet.title)}</h3>"
    figure = (
        f"<figure>{heading}"
        f"<div class='chart' id='{escape(sheet.name)}' role='img' "
        f"aria-label='{escape(sheet.title)}'>"
        f"<script type='application/json'>{record}</script></div>"
        f"<figcaption>{escape(sheet.caption)}</figcaption>{download}</figure>"
    )
    if not folded:
        return figure
    return f"<details><summary>{escape(sheet.title)}</summary>{figure}</details>"


def _table(table: Table) -> str:
    head = "".join(f"<th>{escape(name)}</th>" for name in table.columns)
    rows = "".join(
        f"<tr{' class=assumed' if number in table.marked else ''}>"
        + "".join(f"<td>{escape(text)}</td>" for text in row)
        + "</tr>"
        for number, row in enumerate(table.rows)
    )
    heading = f"<h3>{escape(table.heading)}</h3>" if table.heading else ""
    return (
        f"{heading}<div class='scroll'><table><thead><tr>{head}</tr></thead>"
        f"<tbody>{rows}</tbody></table></div>"
    )


def _heat(heat: Heat) -> str:
    known = [abs(value) for row in heat.values for value in row if math.isfinite(value)]
    top = max([1.0, *known])
    head = "".join(f"<th class='cell'>{escape(name)}</th>" for name in ("", *heat.columns))
    rows = "".join(
        f"<tr><th>{escape(name)}</th>"
        + "".join(_cell(value, top, frame) for value, frame in zip(values, framed, strict=True))
        + "</tr>"
        for name, values, framed in zip(heat.rows, heat.values, heat.framed, strict=True)
    )
    return (
        f"<h3>{escape(heat.heading)}</h3><div class='scroll'><table><thead><tr>{head}</tr></thead>"
        f"<tbody>{rows}</tbody></table></div>"
    )


def _cell(value: float, top: float, framed: bool) -> str:
    if not math.isfinite(value):
        return "<td class='cell'></td>"
    # Half transparent at most, so that the ink of either theme stays readable on it.
    share = 0.5 * min(1.0, abs(value) / top)
    kind = "cell slipped" if framed else "cell"
    tint = f"background:rgba(230,120,0,{share:.2f})"
    return f"<td class='{kind}' style='{tint}'>{value + 0.0:.2f}</td>"
