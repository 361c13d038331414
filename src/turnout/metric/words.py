"""Forces and lengths as words of a sentence."""

import xarray as xr


def kilo(force: xr.DataArray | float) -> str:
    """Return a force [N] in kilonewtons.

    Examples
    --------
    >>> kilo(4409.0), kilo(-0.4)
    ('4.41 kN', '0.00 kN')
    """
    # Adding zero turns a negative zero into a plain one.
    return f"{round(float(force) / 1e3, 2) + 0.0:.2f} kN"


def milli(length: xr.DataArray | float) -> str:
    """Return a length [m] in millimetres.

    Examples
    --------
    >>> milli(0.012971)
    '12.97 mm'
    """
    return f"{round(float(length) * 1e3, 2) + 0.0:.2f} mm"
