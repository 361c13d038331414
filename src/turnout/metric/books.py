"""How well the books of energy close, relative to the scale of the run."""

import xarray as xr


def residual_share(dataset: xr.Dataset) -> float:
    """Return the largest residual of the books over the run's energy scale [-]."""
    return _share(dataset, "energy_residual")


def numerical_share(dataset: xr.Dataset) -> float:
    """Return the largest numerical loss over the run's energy scale [-]."""
    return _share(dataset, "energy_numerical")


def _share(dataset: xr.Dataset, name: str) -> float:
    scale = float(dataset.attrs["energy_scale"])
    return float(abs(dataset[name]).max()) / scale if scale > 0 else float("nan")
