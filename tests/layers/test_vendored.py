"""Scripts of others lie here as their lists say: version, licence, unchanged since."""

import hashlib
import re
from pathlib import Path

VENDOR = Path(__file__).parents[2] / "src" / "turnout" / "web" / "page" / "vendor"


def test_the_scripts_of_the_page_are_those_that_their_list_describes() -> None:
    text = (VENDOR / "README.md").read_text(encoding="utf-8")
    listed = dict(re.findall(r"\| `([\w.]+\.js)` \| `([0-9a-f]{64})` \|", text))
    found = {
        file.name: hashlib.sha256(file.read_bytes()).hexdigest() for file in VENDOR.glob("*.js")
    }
    assert found == listed
    assert "The MIT License" in (VENDOR / "three.LICENSE").read_text(encoding="utf-8")


def test_the_page_names_no_address() -> None:
    own = [file for file in VENDOR.parent.iterdir() if file.is_file()]
    named = {
        file.name: re.findall(r"https?://[\w.]+", file.read_text(encoding="utf-8")) for file in own
    }
    assert set(sum(named.values(), [])) <= {"http://www.w3.org"}, named
