"""Distance between two sets of movements, channel by channel, and spread of repeats."""

from itertools import groupby
from typing import cast

import numpy as np
import xarray as xr
from numpy.typing import NDArray

Floats = NDArray[np.float64]
FORCES = ("drive_force", "object_force")
OBJECT = "object"


def channel_scale(measured: xr.DataArray) -> xr.DataArray:
    """Return the largest force of each channel in a campaign, to which errors are related.

    One scale a channel, not one a movement: an object that is hardly touched would else make a
    small error look large.

    Examples
    --------
    >>> values = [[[1.0, -4.0], [2.0, np.nan]]]
    >>> channel_scale(xr.DataArray(values, dims=("channel", "movement", "time"))).values
    array([4.])
    """
    return abs(measured).max(("movement", "time"))


def rms_difference(measured: xr.DataArray, predicted: xr.DataArray) -> xr.DataArray:
    r"""Return the root of the mean square difference of each channel and movement.

    .. math:: \sqrt{\frac{1}{n} \sum_{i=1}^{n} (p_i - m_i)^2}

    Parameters
    ----------
    measured, predicted : xarray.DataArray, dims (channel, movement, time)
        On the same times [N]; instants without a measurement do not count.

    Returns
    -------
    xarray.DataArray, dims (channel, movement)
        [N]; NaN where nothing was measured.

    Examples
    --------
    >>> dims = ("channel", "movement", "time")
    >>> one = xr.DataArray([[[0.0, 0.0]]], dims=dims)
    >>> other = xr.DataArray([[[3.0, 4.0]]], dims=dims)
    >>> round(float(rms_difference(one, other)[0, 0]), 4)
    3.5355
    """
    return cast("xr.DataArray", np.sqrt(((predicted - measured) ** 2).mean("time")))


def nrmse(measured: xr.DataArray, predicted: xr.DataArray) -> xr.DataArray:
    """Return the RMS difference over the largest measured force of the channel [-].

    Examples
    --------
    >>> dims = ("channel", "movement", "time")
    >>> one = xr.DataArray([[[0.0, 8.0]]], dims=dims)
    >>> other = xr.DataArray([[[3.0, 4.0]]], dims=dims)
    >>> round(float(nrmse(one, other)[0, 0]), 4)
    0.4419
    """
    return rms_difference(measured, predicted) / channel_scale(measured)


def repeat_groups(dataset: xr.Dataset) -> list[list[int]]:
    """Return the numbers of movements that are equal by the sheet, two or more each.

    Examples
    --------
    >>> sheet = {"direction": ["closing"] * 3, "size": [0.0, 0.013, 0.0], "place": ["none"] * 3}
    >>> repeat_groups(xr.Dataset(coords={key: ("movement", value) for key, value in sheet.items()}))
    [[0, 2]]
    """
    columns = (dataset[name].values.tolist() for name in ("direction", "size", "place"))
    keys = list(zip(*columns, strict=True))
    order = sorted(range(len(keys)), key=keys.__getitem__)
    groups = [list(group) for _, group in groupby(order, key=keys.__getitem__)]
    return [group for group in groups if len(group) > 1]


def repeat_spread(channels: xr.DataArray, groups: list[list[int]]) -> xr.DataArray:
    r"""Return the deviation of repeats from their mean: no prediction can be better.

    .. math:: s^2 = \frac{\sum_g \sum_{j \in g} \overline{(m_j - \bar m_g)^2}}{\sum_g (n_g - 1)}

    Parameters
    ----------
    channels : xarray.DataArray, dims (channel, movement, time)
        Measured [N].
    groups : list of list of int
        Numbers of movements that are equal by the sheet, from `repeat_groups`.

    Returns
    -------
    xarray.DataArray, dims (channel)
        [N]; NaN where nothing was repeated. An unbiased estimate of one movement's standard
        deviation, so a perfect model of the mean is at an RMS difference of one such spread.

    Examples
    --------
    >>> values = xr.DataArray([[[1.0, 1.0], [3.0, 3.0]]], dims=("channel", "movement", "time"))
    >>> round(float(repeat_spread(values, [[0, 1]])[0]), 4)
    1.4142
    """
    total = np.zeros(channels.sizes["channel"])
    freedom = np.zeros_like(total)
    for group in groups:
        part = channels.isel(movement=group).transpose("channel", "movement", "time")
        there = np.isfinite(part.values).any(axis=2)
        centred = part - part.mean("movement")
        square = (centred**2).mean("time").sum("movement").values
        count = there.sum(axis=1)
        known = count > 1
        total[known] += square[known]
        freedom[known] += count[known] - 1.0
    spread = np.divide(total, freedom, out=np.full_like(total, np.nan), where=freedom > 0)
    return channels.isel(movement=0, time=0, drop=True).copy(data=np.sqrt(spread))


def band_coverage(measured: xr.DataArray, low: xr.DataArray, high: xr.DataArray) -> xr.DataArray:
    """Return the share of measured instants inside a band, of each channel and movement.

    Parameters
    ----------
    measured, low, high : xarray.DataArray, dims (channel, movement, time)
        On the same times [N].

    Returns
    -------
    xarray.DataArray, dims (channel, movement)
        0 to 1; NaN where nothing was measured.

    Examples
    --------
    >>> values = xr.DataArray([[[0.0, 2.0, np.nan]]], dims=("channel", "movement", "time"))
    >>> one = xr.ones_like(values)
    >>> float(band_coverage(values, -one, one)[0, 0])
    0.5
    """
    known = measured.notnull()
    inside = (measured >= low) & (measured <= high) & known
    return (inside.sum("time") / known.sum("time")).where(known.any("time"))


def only_fitted(validation: xr.Dataset) -> NDArray[np.bool_]:
    """Flag movements that were used for the fit and are not predicted from other places either.

    Parameters
    ----------
    validation : xarray.Dataset
        `used` (movement), and `left_out` (movement) where places were left out.

    Examples
    --------
    >>> found = xr.Dataset({"used": ("movement", [True, True])})
    >>> only_fitted(found), only_fitted(found.assign(left_out=("movement", [True, False])))
    (array([ True,  True]), array([False,  True]))
    """
    used = np.asarray(validation["used"].values, dtype=np.bool_)
    if "left_out" not in validation:
        return used
    return used & ~np.asarray(validation["left_out"].values, dtype=np.bool_)
