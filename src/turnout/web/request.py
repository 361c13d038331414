"""Validated requests of the page; values carry their units as in a panel file."""

from typing import TypeVar

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from turnout.core.errors import FileError
from turnout.core.problems import validation_problems


class PageRequest(BaseModel):
    """Base of requests: unknown keys are refused, records are frozen."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class ObjectRequest(PageRequest):
    """A foreign object: texts as on the command line."""

    size: str = Field(max_length=40, description="such as '13 mm'")
    at: str = Field(max_length=80, description="such as 'sleeper 6' or 'x = 3.6 m'")
    stiffness: str | None = Field(default=None, max_length=40, description="such as '40 kN/mm'")
    kind: str = Field(default="spring", max_length=40, description="such as 'ice'")


class RunRequest(PageRequest):
    """A throw: the panel by its mark, its changed values, the trapped object."""

    panel: str = Field(max_length=80, description="mark that the server gave the panel")
    object: ObjectRequest | None = Field(default=None, description="what is trapped")
    settings: dict[str, float | str] = Field(
        default={}, max_length=40, description="values by key of the panel"
    )
    preview: bool = Field(default=False, description="whether quick mode is sufficient")


class MapRequest(PageRequest):
    """Objects of several sizes at several places, thrown one by one."""

    run: RunRequest = Field(description="panel, changes, kind and stiffness of the object")
    places: list[str] = Field(min_length=1, max_length=60, description="such as 'sleeper 6'")
    sizes: list[str] = Field(min_length=1, max_length=20, description="such as '13 mm'")


class WheelRequest(PageRequest):
    """A wheel that rolls along the closed rail of a throw, with a flange and a vertical force."""

    run: RunRequest = Field(description="panel, changes and the trapped object")
    lateral: str = Field(max_length=40, description="flange force Y, such as '40 kN'")
    vertical: str = Field(max_length=40, description="vertical force Q, such as '50 kN'")
    course: str = Field(default="facing", max_length=40, description="'facing' or 'trailing'")


class FileRequest(PageRequest):
    """A file made of a throw, with another one drawn behind it."""

    run: RunRequest
    behind: RunRequest | None = Field(default=None, description="drawn grey behind it")


class PanelRequest(PageRequest):
    """A panel: a name of the library."""

    name: str = Field(max_length=80)


class MarkRequest(PageRequest):
    """A panel by its mark."""

    panel: str = Field(max_length=80)


T = TypeVar("T", bound=PageRequest)


def read_request(kind: type[T], content: bytes) -> T:
    """Read the request of a page.

    Raises
    ------
    FileError
        With all problems.
    """
    try:
        return kind.model_validate_json(content)
    except ValidationError as error:
        raise FileError("request: " + "; ".join(validation_problems(error.errors()))) from None
