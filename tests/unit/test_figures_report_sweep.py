"""The page about a sweep, from labels made by hand."""

import json
import re

import numpy as np
import pytest
import xarray as xr

from turnout.core.errors import ResponseError
from turnout.figures.report.page import page_html
from turnout.figures.report.sweep import sweep_figures, sweep_findings, sweep_page
from turnout.study.sweep.effects import sweep_effects
from turnout.throw.verdict import KINDS

PLACES, SIZES, FRICTION = ("drive 1", "sleeper 6"), (0.005, 0.013, 0.031), (0.2, 0.3, 0.4, 0.5)


def labels() -> xr.Dataset:
    """Return a full factorial: force grows with size and friction, 31 mm slips, 5 mm is missed."""
    at, size, friction = (
        axis.ravel() for axis in np.meshgrid([0, 1], SIZES, FRICTION, indexing="ij")
    )
    count = size.size
    failed = np.arange(count) == 3
    force = np.where(failed, np.nan, 1e5 * size + 8e3 * friction)
    kinds = np.where(size > 0.03, KINDS.index("detected by slip"), KINDS.index("undetected object"))
    return xr.Dataset(
        {
            "outcome": ("scenario", np.where(failed, "failed", "complete")),
            "verdict": ("scenario", np.where(failed, -1, kinds)),
            "object_touched": ("scenario", np.where(failed, -1, 1)),
            "peak_force": (
                ("scenario", "drive", "direction"),
                np.stack([np.stack([0 * force, force], 1)] * 2, 1),
                {"units": "N"},
            ),
        },
        {
            "scenario": np.arange(count),
            "drive": ["1", "2"],
            "direction": ["opening", "closing"],
            "object.at": ("scenario", np.array(PLACES)[at], {"input": "1", "units": "1"}),
            "object.size": ("scenario", size, {"input": "1", "units": "m"}),
            "chair.friction_coefficient": ("scenario", friction, {"input": "1", "units": "1"}),
        },
        {
            "name": "by hand <1>",
            "missing": 2,
            "design": json.dumps({"method": "random", "draws": 1, "states": 1, "cells": count}),
        },
    )


def test_the_headline_counts_objects_that_nothing_notices() -> None:
    first, *others = sweep_findings(labels())
    # Of 24 throws one failed; 8 of the other 23 slipped on 31 mm.
    ended = "throws that touch an object pass all checks with it in the switch"
    assert first.detail == f"15 of 23 {ended}"
    assert (first.level, first.answer) == ("bad", "65.2 % of touched objects")
    reported = {item.question: item.answer for item in others}
    assert reported["Detected by slip"] == "34.8 %"
    assert reported["Failed"] == "4.17 %"
    assert reported["Not thrown yet"] == "2"


def test_an_object_that_is_gone_is_not_counted_as_undetected() -> None:
    made = labels()
    trapped = made["object_touched"].values.copy()
    trapped[0] = 0
    made["verdict"][0] = KINDS.index("sound")
    first, *_ = sweep_findings(made.assign(object_trapped=("scenario", trapped)))
    assert first.detail.startswith("14 of 23 throws")
    assert first.detail.endswith("; in 1 of them the object is gone at the end")


def test_without_objects_the_headline_says_so() -> None:
    free = labels().assign(object_touched=("scenario", np.zeros(24, dtype=int)))
    assert sweep_findings(free)[0].answer == "No object touched"


def test_places_against_sizes_hold_medians_and_frame_slips() -> None:
    page = sweep_page(labels(), suffixes=())
    section = next(s for s in page.sections if s.heading == "Places against sizes")
    (heat,) = section.heats
    assert (heat.rows, heat.columns) == (list(PLACES), ["5", "13", "31"])
    assert heat.values[1][1] == pytest.approx(1.3 + 8 * 0.35)
    assert heat.framed == [[False, False, True]] * 2
    assert section.tables[0].rows[0][3] == "detected by slip"


def test_what_decides_is_drawn_with_its_interval() -> None:
    page = sweep_page(labels(), decided=sweep_effects(labels()), suffixes=())
    section = next(s for s in page.sections if s.heading == "Sensitivity")
    assert section.tables[0].columns == ("Input", "First", "Total")
    sheet = next(p.sheet for p in section.pictures if p.sheet.name.endswith("object.size"))
    assert sheet.x_label == "Object size [mm]"
    np.testing.assert_allclose(sheet.rows[0].lines[0].x, [5, 13, 31])
    mean = labels()["peak_force"].sel(direction="closing", drive="1").groupby("object.size").mean()
    np.testing.assert_allclose(sheet.rows[0].lines[0].y, mean / 1e3)


def test_a_sweep_that_does_not_tell_how_throws_ended_is_refused() -> None:
    with pytest.raises(ResponseError, match="has no verdict"):
        sweep_page(labels().drop_vars("verdict"))
    older = sweep_findings(labels().drop_vars("verdict"))
    assert [item.question for item in older] == ["Not thrown yet"]


def test_the_page_is_whole_and_names_no_address() -> None:
    html = page_html(sweep_page(labels(), decided=sweep_effects(labels())))
    assert "Sweep by hand &lt;1&gt;" in html
    assert "Synthetic: simulated" in html
    assert set(re.findall(r"https?://[\w.-]+", html)) <= {"http://www.w3.org"}
    assert sweep_figures(labels(), suffixes=(".svg",))["map.svg"].startswith(b"<?xml")
    assert sweep_figures(labels().drop_vars("object.at"), suffixes=(".svg",)) == {}
