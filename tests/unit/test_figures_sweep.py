"""Maps and effects of a small sweep, by their data."""

import json

import numpy as np
import pytest
import xarray as xr
from matplotlib.figure import Figure

from turnout.core.errors import ResponseError
from turnout.figures.style import rendered
from turnout.figures.sweep import (
    STATE_LETTERS,
    plot_indices,
    plot_sweep_effects,
    plot_sweep_map,
)
from turnout.metric.sensitivity import NumericOutput, OutputEffects, SobolIndex
from turnout.metric.sweep_map import STATES, end_state, sweep_map
from turnout.study.sweep.effects import sweep_effects

PLACES, SIZES = ("drive 1", "sleeper 6"), (0.0, 0.005, 0.013, 0.031)
ENDS = [
    "sound", "not locked", "detected by slip", "not thrown",
    "not sound", "detected by TKK", "failed", "detected by switch-off",
]  # fmt: skip
OUTCOMES = {"failed": "failed", "not thrown": "skipped"}


def labels() -> xr.Dataset:
    outcome = np.array([OUTCOMES.get(end, "complete") for end in ENDS])
    kinds = [-1 if end in OUTCOMES else STATES.index(end) for end in ENDS]
    thrown = outcome == "complete"
    force = np.where(thrown, 1000.0 * np.arange(8), np.nan)
    return xr.Dataset(
        {
            "outcome": ("scenario", outcome),
            "verdict": ("scenario", np.array(kinds)),
            "peak_force": (
                ("scenario", "drive", "direction"),
                np.stack([np.stack([0 * force, force], 1), np.stack([force, 0.5 * force], 1)], 1),
                {"units": "N"},
            ),
            "object_force_peak": ("scenario", force, {"units": "N"}),
            "end_gap": (("scenario", "drive"), 1e-6 * np.stack([force, force], 1), {"units": "m"}),
        },
        {
            "scenario": np.arange(8),
            "drive": ["1", "2"],
            "direction": ["opening", "closing"],
            "object.at": ("scenario", np.repeat(PLACES, 4), {"input": "1", "units": "1"}),
            "object.size": ("scenario", np.tile(SIZES, 2), {"input": "1", "units": "m"}),
        },
        {
            "name": "test",
            "design": json.dumps({"method": "random", "draws": 1, "states": 1, "cells": 8}),
        },
    )


def test_each_throw_has_the_end_that_it_had() -> None:
    assert [STATES[state] for state in end_state(labels()).values] == ENDS


def test_the_worst_of_a_cell_is_an_undetected_object() -> None:
    twice = xr.concat([labels(), labels()], "scenario")
    twice["verdict"][0] = STATES.index("undetected object")
    twice["verdict"][8] = STATES.index("detected by slip")
    assert STATES[int(sweep_map(twice)["state"][0, 0])] == "undetected object"
    figure = plot_sweep_map(sweep_map(twice))
    names = [text.get_text() for text in figure.legends[0].get_texts()]
    assert "U  undetected object" in names
    assert "U" in [text.get_text() for text in figure.axes[3].texts]


def test_a_sweep_without_verdicts_is_refused() -> None:
    with pytest.raises(ResponseError, match="has no verdicts, it was made by an older version"):
        end_state(labels().drop_vars("verdict"))


def test_the_map_has_place_by_size_and_the_largest_drive() -> None:
    cells = sweep_map(labels())
    assert cells["x"].values.tolist() == list(SIZES)
    assert cells["y"].values.tolist() == list(PLACES)
    # Drive 1 has the whole force on closing, drive 2 has it on opening only.
    expected = [[0.0, 1000.0, 2000.0, np.nan], [4000.0, 5000.0, np.nan, 7000.0]]
    np.testing.assert_array_equal(cells["peak_force"].values, expected)
    assert cells["throws"].values.tolist() == [[1, 1, 1, 0], [1, 1, 0, 1]]
    assert cells.attrs["skipped"] == 1


def test_a_cell_of_several_throws_shows_the_worst_end_and_the_middle_force() -> None:
    twice = xr.concat([labels(), labels()], "scenario")
    twice["verdict"][8] = STATES.index("detected by slip")
    twice["object_force_peak"][8] = 100.0
    cells = sweep_map(twice)
    assert STATES[int(cells["state"][0, 0])] == "detected by slip"
    assert float(cells["object_force_peak"][0, 0]) == 50.0
    assert int(cells["throws"][0, 0]) == 2


def test_the_least_gauge_of_a_cell_is_shown_where_it_was_stored() -> None:
    twice = xr.concat([labels(), labels()], "scenario")
    gauge = np.full(twice.sizes["scenario"], 1.43)
    gauge[0] = 1.4221
    cells = sweep_map(twice.assign(least_gauge=("scenario", gauge)))
    assert float(cells["least_gauge"][0, 0]) == 1.4221
    figure = plot_sweep_map(cells)
    assert [text.get_text() for text in figure.axes[3].texts][:2] == ["1422.1", "1430.0"]
    assert "least_gauge" not in sweep_map(labels())


def test_an_input_of_many_values_is_shown_in_classes() -> None:
    many = xr.concat([labels()] * 10, "scenario")
    many["object.size"] = ("scenario", np.linspace(0.001, 0.031, 80), {"units": "m"})
    cells = sweep_map(many)
    assert cells.sizes["x"] == 12
    assert int(cells["throws"].sum()) == 60


def test_an_unknown_input_is_reported() -> None:
    with pytest.raises(ResponseError, match="no input 'mu' in this sweep; there are object.at"):
        sweep_map(labels(), x="mu")


def test_the_figure_writes_the_letter_of_each_end() -> None:
    figure = plot_sweep_map(sweep_map(labels()))
    effort, _, _, states = figure.axes[:4]
    written = [text.get_text() for text in states.texts]
    assert sorted(written) == sorted(
        STATE_LETTERS[STATES.index(end)] for end in ENDS if STATE_LETTERS[STATES.index(end)]
    )
    assert [text.get_text() for text in effort.texts] == ["0.0", "1.0", "2.0", "4.0", "5.0", "7.0"]
    assert [tick.get_text() for tick in states.get_xticklabels()] == ["0", "5", "13", "31"]
    assert rendered(figure, ".png").startswith(b"\x89PNG")


def test_effects_draw_a_bar_for_each_input() -> None:
    found = sweep_effects(labels(), names=("object_force_peak",))
    figure = plot_sweep_effects(found, title="test")
    bars, first, _ = figure.axes
    assert [tick.get_text() for tick in bars.get_yticklabels()] == ["object.at", "object.size"]
    widths = [bar.get_width() for bar in bars.patches]
    assert widths == pytest.approx([index.first for index in found[0].indices])
    assert first.lines


def test_no_sensitivity_is_written_instead_of_empty_bars() -> None:
    size = SobolIndex(name="object.size", first=float("nan"), first_confidence=0.0)
    output = NumericOutput(name="end_gap", units="m", values=np.zeros(3))
    ax = Figure().subplots()
    plot_indices(OutputEffects(output=output, indices=(size,), effects=()), ax=ax)
    assert "no sensitivity" in " ".join(text.get_text() for text in ax.texts)
