"""Colour of result lines on a terminal; a file, a pipe and NO_COLOR get plain text."""

import typer

COLOURS = {"good": typer.colors.GREEN, "look": typer.colors.YELLOW, "bad": typer.colors.RED}


def coloured(text: str, level: str) -> str:
    """Return a line with its head, up to the first colon, in the colour of a level.

    Parameters
    ----------
    text : str
        A line for `typer.echo`, which leaves colours out where the output is no terminal.
    level : str
        "good", "look" or "bad"; others get no colour.

    Examples
    --------
    >>> coloured("Sound: no object", "fact")
    'Sound: no object'
    >>> coloured("Sound: no object", "good").endswith(": no object")
    True
    """
    if level not in COLOURS:
        return text
    head, colon, rest = text.partition(":")
    return typer.style(head, fg=COLOURS[level], bold=True) + colon + rest
