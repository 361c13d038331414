"""What the page may ask for, checked at the door; values carry their units as in a panel file."""

from typing import Any, TypeVar

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from turnout.core.problems import describe_error
from turnout.errors import FileError


class Asked(BaseModel):
    """Base of what a page sends: nothing unknown, nothing changed later."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class AskedObject(Asked):
    """A foreign object: texts as on the command line."""

    size: str = Field(max_length=40, description="such as '13 mm'")
    at: str = Field(max_length=80, description="such as 'sleeper 6' or 'x = 3.6 m'")
    stiffness: str | None = Field(default=None, max_length=40, description="such as '40 kN/mm'")


class AskedRun(Asked):
    """A throw: the panel by its mark, what is changed in it, and what is trapped."""

    panel: str = Field(max_length=80, description="mark that the server gave the panel")
    object: AskedObject | None = Field(default=None, description="what is trapped")
    settings: dict[str, float | str] = Field(
        default={}, max_length=40, description="values by key of the panel"
    )
    preview: bool = Field(default=False, description="whether quick mode will do")


class AskedFile(Asked):
    """A file made of a throw, with another one drawn behind it."""

    run: AskedRun
    behind: AskedRun | None = Field(default=None, description="drawn grey behind it")


class AskedPanel(Asked):
    """A panel: a name of the library."""

    name: str = Field(max_length=80)


class AskedMark(Asked):
    """A panel by its mark."""

    panel: str = Field(max_length=80)


T = TypeVar("T", bound=Asked)


def read_asked(kind: type[T], content: bytes) -> T:
    """Read what a page sent.

    Raises
    ------
    FileError
        With everything that is wrong in it.
    """
    try:
        return kind.model_validate_json(content)
    except ValidationError as error:
        problems = [_described(item) for item in error.errors(include_url=False)]
        raise FileError("request: " + "; ".join(problems)) from None


def _described(error: Any) -> str:
    return ".".join(str(part) for part in error["loc"]) + describe_error(error)
