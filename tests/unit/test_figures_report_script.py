"""The vendored plotting script: what it is, unchanged since it was vendored, runs locally."""

import hashlib
import re
from importlib.resources import files

from turnout.figures.report.page import PLOTLY_VERSION, plotly_script

VENDOR = files("turnout.figures.report").joinpath("vendor")


def test_the_script_is_the_one_that_its_readme_describes() -> None:
    digest = hashlib.sha256(plotly_script().encode()).hexdigest()
    readme = VENDOR.joinpath("README.md").read_text(encoding="utf-8")
    assert f"as it lies here | `{digest}`" in readme
    assert f"| {PLOTLY_VERSION} |" in readme
    assert "MIT License" in VENDOR.joinpath("plotly-basic.LICENSE").read_text(encoding="utf-8")


def test_the_script_names_no_address_and_cannot_end_its_element() -> None:
    addresses = set(re.findall(r"https?://[\w.-]+", plotly_script()))
    assert addresses == {"http://www.w3.org"}  # names of XML vocabularies
    assert not re.search(r"</script|<!--", plotly_script(), flags=re.I)
