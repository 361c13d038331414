"""What decides over the outputs of a sweep: one table for each output."""

import json

import numpy as np
import xarray as xr

from turnout.errors import ResponseError
from turnout.metric.effects import (
    Decided,
    Output,
    first_index,
    inputs_of,
    main_effect,
    outputs_of,
)
from turnout.study.sobol import sobol_indices


def sweep_effects(labels: xr.Dataset, *, names: tuple[str, ...] | None = None) -> list[Decided]:
    """Find what decides over the outputs of a sweep.

    Parameters
    ----------
    labels : xarray.Dataset
        Of the sweep, with the dimension scenario; ``attrs["design"]`` says how it was drawn. One
        drawn by "saltelli" tells total indices too.
    names : tuple of str, optional
        Labels or features; default forces on drives and object, and residual gaps.

    Raises
    ------
    ResponseError
        When there is no such output, or nothing varies.
    """
    outputs = outputs_of(labels) if names is None else outputs_of(labels, names)
    inputs = inputs_of(labels)
    if not inputs or not outputs:
        message = "nothing to compare: no input differs between the throws of this sweep"
        raise ResponseError(message)
    return [_decided(labels, output, inputs) for output in outputs]


def _decided(labels: xr.Dataset, output: Output, inputs: list[str]) -> Decided:
    design = json.loads(labels.attrs["design"])
    effects = tuple(main_effect(labels[name], output.values) for name in inputs)
    if design["method"] != "saltelli":
        indices = tuple(first_index(labels[name], output.values) for name in inputs)
        return Decided(output=output, indices=indices, effects=effects)
    whole = np.full(design["states"] * design["cells"], np.nan)
    whole[labels["scenario"].to_numpy()] = output.values
    found = sobol_indices(whole, names=design["drawn"], draws=design["draws"])
    return Decided(output=output, indices=tuple(found), effects=effects)
