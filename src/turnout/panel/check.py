"""Cross checks between the records of a panel."""

from turnout.files.problems import Problem
from turnout.panel.validate import Draft


def check(draft: Draft) -> list[Problem]:
    """Check what no single record can know."""
    return []
