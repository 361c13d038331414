"""How well the books of energy close, relative to the scale of the run."""

import xarray as xr

# Where less than this has moved, shares of the scale would be rounding over rounding [J].
LEAST_SCALE = 1e-3


def residual_share(dataset: xr.Dataset) -> float:
    """Return the largest residual of the books over the run's energy scale, at least 1 mJ [-]."""
    return _share(dataset, "energy_residual")


def numerical_share(dataset: xr.Dataset) -> float:
    """Return the largest numerical loss over the run's energy scale, at least 1 mJ [-]."""
    return _share(dataset, "energy_numerical")


def _share(dataset: xr.Dataset, name: str) -> float:
    scale = max(float(dataset.attrs["energy_scale"]), LEAST_SCALE)
    return float(abs(dataset[name]).max()) / scale
