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
# Place by size: slipped, slipped without an object, locked, in control, outcome.
THROWN = [
    ("complete", 0, 0, 1, 1), ("complete", 0, 0, 0, 1),
    ("complete", 1, 0, 0, 0), ("skipped", -1, -1, -1, -1),
    ("complete", 1, 1, 0, 1), ("complete", 0, 0, 1, 0),
    ("failed", -1, -1, -1, -1), ("complete", 1, 0, 0, 1),
]  # fmt: skip
ENDS = [
    "locked, in control", "not locked", "slips on the object", "not thrown",
    "slips without an object", "not in control", "failed", "slips on the object",
]  # fmt: skip


def labels() -> xr.Dataset:
    outcome, slipped, free, locked, control = (
        np.array(column) for column in zip(*THROWN, strict=True)
    )
    thrown = outcome == "complete"
    force = np.where(thrown, 1000.0 * np.arange(8), np.nan)
    return xr.Dataset(
        {
            "outcome": ("scenario", outcome),
            "slipped": ("scenario", slipped),
            "slipped_free": ("scenario", free),
            "end_locked": ("scenario", locked),
            "end_in_control": (("scenario", "sensor"), np.stack([control, thrown - 0], axis=1)),
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


def test_an_undetected_object_is_not_a_throw_without_one() -> None:
    touched = labels().assign(object_touched=("scenario", np.array([1, 1, 1, -1, 0, 1, -1, 1])))
    expected = ["undetected object", *ENDS[1:]]
    assert [STATES[state] for state in end_state(touched).values] == expected
    without = touched.assign(object_touched=("scenario", np.zeros(8, dtype=int)))
    assert [STATES[state] for state in end_state(without).values] == ENDS


def test_what_broke_and_left_nothing_is_no_undetected_object() -> None:
    touched = labels().assign(object_touched=("scenario", np.array([1, 1, 1, -1, 0, 1, -1, 1])))
    gone = touched.assign(object_trapped=("scenario", np.array([0, 1, 1, -1, 0, 1, -1, 1])))
    assert [STATES[state] for state in end_state(gone).values] == ENDS


def test_the_worst_of_a_cell_is_an_undetected_object() -> None:
    twice = xr.concat([labels(), labels()], "scenario")
    touched = np.zeros(16, dtype=int)
    touched[0] = 1
    twice = twice.assign(object_touched=("scenario", touched))
    twice["slipped_free"][8] = 1
    assert STATES[int(sweep_map(twice)["state"][0, 0])] == "undetected object"


def test_the_legend_separates_no_object_from_an_undetected_one() -> None:
    one = labels()
    one["end_in_control"][:] = 1
    one = one.assign(object_touched=("scenario", np.array([0, 1, 1, -1, 1, 1, -1, 1])))
    figure = plot_sweep_map(sweep_map(one))
    names = [text.get_text() for text in figure.legends[0].get_texts()]
    assert "locked, in control, no object trapped" in names
    assert "U  undetected object" in names
    states = figure.axes[3]
    assert "U" in [text.get_text() for text in states.texts]


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
    twice["slipped"][8] = 1
    twice["object_force_peak"][8] = 100.0
    cells = sweep_map(twice)
    assert STATES[int(cells["state"][0, 0])] == "slips on the object"
    assert float(cells["object_force_peak"][0, 0]) == 50.0
    assert int(cells["throws"][0, 0]) == 2


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
