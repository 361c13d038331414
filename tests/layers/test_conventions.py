"""What the documentation says of the variables is what the schema says."""

import pytest

from turnout.core.channels import CHANNELS


@pytest.fixture(scope="module")
def documented(pytestconfig: pytest.Config) -> dict[str, tuple[tuple[str, ...], str, str]]:
    """Return dimensions, unit and sign of each row of the table of variables."""
    text = (pytestconfig.rootpath / "docs" / "use" / "conventions.md").read_text(encoding="utf-8")
    rows = {}
    for line in text.split("(variables)=")[1].splitlines():
        if line.startswith("| `"):
            name, dims, unit, _, positive = (cell.strip() for cell in line.strip("|").split("|"))
            words = tuple(dims.split(", ")) if dims != "-" else ()
            rows[name.strip("`")] = (words, unit, positive.removeprefix("-"))
    return rows


def test_documentation_has_the_variables_of_the_schema(
    documented: dict[str, tuple[tuple[str, ...], str, str]],
) -> None:
    schema = {name: (c.dims, c.units, c.positive) for name, c in CHANNELS.items()}
    assert documented == schema
