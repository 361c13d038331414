"""The sources that cached and stored results depend on: one list for keys and digests.

Results are cached under a digest of the sources that computed them, so that no stale one is found.
A change in a package that is missing here would leave wrong results in use;
`tests/layers/test_sources.py` compares the lists with what the code imports.
"""

import hashlib
from collections.abc import Sequence
from functools import cache
from pathlib import Path

KERNELS = (
    *("kernels", "law", "solver", "machine/compute", "metric/force_features.py"),
    *("throw/gap_history.py", "throw/row_sums.py"),
)
"""Sources that are compiled into kernels."""

RAILS = ("beam", "mechanism")
"""Sources that compute sections and superelements, whose inputs are part of their keys."""

THROWS = (
    *("core", "kernels", "panel", "beam", "law", "machine", "mechanism", "solver", "throw"),
    *("metric", "study", "measurement/chain/recorder.py"),
)
"""Sources that compute or change a number that a sweep stores."""


@cache
def digest_of_sources(packages: Sequence[str]) -> str:
    """Return a digest of names and contents of the modules of some packages.

    Parameters
    ----------
    packages : tuple of str
        Folders or modules below that of turnout, such as `KERNELS`.

    Returns
    -------
    str
        16 hexadecimal digits.
    """
    root = Path(__file__).parents[1]
    found = hashlib.sha256()
    for package in packages:
        place = root / package
        for source in [place] if place.suffix else sorted(place.rglob("*.py")):
            found.update(source.relative_to(root).as_posix().encode())
            found.update(source.read_bytes())
    return found.hexdigest()[:16]
