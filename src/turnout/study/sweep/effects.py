"""Sensitivities of a sweep, one table for each output.

Main effects and first-order Sobol indices need no special design; total indices with confidence
intervals need the design "saltelli".
"""

import json
import warnings
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
import xarray as xr

from turnout.core.errors import FileError, ResponseError
from turnout.metric.sensitivity import (
    RESAMPLES,
    NumericOutput,
    OutputEffects,
    SobolIndex,
    first_order_index,
    main_effect,
    numeric_outputs,
    varying_inputs,
)

FloatArray = npt.NDArray[np.float64]
FEWEST_BLOCKS = 8


def sobol_indices(
    output: FloatArray, *, names: Sequence[str], draws: int, seed: int = 0
) -> list[SobolIndex]:
    """Estimate first and total indices from a sweep with the method "saltelli".

    A block of throws counts if all of them came to an end; throws with the same draws on other
    values of the axes are averaged.

    Parameters
    ----------
    output : ndarray, shape (draws * (n_names + 2) * n_cells,)
        One number a scenario, in their order; NaN where a throw has none.
    names : sequence of str
        Drawn variables, in the order of the design.
    draws : int
        Count of the study's table [sampling].
    seed : int
        Of the resampling behind the intervals.

    Returns
    -------
    list of Index
        One a drawn variable, with 95 % intervals.

    Raises
    ------
    ResponseError
        When too few blocks are whole.
    FileError
        When SALib is not installed.
    """
    rows = len(names) + 2
    blocks = output.reshape(draws, rows, -1).mean(axis=2)
    whole = blocks[~np.isnan(blocks).any(axis=1)]
    if whole.shape[0] < FEWEST_BLOCKS:
        message = (
            f"Sobol indices need at least {FEWEST_BLOCKS} whole blocks of {rows} throws, "
            f"this sweep has {whole.shape[0]}; let it run on, or narrow what makes throws fail"
        )
        raise ResponseError(message)
    if np.ptp(whole) == 0.0:
        none = {"first": 0.0, "first_confidence": 0.0, "total": 0.0, "total_confidence": 0.0}
        return [SobolIndex(name=name, **none) for name in names]
    found = _analyse(names, whole.ravel(), seed)
    return [
        SobolIndex(
            name=name,
            first=float(found["S1"][number]),
            first_confidence=float(found["S1_conf"][number]),
            total=float(found["ST"][number]),
            total_confidence=float(found["ST_conf"][number]),
        )
        for number, name in enumerate(names)
    ]


def _analyse(names: Sequence[str], output: FloatArray, seed: int) -> Any:
    """Hand throws in the order of Saltelli's design to SALib."""
    try:
        # SALib makes its own use of names that newer versions of its dependencies dislike.
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            from SALib.analyze import sobol
    except ImportError:
        message = 'Sobol indices need SALib; install it with: pip install "turnout[uq]"'
        raise FileError(message) from None
    problem = {"num_vars": len(names), "names": list(names), "bounds": [[0.0, 1.0]] * len(names)}
    return sobol.analyze(
        problem, output, calc_second_order=False, num_resamples=RESAMPLES, seed=seed
    )


def sweep_effects(
    labels: xr.Dataset, *, names: tuple[str, ...] | None = None
) -> list[OutputEffects]:
    """Find the sensitivity of the outputs of a sweep to its inputs.

    Parameters
    ----------
    labels : xarray.Dataset
        Of the sweep, with the dimension scenario; ``attrs["design"]`` says how it was drawn. One
        drawn by "saltelli" gives total indices too.
    names : tuple of str, optional
        Labels or features; default forces on drives and object, and residual gaps.

    Raises
    ------
    ResponseError
        When there is no such output, or nothing varies.
    """
    outputs = numeric_outputs(labels) if names is None else numeric_outputs(labels, names)
    inputs = varying_inputs(labels)
    if not inputs or not outputs:
        message = "nothing to compare: no input differs between the throws of this sweep"
        raise ResponseError(message)
    return [_output_effects(labels, output, inputs) for output in outputs]


def _output_effects(labels: xr.Dataset, output: NumericOutput, inputs: list[str]) -> OutputEffects:
    design = json.loads(labels.attrs["design"])
    effects = tuple(main_effect(labels[name], output.values) for name in inputs)
    if design["method"] != "saltelli":
        indices = tuple(first_order_index(labels[name], output.values) for name in inputs)
        return OutputEffects(output=output, indices=indices, effects=effects)
    whole = np.full(design["states"] * design["cells"], np.nan)
    whole[labels["scenario"].to_numpy()] = output.values
    found = sobol_indices(whole, names=design["drawn"], draws=design["draws"])
    return OutputEffects(output=output, indices=tuple(found), effects=effects)
