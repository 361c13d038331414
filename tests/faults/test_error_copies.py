"""Errors that cross processes: a copy and a pickle keep type, text and attributes."""

import copy
import importlib
import multiprocessing
import pickle
import pkgutil
from collections.abc import Callable, Iterator, Mapping
from functools import cache, partial
from typing import Any

import pytest

import turnout
from turnout.core.errors import ListedError
from turnout.solver.outcome import Code, NotConverged, Outcome
from turnout.web.guard import TooLargeError
from turnout.web.question import UnknownMarkError

OUTCOME = Outcome(Code.NOT_CONVERGED, 0.5, 500, 1e-5, ("drive 1",), 1e-9, 7.0)
# Those whose constructor takes more, or other things, than one text.
MADE: Mapping[type[BaseException], Callable[[], BaseException]] = {
    NotConverged: lambda: NotConverged(OUTCOME, partial={"time": [0.0, 0.5]}),
    TooLargeError: lambda: TooLargeError(1_000_000),
    UnknownMarkError: lambda: UnknownMarkError("a1", "this panel is no longer loaded"),
}


def pickled(error: BaseException, *, protocol: int) -> Any:
    """Return what comes back from a pickle."""
    return pickle.loads(pickle.dumps(error, protocol))


WAYS: Mapping[str, Callable[[BaseException], BaseException]] = {
    "copy": copy.copy,
    "deepcopy": copy.deepcopy,
    **{
        f"pickle {protocol}": partial(pickled, protocol=protocol)
        for protocol in range(pickle.HIGHEST_PROTOCOL + 1)
    },
}

STUBBORN = turnout.Scheme(iterations=1, halvings=0, follow_path=False)


def throw(name: str) -> object:
    return turnout.simulate(turnout.load_panel(name), scheme=STUBBORN)


@cache
def exceptions_of_turnout() -> tuple[type[BaseException], ...]:
    """Return every exception class that a module of the package defines."""
    for module in pkgutil.walk_packages(turnout.__path__, "turnout."):
        importlib.import_module(module.name)

    def below(kind: type[BaseException]) -> Iterator[type[BaseException]]:
        for each in type.__subclasses__(kind):
            yield each
            yield from below(each)

    own = {kind for kind in below(BaseException) if kind.__module__.startswith("turnout.")}
    return tuple(sorted(own, key=lambda kind: kind.__name__))


def made(kind: type[BaseException]) -> BaseException:
    """Return an error with something in each attribute, and one that was added to it."""
    if kind in MADE:
        error = MADE[kind]()
    elif issubclass(kind, ListedError):
        error = kind(["drive.1: is missing", "rail: is missing"], source="own.toml")
    else:
        error = kind("own.toml: cannot be read")
    error.add_note("while reading")
    return error


@pytest.mark.parametrize("way", WAYS)
def test_copies_of_all_errors_are_what_they_are_copies_of(way: str) -> None:
    kinds = exceptions_of_turnout()
    assert {NotConverged, ListedError, TooLargeError} <= set(kinds)
    for kind in kinds:
        error = made(kind)
        try:
            found = WAYS[way](error)
        except Exception as reason:  # noqa: BLE001 - whatever it is, name the class
            pytest.fail(f"{way} of {kind.__name__}: {reason!r}")
        assert type(found) is kind
        assert str(found) == str(error), kind
        assert (found.args, vars(found)) == (error.args, vars(error)), kind


@pytest.mark.usefixtures("worker_processes")
def test_a_pool_ends_after_a_throw_that_does_not_converge() -> None:
    """The pool waited for ever for an error that it could not unpickle."""
    with (
        multiprocessing.get_context("spawn").Pool(1) as pool,
        pytest.raises(NotConverged) as caught,
    ):
        pool.map_async(throw, ["sb1"]).get(timeout=300)
    error = caught.value
    assert (error.outcome.code, error.partial.attrs["outcome"]) == (
        Code.NOT_CONVERGED,
        "not converged",
    )
    assert str(error) == error.outcome.message() == error.partial.attrs["outcome_message"]
