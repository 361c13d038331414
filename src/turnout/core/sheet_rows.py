"""Rows of small tables that people and spreadsheets write: comments, separators, quoted cells."""

import csv

SEPARATORS = ",;\t"


def split_row(line: str, separator: str) -> list[str]:
    """Return the cells of a line; ValueError where one is too long.

    Examples
    --------
    >>> split_row('a, "b,c"', ",")
    ['a', 'b,c']
    """
    try:
        cells = next(csv.reader([line], delimiter=separator, skipinitialspace=True), [])
    except csv.Error as error:
        message = f"{error}; shorten the cell, or close its quotation mark"
        raise ValueError(message) from None
    return [cell.strip() for cell in cells]


def sheet_rows(text: str) -> tuple[list[str], list[tuple[int, list[str]]]]:
    r"""Return the comments of a table, and the cells of each other line with its number.

    Parameters
    ----------
    text : str
        Lines that begin with # are comments; the first other line tells the separator, a comma, a
        semicolon or a tab.

    Returns
    -------
    comments : list of str
        Without their marks.
    rows : list of (int, list of str)
        Lines of nothing but separators are left out.

    Raises
    ------
    ValueError
        When the cells of a line cannot be parted; the text names it.

    Examples
    --------
    >>> sheet_rows("# title: x\nsize;hit\n\n1,5;yes")
    (['title: x'], [(2, ['size', 'hit']), (4, ['1,5', 'yes'])])
    """
    comments: list[str] = []
    rows: list[tuple[int, list[str]]] = []
    separator = ""
    for number, line in enumerate(text.splitlines(), 1):
        if line.lstrip().startswith("#"):
            comments.append(line.lstrip("# \t"))
        elif line.strip(f" {SEPARATORS}"):
            separator = separator or max(SEPARATORS, key=line.count)
            try:
                rows.append((number, split_row(line, separator)))
            except ValueError as error:
                message = f"line {number}: {error}"
                raise ValueError(message) from None
    return comments, rows
