"""Figures of a campaign, by their data; measured and simulated ones come from one function."""

import numpy as np
import pytest
import xarray as xr
from tests.unit.campaigns import copied, made

from turnout.core.errors import ResponseError
from turnout.figures.campaign import plot_overview, plot_stacked
from turnout.measurement.campaign.build_campaign import build_campaign_dataset
from turnout.metric.campaign_statistics import end_values
from turnout.throw.store import open_response


@pytest.fixture(scope="module")
def measured(tmp_path_factory: pytest.TempPathFactory) -> xr.Dataset:
    dataset = build_campaign_dataset(copied(tmp_path_factory.mktemp("plot"))).dataset
    assert dataset is not None
    return dataset


@pytest.fixture(scope="module")
def simulated() -> xr.Dataset:
    return open_response(made() / "truth.nc")


@pytest.mark.parametrize("origin", ["measured", "simulated"])
def test_a_line_for_each_size_in_each_channel(origin: str, request: pytest.FixtureRequest) -> None:
    dataset = request.getfixturevalue(origin)
    figure = plot_stacked(dataset, place="sleeper 6")
    labels = [ax.get_ylabel() for ax in figure.axes]
    assert labels == [
        "Object\nforce [kN]",
        "Drive 1\ncurrent [A]",
        "Drive 2\ncurrent [A]",
        "Drive 1\nforce [kN]",
        "Drive 2\nforce [kN]",
    ]
    names = [text.get_text() for text in figure.legends[0].get_texts()]
    assert names == ["none", "10 mm", "13 mm", "31 mm (slips)"]
    line = figure.axes[4].get_lines()[2]
    chosen = dataset.isel(movement=(dataset["size"].values == 0.013).nonzero()[0][0])
    np.testing.assert_allclose(
        np.asarray(line.get_ydata()), chosen["drive_force"].sel(drive="2") / 1e3
    )


def test_both_origins_draw_the_same_curves(measured: xr.Dataset, simulated: xr.Dataset) -> None:
    ends = [end_values(dataset["drive_force"].sel(drive="2")) for dataset in (measured, simulated)]
    np.testing.assert_allclose(ends[0], ends[1], atol=30.0)


def test_synthetic_data_says_so_in_the_title(measured: xr.Dataset) -> None:
    figure = plot_stacked(measured, place="sleeper 6")
    assert "(synthetic)" in figure.get_suptitle()
    real = measured.assign_attrs(synthetic="")
    assert "(synthetic)" not in plot_stacked(real, place="sleeper 6").get_suptitle()


def test_the_overview_writes_end_forces_and_frames_slips(measured: xr.Dataset) -> None:
    figure = plot_overview(measured)
    force, one, two = figure.axes
    assert [ax.get_title() for ax in figure.axes] == [
        "Object force [kN]",
        "Drive 1 force [kN]",
        "Drive 2 force [kN]",
    ]
    assert [text.get_text() for text in two.get_xticklabels()] == ["0", "10", "13", "31"]
    assert [text.get_text() for text in force.get_yticklabels()] == ["no object", "sleeper 6"]
    values = [text.get_text() for text in two.texts]
    assert values[-1] == "6.0"
    assert len(force.texts) == 2
    assert len(one.texts) == 4
    frames = [patch.get_xy() for patch in two.patches]
    assert frames == [(2.5, 0.5)]


def test_a_place_without_objects_is_refused_with_those_there_are(measured: xr.Dataset) -> None:
    with pytest.raises(ResponseError, match="there are sleeper 6"):
        plot_stacked(measured, place="drive 1")
    with pytest.raises(ResponseError, match="no opening movement with an object"):
        plot_stacked(measured, place="sleeper 6", direction="opening")


def test_nothing_to_draw_says_so(measured: xr.Dataset) -> None:
    bare = measured.drop_vars(["drive_force", "object_force"])
    with pytest.raises(ResponseError, match="nothing to draw"):
        plot_overview(bare)
    with pytest.raises(ResponseError, match="no forces and no currents"):
        plot_stacked(measured.drop_vars(list(measured.data_vars)), place="sleeper 6")


def test_a_slip_is_framed_only_where_something_was_measured(measured: xr.Dataset) -> None:
    slipping = measured.assign_coords(slipped=("movement", measured["size"].values >= 0.010))
    force, _, two = plot_overview(slipping).axes
    assert [len(ax.patches) for ax in (force, two)] == [2, 3]
