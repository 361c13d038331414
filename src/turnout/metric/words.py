"""Forces and lengths as words of a sentence."""

from collections.abc import Mapping

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


def changed(changes: Mapping[str, object]) -> str:
    """Return what a panel was changed in; calibrated numbers with five digits.

    Examples
    --------
    >>> changed({"chair.friction_coefficient": 0.27001253045, "drive.1.stiffness": 640163.2})
    'chair.friction_coefficient = 0.27001, drive.1.stiffness = 640160'
    """

    def text(value: object) -> str:
        return f"{float(f'{value:.5g}'):.12g}" if isinstance(value, float) else str(value)

    return ", ".join(f"{key} = {text(value)}" for key, value in changes.items())
