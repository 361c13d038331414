"""A page of the documentation that several commands write, one section each."""

import re
from pathlib import Path

PERFORMANCE = Path(__file__).parents[1] / "docs" / "evidence" / "performance.md"
HEAD = """# Performance

Every section below is written by the command that it names. The machine and its load stand with
each; ratios are of figures from one run of one command. What comes before the first throw has
[a page of its own](performance-start.md).
"""
ORDER = (
    "One throw",
    "The race",
    "Against real time",
    "Scaling",
    "Accuracy against cost",
    "Where the time goes",
    "A throw of a sweep",
)


def with_section(text: str, heading: str, body: str) -> str:
    """Return a page with one of its sections put in, or in place of the old one.

    Sections that `ORDER` names stand in its order, others after them as they stood.

    Examples
    --------
    >>> with_section("# Performance", "Scaling", "straight").splitlines()[-1]
    'straight'
    """
    sections = {}
    for part in ("\n" + text).split("\n## ")[1:]:
        name, _, rest = part.partition("\n")
        sections[name.strip()] = rest.strip()
    sections[heading] = body.strip()
    known = [name for name in ORDER if name in sections]
    names = known + [name for name in sections if name not in ORDER]
    return "\n".join([HEAD, *(f"## {name}\n\n{sections[name]}\n" for name in names)])


def put(text: str, name: str, content: str) -> str:
    r"""Put a table between its marks.

    Examples
    --------
    >>> put("<!-- a --> old <!-- end of a -->", "a", "new")
    '<!-- a -->\nnew\n<!-- end of a -->'
    """
    marks = f"<!-- {name} -->", f"<!-- end of {name} -->"
    pattern = re.compile(f"{re.escape(marks[0])}.*?{re.escape(marks[1])}", re.DOTALL)
    return pattern.sub(lambda _: f"{marks[0]}\n{content}\n{marks[1]}", text)


def write_section(heading: str, body: str, *, page: Path = PERFORMANCE) -> None:
    """Put a section into a page and show it on the screen."""
    text = page.read_text(encoding="utf-8") if page.exists() else ""
    page.write_text(with_section(text, heading, body), encoding="utf-8")
    print(body)
