"""Scatter from repeats, verdicts, and what is written of a validation; without any simulation."""

import csv
import io
import re
from typing import Any, cast

import numpy as np
import pytest
import xarray as xr

from turnout.calibration.validation.acceptance import (
    PossibleError,
    Rules,
    judge,
    notes,
    noticed_errors,
    page_text,
    rows_of,
    table_text,
)
from turnout.calibration.validation.prediction_bands import scatter_of
from turnout.calibration.validation.validate import _noticed
from turnout.core.errors import ResponseError
from turnout.figures.validation import plot_comparison, plot_error_map

TIME = np.linspace(0.0, 3.0, 151)
CHANNELS = ["drive 1", "drive 2", "object"]


def hand_made(*, off: float = 0.0, used: int = 2, band: float = 60.0) -> xr.Dataset:
    """A validation of six movements that are `off` in Drive 2, with repeats 30 N apart."""
    rng = np.random.default_rng(1)
    base = 1e3 * np.minimum(TIME, 2.0)
    dims = ("channel", "movement", "time")
    forecast = np.tile(base, (3, 6, 1))
    measured = forecast + 30.0 * rng.standard_normal((3, 6, 1))
    measured[1] -= off
    measured[2, :2] = np.nan
    coordinates = {
        "channel": CHANNELS,
        "movement": [f"m{n}" for n in range(6)],
        "time": TIME,
        "direction": ("movement", ["closing"] * 6),
        "size": ("movement", [0.0, 0.0, 0.013, 0.029, 0.013, 0.029]),
        "place": ("movement", ["none", "none", *["sleeper 6"] * 2, *["drive 2"] * 2]),
        "slipped": ("movement", [False] * 5 + [True]),
    }
    array = xr.DataArray(measured, coordinates, dims)
    plain = array.copy(data=forecast)
    rms = np.sqrt(((plain - array) ** 2).mean("time"))
    inside = (abs(plain - array) <= band).where(array.notnull())
    pair = {
        f"{name}_{side}": xr.full_like(rms, value)
        for name, value in (("slope", 1e3), ("peak", 2e3), ("plateau", 2e3))
        for side in ("measured", "predicted")
    }
    pair |= {f"contact_{side}": xr.full_like(rms[0], 1.0) for side in ("measured", "predicted")}
    return xr.Dataset(
        {
            "measured": array,
            "predicted": plain,
            "low": plain - band,
            "high": plain + band,
            "rms": rms,
            "nrmse": rms / 2e3,
            "cover": inside.mean("time"),
            "scale": ("channel", [2e3] * 3),
            "repeat_spread": ("channel", [30.0] * 3),
            "used": ("movement", np.arange(6) < used),
            **pair,
        },
        attrs={
            "title": "hand-made",
            "noticed": "[]",
            "synthetic": "synthetic: by hand",
            "scatter": '{"chair.friction_coefficient": 0.02, "onset [s]": 0.005, "repeats": 2}',
        },
    )


def test_scatter_is_found_and_the_rest_is_noise() -> None:
    rng = np.random.default_rng(7)
    slope = np.tile(1e3 * np.sin(TIME), (2, 40, 1))
    own = 0.03 * rng.standard_normal((1, 40, 1))
    measured = 500.0 + own * slope + 4.0 * rng.standard_normal(slope.shape)
    slopes = np.array([slope, 0.0 * slope])
    found = scatter_of(
        measured, slopes, [0.02, 0.02], groups=[list(range(40))], noise=np.array([1.0, 1.0])
    )
    friction, flat = found.sizes
    assert friction == pytest.approx(np.std(own, ddof=1), rel=0.03)
    assert flat == 0.02
    assert found.freedom == pytest.approx([40.0, 1.0])
    assert found.rest == pytest.approx([4.0, 4.0], rel=0.05)
    expected = found.rest[0] ** 2 + (friction * slope[0, 0]) ** 2
    assert found.variance[0, 0] == pytest.approx(expected)


def test_without_repeats_expectations_count() -> None:
    slope = np.ones((1, 2, 5))
    found = scatter_of(slope, slope[None], [0.02], groups=[], noise=np.array([3.0]))
    assert (found.sizes[0], found.rest[0]) == (0.02, 3.0)


def test_what_noise_hides_is_no_scatter_and_what_lasts_has_a_length() -> None:
    """Of an expected 2 % that moves forces by 0.4 noises nothing is said; by 0.6 it is."""
    rng = np.random.default_rng(3)
    own = 0.1 * rng.standard_normal((1, 30, 1)) * np.ones((1, 30, 50))
    for answer, size in ((0.4, 0.02), (0.6, 0.1)):
        slope = np.full((1, 30, 50), answer / 0.02)
        found = scatter_of(
            own * slope, slope[None], [0.02], groups=[list(range(30))], noise=np.array([1.0])
        )
        assert found.sizes[0] == pytest.approx(size, rel=0.3)
    # A rest that is the same in all instants decays in as many as are told apart.
    found = scatter_of(
        5.0 * own, 0.0 * own[None], [0.02], groups=[list(range(30))], noise=np.array([0.01])
    )
    assert found.decay[0] == pytest.approx(-1.0 / np.log(49 / 50), rel=0.05)


def test_errors_of_features_are_shown_in_their_units() -> None:
    made = hand_made()
    for name, off in (("contact", 0.012), ("slope", 20.0), ("peak", -31.0), ("plateau", -0.3)):
        made[f"{name}_predicted"] = made[f"{name}_measured"] + off
    assert judge(made).channels[0].cells == ["+12 ± 0 ms", "+2 ± 0 %", "-31 ± 0 N", "+0 ± 0 N"]


def test_what_cannot_be_predicted_is_not_covered() -> None:
    """A movement of four that is not simulated leaves 75 % at most, and no error of its own."""
    made = hand_made(band=300.0)
    for name in ("predicted", "low", "high"):
        made[name][:, 5] = np.nan
    verdict = judge(made)
    assert verdict.cover == pytest.approx(0.75)
    assert verdict.channels[0].rms == pytest.approx(30.0, rel=0.7)
    assert not verdict.accepted


def unpredicted_object() -> xr.Dataset:
    """Many good movements, and one that is not simulated, in which alone the object is measured."""
    one = hand_made(band=300.0)
    more = [
        one.isel(movement=[2, 3, 4]).assign_coords(movement=[f"x{k}{n}" for n in range(3)])
        for k in range(6)
    ]
    made = xr.concat([one, *more], "movement", data_vars="minimal")
    made["measured"].loc[{"channel": "object", "movement": made["movement"] != "m5"}] = np.nan
    for name in ("predicted", "low", "high"):
        made[name].loc[{"movement": "m5"}] = np.nan
    made["rms"] = np.sqrt(((made["predicted"] - made["measured"]) ** 2).mean("time"))
    # As a validation has it: no limit is known without a band, nor a spread without repeats.
    made["repeat_spread"][2] = np.nan
    return made.assign(cover_limit=("channel", [0.85, 0.85, np.nan]))


def test_a_channel_that_is_never_predicted_refuses_the_model() -> None:
    """It was left out of the verdict, which became VALID."""
    made = unpredicted_object()
    verdict = judge(made)
    assert [item.channel for item in verdict.channels] == CHANNELS
    assert verdict.cover > 0.9
    assert verdict.reasons == ("the band of 95 % covers 0 % of object, less than 75 %",)
    page = page_text(made, verdict, figures=[])
    assert "nan" not in page
    assert "-1.0 spreads" not in page
    assert Rules.of(made).refused(rows_of(made["predicted"])).tolist() == [False, False, True]


def test_a_good_prediction_is_accepted() -> None:
    verdict = judge(hand_made())
    assert verdict.accepted
    assert verdict.text.startswith("VALID: all 3 channels of 4 movements")
    assert (verdict.judged, verdict.used) == (4, 2)
    assert [item.movements for item in verdict.channels] == [4, 4, 4]
    assert "drive 1" in verdict.lines[1]


@pytest.mark.parametrize(
    ("made", "count", "words"),
    [
        (hand_made(off=120.0, band=500.0), 1, "drive 2 is off by 1.* times the spread of repeats"),
        (hand_made(off=400.0), 2, "drive 2 is off .*mostly in level"),
        (hand_made(band=5.0), 3, "the band of 95 % covers"),
        (hand_made(used=6), 0, "NOT VALIDATED: the fit has seen every movement"),
    ],
    ids=["error beyond three spreads", "kind of the error", "band that misses", "nothing unseen"],
)
def test_a_refusal_names_its_reasons(made: xr.Dataset, count: int, words: str) -> None:
    verdict = judge(made)
    assert not verdict.accepted
    assert len(verdict.reasons) == count
    assert re.search(words, verdict.reasons[0] if count else verdict.text)


def test_the_worst_movement_is_named() -> None:
    validation = hand_made()
    validation["rms"][1, 5] = 300.0
    assert judge(validation).worst[0] == (
        "m5 (closing, 29 mm at drive 2): drive 2 off by 300 N, 10.0 spreads, mostly in level"
    )


def test_the_page_and_the_table_hold_what_was_judged() -> None:
    validation = hand_made(off=120.0)
    page = page_text(validation, judge(validation), figures=["errors.png"])
    assert "NOT VALID" in page
    assert "Synthetic: by hand." in page
    assert "from 2 repeats" in page
    rows = list(csv.DictReader(io.StringIO(table_text(validation))))
    assert len(rows) == 16
    assert [row["used"] for row in rows[:3]] == ["yes"] * 3
    assert float(rows[4]["rms [N]"]) == pytest.approx(float(validation["rms"][0, 2]), rel=1e-5)


def test_figures_show_measured_and_predicted_forces() -> None:
    validation = hand_made()
    figure = plot_comparison(validation, place="sleeper 6")
    assert len(figure.axes) == 6
    lines = {line.get_label(): line for line in figure.axes[2].lines}
    measured = lines["measured, 29 mm"].get_ydata()
    assert measured == pytest.approx(validation["measured"].values[1, 3] / 1e3)
    assert "predicted, 13 mm" in lines
    apart = validation["measured"].values[1, 3] - validation["predicted"].values[1, 3]
    assert any(line.get_ydata() == pytest.approx(apart / 1e3) for line in figure.axes[3].lines)
    with pytest.raises(ResponseError, match="no closing movement with an object at 'sleeper 9'"):
        plot_comparison(validation, place="sleeper 9")


def test_the_map_shows_errors_and_brackets_what_was_used() -> None:
    validation = hand_made(used=3)
    texts = [text.get_text() for text in plot_error_map(validation).axes[1].texts]
    rms = validation["rms"].values[1]
    none = np.sqrt(np.mean(rms[:2] ** 2))
    assert texts[0] == f"({none:.0f})"
    assert texts[1] == f"({rms[2]:.0f})"
    assert texts[2] == f"{rms[3]:.0f}"


def test_the_kind_of_each_movement_is_named_where_they_differ() -> None:
    """Three movements come 0.1 s late, one is 20 % too high: no shift or factor is of all four."""
    made = hand_made()
    made["measured"][1, 2:5] = made["predicted"][1, 2:5].shift(time=5, fill_value=0.0)
    made["measured"][1, 5] = 1.2 * made["predicted"][1, 5]
    made["rms"][1] = np.sqrt(((made["measured"] - made["predicted"])[1] ** 2).mean("time"))
    verdict = judge(made)
    (result,) = [item for item in verdict.channels if item.channel == "drive 2"]
    assert result.kinds == {"timing": 3, "level": 1}
    assert "in timing in 3 movements, in level in 1 movement" in verdict.text
    assert verdict.worst[0].endswith("mostly in level")
    assert verdict.worst[1].endswith("mostly in timing")


def test_the_band_of_each_channel_is_judged_and_the_one_that_fails_is_named() -> None:
    """Pooled, 250 of 3 x 250 instants outside are 33 %; at 20 % nothing would be refused."""
    made = hand_made(band=300.0)
    made["high"][0, 2:, ::2] = made["low"][0, 2:, ::2]
    limits = {
        "cover_limit": ("channel", [0.85, 0.85, 0.5]),
        "cover_samples": ("channel", [20.0] * 3),
    }
    verdict = judge(made.assign(limits))
    assert verdict.cover > 0.8
    (reason,) = verdict.reasons
    assert reason.startswith("the band of 95 % covers 50 % of drive 1, less than 85 %, ")
    assert not verdict.accepted
    assert verdict.remarks == (
        "bands hardly judged: object; in so few movements a right model may by chance cover no "
        "more than 50 %, measure more",
    )
    # Whatever chance may do, three quarters are wanted.
    loose = {"cover_limit": ("channel", [0.4] * 3), "cover_samples": ("channel", [4.0] * 3)}
    (reason,) = judge(made.assign(loose)).reasons
    assert "less than 75 %" in reason


def noticed(*, bend: float = 0.0, lost: str = "", unchecked: str = "") -> dict[str, str]:
    """Return what a verdict on four movements would notice, by the name of the error.

    Of a value that moves a level by 1 kN, and by `bend` [N] times the square; throws upwards fail
    with `lost`.
    """
    part = hand_made(band=300.0).isel(movement=slice(2, None))
    base = rows_of(part["predicted"])
    # One value moves the level of drive 1, one nothing, and a length that level.
    first = np.zeros_like(base)
    first[0] = 1000.0

    def throw(wrong: list[tuple[str, float]]) -> list[np.ndarray | str]:
        # Of a value that no slope shows to be noticed nothing is thrown.
        assert "drive.2.nothing" not in dict(wrong)
        found: list[np.ndarray | str] = []
        for name, off in wrong:
            if lost and off > 0:
                found.append(lost)
            elif name == "drive.1.level":
                found.append(base + (off + bend / 1000.0 * off * abs(off)) * first)
            else:
                found.append(base + 10.0 * off * first)
        return found

    errors = [
        PossibleError(name="drive.1.level", change=first, largest=0.5, unchecked=unchecked),
        PossibleError(name="drive.2.nothing", change=0.0 * first, largest=0.5),
        PossibleError(name="rail.straight.length", change=10.0 * first, largest=1e-2, unit="m"),
        PossibleError(name="onset", change=first, largest=0.015, unit="s"),
    ]
    channels = part["channel"].values.tolist()
    lines = noticed_errors(Rules.of(part), base, errors, channels, throw=throw)
    return dict(zip((item.name for item in errors), lines, strict=True))


def test_a_verdict_says_what_it_would_notice() -> None:
    """A spread of 30 N, and 1,000 N for all of a value: three times 30 N are 9 %."""
    found = noticed()
    text = found["drive.1.level"]
    assert text.endswith("(level of drive 1)")
    assert 7.0 < float(text.split()[3]) < 11.0
    assert found["drive.2.nothing"] == "drive.2.nothing: not noticed, tried up to 50 %"
    # 10 kN/m: 90 N are 9 mm.
    assert "mm" in found["rail.straight.length"]
    assert 7.0 < float(found["rail.straight.length"].split()[3]) < 11.0
    # A lead beyond 15 ms is taken off.
    assert found["onset"] == "onset: not noticed, tried up to 15 ms"


def test_what_is_noticed_follows_the_bend() -> None:
    """90 N of 1,000 a - 2,000 a^2 are 11.8 %, of both signs the one that takes more."""
    plain, bent = (float(noticed(bend=b)["drive.1.level"].split()[3]) for b in (0.0, -2000.0))
    reached = 1000.0 * plain / 100.0
    exact = 100.0 * (1.0 - np.sqrt(1.0 - 8.0 * reached / 1000.0)) / 4.0
    # Amounts are tried in steps of a tenth.
    assert bent == pytest.approx(exact, rel=0.12)
    assert bent > 1.15 * plain


def test_a_value_whose_throw_fails_is_said_not_to_be_checked() -> None:
    """The slope alone was used without a word: it states too little."""
    stopped = "m5.csv: must be at most 0.4"
    expected = f"drive.1.level: not checked by a throw: {stopped}"
    assert noticed(lost=stopped)["drive.1.level"] == expected
    # So is one whose slope was not thrown.
    assert noticed(unchecked=stopped)["drive.1.level"] == expected


def test_a_verdict_passes_on_what_the_throws_said() -> None:
    made = hand_made().assign_attrs(noticed='["k off by 3 % (level of drive 1)"]')
    verdict = judge(made)
    assert verdict.power == ("k off by 3 % (level of drive 1)",)
    assert any(line.startswith("would notice  k off by 3 %") for line in verdict.lines)
    assert "would notice" in page_text(made, verdict, figures=[])
    assert judge(hand_made()).power == ()
    assert notes(hand_made()) == []


def test_a_validation_of_an_older_version_is_said_not_to_tell_what_it_notices() -> None:
    made = hand_made()
    del made.attrs["noticed"]
    (found,) = notes(made)
    assert found == "made by an older version: validate again to see what would be noticed"


def test_nothing_is_thrown_for_a_model_that_is_refused_already() -> None:
    none = cast("Any", None)
    assert _noticed(hand_made(band=5.0), none, none, None) == []
