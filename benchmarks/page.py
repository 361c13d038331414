"""Pages of the documentation that commands write: sections by heading, tables between marks."""

import re
from pathlib import Path

DOCS = Path(__file__).parents[1] / "docs"
EVIDENCE = DOCS / "evidence"
PERFORMANCE = EVIDENCE / "performance.md"
METHODS = EVIDENCE / "performance-methods.md"
ACCURACY = EVIDENCE / "accuracy.md"


def with_section(text: str, heading: str, body: str) -> str:
    r"""Return a page with a section in place of the old one of its heading, or at the end.

    Examples
    --------
    >>> with_section("# Performance\n\n## Scaling\n\nold", "Scaling", "new").splitlines()[-1]
    'new'
    """
    head, *parts = text.split("\n## ")
    sections = dict(part.split("\n", 1) for part in parts)
    sections[heading] = f"\n{body.strip()}\n"
    return "\n## ".join([head, *(f"{name}\n{content}" for name, content in sections.items())])


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
    page.write_text(with_section(page.read_text(encoding="utf-8"), heading, body), encoding="utf-8")
    print(body)


def put_section(page: Path, *, name: str, heading: str, lines: list[str]) -> None:
    """Replace the part of a page between its marks, or add it at the end."""
    text = page.read_text(encoding="utf-8") if page.exists() else "# Results\n"
    if f"<!-- {name} -->" not in text:
        text = f"{text.rstrip()}\n\n## {heading}\n\n<!-- {name} --><!-- end of {name} -->\n"
    page.write_text(put(text, name, "\n".join(lines)), encoding="utf-8")
