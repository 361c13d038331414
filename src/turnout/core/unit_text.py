"""Grammar of a unit text: names of units with small whole powers, multiplied or divided.

    unit    = ["1/"] factor {("*" | "·" | "." | "/" | " per " | " ") factor}
    factor  = name [("^" | "**") whole number from -9 to 9 | raised digit]

Other texts are refused before pint sees them: "m*9^9^9^9" would take it for ever.
"""

import re

LONGEST = 60
"""Most characters of a unit."""

_FACTOR = re.compile(
    r"(?:[A-Za-zµμΩ][A-Za-z0-9_µμΩ]{0,23}|°[CF]?|%)"
    r"(?:\s?(?:\^|\*\*)\s?[+-]?[1-9]|⁻?[¹²³⁴⁵⁶⁷⁸⁹])?(?=[\s*·./]|\Z)"
)
_SIGN = re.compile(r"\s?[*·./]\s?|\s(?:per\s)?")
_ONE = re.compile(r"1(?:\s?/\s?|\sper\s)")


def is_unit_text(text: str) -> bool:
    """Return whether a text, with single spaces at most, follows the grammar of the module.

    Examples
    --------
    >>> [is_unit_text(text) for text in ("kN s/m^2", "1/K", "kg·m⁻³", "m per s")]
    [True, True, True, True]
    >>> [is_unit_text(text) for text in ("m^9^9", "2 m", "N/(m/s)", "m*", "m^10")]
    [False, False, False, False, False]
    """
    if len(text) > LONGEST:
        return False
    one = _ONE.match(text)
    position = one.end() if one else 0
    while factor := _FACTOR.match(text, position):
        position = factor.end()
        if position == len(text):
            return True
        sign = _SIGN.match(text, position)
        if sign is None:
            return False
        position = sign.end()
    return False
