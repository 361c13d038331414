"""Values with units as engineers read them, kN, kN/m, mm, GPa, and counts with their nouns."""

# SI unit: name on the screen and its size in SI.
SHOWN: dict[str, tuple[str, float]] = {
    "1": ("", 1.0),
    "m": ("mm", 1e-3),
    "N": ("kN", 1e3),
    "N/m": ("kN/m", 1e3),
    "N s/m": ("kN s/m", 1e3),
    "N m/rad": ("kN m/rad", 1e3),
    "N/m^2": ("GPa", 1e9),
    "Pa": ("GPa", 1e9),
    "m^2": ("cm^2", 1e-4),
    "m^4": ("cm^4", 1e-8),
}


def shown_unit(unit: str) -> tuple[str, float]:
    """Return the unit in which values of an SI unit are shown, and its size in SI.

    Examples
    --------
    >>> shown_unit("N/m"), shown_unit("Pa"), shown_unit("1"), shown_unit("kg")
    (('kN/m', 1000.0), ('GPa', 1000000000.0), ('', 1.0), ('kg', 1.0))
    """
    return SHOWN.get(unit, (unit, 1.0))


def value_text(*values: float, unit: str, digits: int = 5) -> str:
    """Return a value, or several as a range, with the unit.

    Parameters
    ----------
    values : float
        In SI.
    unit : str
        SI unit, "1" for none.
    digits : int
        Significant ones.

    Examples
    --------
    >>> value_text(7.5e5, unit="N/m"), value_text(2.101e11, unit="Pa"), value_text(0.3, unit="1")
    ('750 kN/m', '210.1 GPa', '0.3')
    >>> value_text(1.25e6, 1.3e6, unit="N/m"), value_text(40e6, unit="N/m", digits=2)
    ('1250 ... 1300 kN/m', '40000 kN/m')
    """
    name, size = shown_unit(unit)
    return f"{' ... '.join(_number(value / size, digits) for value in values)} {name}".rstrip()


def _number(value: float, digits: int) -> str:
    # Thousands stay what they are: 1250, not 1.25e+03.
    text = f"{value:.{digits}g}"
    return f"{float(text):.0f}" if "e+" in text and abs(value) < 1e9 else text


def count_text(number: int, noun: str) -> str:
    """Return a number with its noun, in the plural unless the number is one.

    Examples
    --------
    >>> count_text(1, "movement"), count_text(0, "throw"), count_text(12, "usable movement")
    ('1 movement', '0 throws', '12 usable movements')
    """
    return f"{number} {noun}{'s' * (number != 1)}"


def duration_text(seconds: float) -> str:
    """Return a duration in readable units.

    Examples
    --------
    >>> duration_text(14.2), duration_text(200), duration_text(5400)
    ('14 s', '3.3 min', '1.5 h')
    """
    if seconds < 90:
        return f"{seconds:.2g} s"
    return f"{seconds / 60:.1f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"


def size_text(count: float) -> str:
    """Show a number of bytes in the unit that leaves a readable number.

    Examples
    --------
    >>> size_text(950), size_text(4.2e6)
    ('950 B', '4.2 MB')
    """
    for unit in ("B", "kB", "MB", "GB"):
        if count < 999.5:
            return f"{count:.3g} {unit}"
        count /= 1000
    return f"{count:.3g} TB"
