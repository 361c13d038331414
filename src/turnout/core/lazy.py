"""Public names that load the module behind them when they are first used.

A public package holds one table, each name and where it is defined. `__all__`, the loader, tab
completion and the stub all follow from it; ``python -m turnout.api.stub`` writes the stubs.
"""

import sys
from collections.abc import Callable, Mapping
from importlib import import_module


def home_of(name: str, place: str) -> tuple[str, str]:
    """Return the module and the attribute of a row of the table.

    Parameters
    ----------
    name : str
        Name that users import.
    place : str
        Module that defines it, and after a colon what it is called there, where that differs.

    Examples
    --------
    >>> home_of("load_panel", "turnout.panel.load")
    ('turnout.panel.load', 'load_panel')
    >>> home_of("panel_names", "turnout.panel.load:library_names")
    ('turnout.panel.load', 'library_names')
    """
    module, _, attribute = place.partition(":")
    return module, attribute or name


def loader(
    package: str,
    table: Mapping[str, str],
    *,
    before: Callable[[str], None] | None = None,
) -> Callable[[str], object]:
    """Return the ``__getattr__`` of a package.

    Parameters
    ----------
    package : str
        Dotted name of the package, such as "turnout.figures".
    table : mapping of str to str
        Public names, see `home_of`; a row that names a package inside this one is that package.
    before : callable, optional
        Called with the module of a name before it is given out.
    """

    def load(name: str) -> object:
        if name not in table:
            raise AttributeError(_unknown(package, name, table))
        module, attribute = home_of(name, table[name])
        if before is not None:
            before(module)
        inside = module == f"{package}.{name}"
        value = import_module(module) if inside else getattr(import_module(module), attribute)
        setattr(sys.modules[package], name, value)
        return value

    return load


def _unknown(package: str, name: str, table: Mapping[str, str]) -> str:
    """Return the error for an unknown name, with the nearest known one."""
    import difflib

    close = difflib.get_close_matches(name, list(table), n=1)
    near = f"; nearest is '{close[0]}'" if close else ""
    return f"module '{package}' has no attribute '{name}'{near}"
