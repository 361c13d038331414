"""Problems in a document: the key, the value given, the allowed values, the nearest name."""

import difflib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

_LONGEST = 60


@dataclass(frozen=True, slots=True)
class Problem:
    """A fault of a file: key path, a sentence about it, and the key that was meant, if any."""

    path: tuple[str, ...]
    text: str
    meant: str = ""

    def __str__(self) -> str:
        """Give the line that a user reads."""
        return f"{'.'.join(shortened(part) for part in self.path)}{self.text}"


def show_value(value: object) -> str:
    """Show a value as a user would write it in the file, shortened.

    Examples
    --------
    >>> show_value("13 mm"), show_value(True), show_value([1, 2])
    ('"13 mm"', 'true', '[1, 2]')
    """
    if isinstance(value, bool):
        return "true" if value else "false"
    if value is None:
        return "nothing"
    if isinstance(value, float):
        return f"{float(value):g}"
    if isinstance(value, int) and value.bit_length() > _LONGEST * 4:
        return "a number of more than 60 digits"
    return _beginning(value)


def _beginning(value: object) -> str:
    """Show the beginning of a value, reading no more of it than that."""
    if isinstance(value, Mapping):
        shown = (f"{shortened(str(key))} = {show_value(item)}" for key, item in value.items())
        text = "{" + _joined(shown) + "}"
    elif isinstance(value, list | tuple):
        text = "[" + _joined(show_value(item) for item in value) + "]"
    elif isinstance(value, str):
        text = f'"{value[:_LONGEST]}"'
    else:
        text = str(value)
    return shortened(text)


def _joined(items: Iterable[str]) -> str:
    text = ""
    for number, item in enumerate(items):
        text += f", {item}" if number else item
        if len(text) > _LONGEST:
            break
    return text


def shortened(text: str, longest: int = _LONGEST) -> str:
    """Shorten a text for a message.

    Examples
    --------
    >>> shortened("a" * 100, 10)
    'aaaaaa ...'
    """
    return text if len(text) <= longest else text[: longest - 4] + " ..."


def nearest(name: str, names: Iterable[str]) -> str:
    """Give "; nearest is 'x'" for the name that `meant` finds, or an empty text.

    Examples
    --------
    >>> nearest("stifness", ["stiffness", "stroke"])
    "; nearest is 'stiffness'"
    """
    found = meant(name, names)
    return f"; nearest is '{found}'" if found else ""


def meant(name: str, names: Iterable[str]) -> str:
    """Return the most similar name, or an empty text.

    A name that was shortened means the first that begins with it.

    Examples
    --------
    >>> meant("stifness", ["stiffness", "stroke"])
    'stiffness'
    """
    known = list(dict.fromkeys(names))
    numbered = [item for item in known if item.isdigit()]
    if name.isdigit() and numbered:
        return min(numbered, key=lambda item: abs(int(item) - int(name)))
    longer = [item for item in known if item.lower().startswith(name.lower())]
    if len(name) > 2 and longer:
        return longer[0]
    lower = {item.lower(): item for item in reversed(known)}
    match = difflib.get_close_matches(name.lower(), lower, n=1, cutoff=0.5)
    return lower[match[0]] if match else ""


def count_in_words(count: int, noun: str) -> str:
    """Return a number of things with its verb.

    Examples
    --------
    >>> count_in_words(1, "sample"), count_in_words(3, "sample")
    ('1 sample is', '3 samples are')
    """
    return f"{count} {noun} is" if count == 1 else f"{count} {noun}s are"


def choices(names: Iterable[str], *, most: int = 12) -> str:
    """List names for a message, shortened.

    Examples
    --------
    >>> choices(["A", "B"])
    "'A', 'B'"
    """
    known = list(names)
    more = f" and {len(known) - most} more" if len(known) > most else ""
    return ", ".join(f"'{name}'" for name in known[:most]) + more if known else "none"


def describe_error(error: Mapping[str, Any], *, allowed: Iterable[str] = ()) -> str:
    """Describe a pydantic error in one sentence, with the value and the allowed values.

    Parameters
    ----------
    error : mapping
        An entry of `ValidationError.errors()`.
    allowed : iterable of str
        The keys that exist where the error is, for unknown keys.

    Returns
    -------
    str
        The text that follows the key's path.
    """
    kind, context = str(error["type"]), error.get("ctx", {})
    key = str(error["loc"][-1]) if error["loc"] else ""
    if kind == "missing":
        return ": is missing"
    if kind == "extra_forbidden":
        return f": unknown key{nearest(key, allowed)}; allowed are {choices(allowed, most=40)}"
    given = f" = {show_value(error.get('input'))}: "
    if kind == "value_error":
        return given + str(context["error"])
    return given + _requirement(kind, context, str(error["msg"]))


def validation_problems(
    errors: Iterable[Any], *, allowed: Callable[[tuple[str, ...]], Iterable[str]] = lambda _: ()
) -> list[str]:
    """Describe all errors of pydantic, each with its key; members of lists count from 1.

    Parameters
    ----------
    errors : iterable of mapping
        `ValidationError.errors()`.
    allowed : callable
        The keys of the table at a path.
    """
    found = []
    for item in errors:
        path = [str(part + 1) if isinstance(part, int) else part for part in item["loc"]]
        found.append(".".join(path) + describe_error(item, allowed=allowed(tuple(path[:-1]))))
    return list(dict.fromkeys(found))


def _requirement(kind: str, context: Mapping[str, Any], message: str) -> str:
    bounds = {
        "greater_than": ("more than", "gt"),
        "greater_than_equal": ("at least", "ge"),
        "less_than": ("less than", "lt"),
        "less_than_equal": ("at most", "le"),
    }
    if kind in bounds:
        words, name = bounds[kind]
        return f"must be {words} {context[name]:g}"
    if kind == "literal_error":
        return f"must be {context['expected']}"
    if kind in ("too_short", "too_long"):
        bound, limit = (
            ("at least", "min_length") if kind == "too_short" else ("at most", "max_length")
        )
        return f"needs {bound} {context[limit]}, has {context['actual_length']}"
    plain = {
        "string_type": "must be text in quotes",
        "float_type": "must be a plain number, without quotes or unit",
        "float_parsing": "must be a plain number, without quotes or unit",
        "int_type": "must be a whole number",
        "bool_type": "must be true or false",
        "finite_number": "must be a finite number",
        "list_type": "must be a list",
        "tuple_type": "must be a list",
        "dict_type": "must be a table",
        "model_type": "must be a table",
        "model_attributes_type": "must be a table",
    }
    return plain.get(kind, message.removeprefix("Input should be ").join(("must be ", "")))
