"""How well the books of energy close, relative to the scale of the run."""

import numpy as np
import xarray as xr

MOST_NUMERICAL = 0.02
"""Share of the energy scale that a scheme may lose or make before a reader should know [-]."""

# Where less than this has moved, shares of the scale would be rounding over rounding [J].
LEAST_SCALE = 1e-3


def is_inaccurate(dataset: xr.Dataset) -> bool:
    """Return whether a run came to its end with an energy balance that does not close.

    Examples
    --------
    >>> is_inaccurate(xr.Dataset(attrs={"complete": False, "outcome": "inaccurate"}))
    True
    """
    return str(dataset.attrs.get("outcome", "")) == "inaccurate"


def residual_share(dataset: xr.Dataset) -> float:
    """Return the largest residual of the books over the run's energy scale, at least 1 mJ [-]."""
    return _share(dataset, "energy_residual")


def numerical_share(dataset: xr.Dataset) -> float:
    """Return the largest numerical loss over the run's energy scale, at least 1 mJ [-]."""
    return _share(dataset, "energy_numerical")


def numerical_warning(dataset: xr.Dataset) -> str | None:
    """Return what to say and do where the scheme itself lost or made too much, else None.

    Where less than `LEAST_SCALE` has moved there is nothing to say.
    """
    share = numerical_share(dataset)
    if share <= MOST_NUMERICAL or float(dataset.attrs["energy_scale"]) <= LEAST_SCALE:
        return None
    values = dataset["energy_numerical"].to_numpy()
    lost = "lost" if values[np.abs(values).argmax()] > 0 else "MADE"
    return (
        f"the time stepping itself {lost} {100 * share:.3g} % of the energy, more than "
        f"{100 * MOST_NUMERICAL:g} %; take a smaller step, or a spectral radius below 1 if it is 1"
    )


def _share(dataset: xr.Dataset, name: str) -> float:
    scale = max(float(dataset.attrs["energy_scale"]), LEAST_SCALE)
    return float(abs(dataset[name]).max()) / scale
