"""The public interface: names, stubs, what they cost to load, and results that show themselves."""

import re
from collections.abc import Callable
from functools import cache
from importlib import import_module
from itertools import pairwise
from pathlib import Path
from types import ModuleType
from typing import Any

import matplotlib
import numpy as np
import pytest
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from tests.faults.terminal import run_code
from tests.unit.calibrations import calibration
from tests.unit.campaigns import copied, made
from tests.unit.simulated import sb1_dataset, sb1_panel, sb2_dataset
from tests.unit.sweeps import study_file

import turnout
import turnout.figures
from turnout.api.stub import PACKAGES, stub_path, stub_text

matplotlib.use("Agg")


@pytest.mark.parametrize("package", PACKAGES)
def test_every_name_loads_and_is_in_the_stub(package: str) -> None:
    module = import_module(package)
    for name in module.__all__:
        assert isinstance(getattr(module, name), ModuleType) == (name in ("figures", "detection"))
    assert dir(module) == sorted(module.__all__)
    assert stub_path(package).read_text(encoding="utf-8") == stub_text(package), (
        "run: python -m turnout.api.stub"
    )


def test_importing_loads_nothing_of_the_rest() -> None:
    reported = run_code(
        "import sys\nbefore = set(sys.modules)\nimport turnout\n"
        "print(*sorted(n for n in set(sys.modules) - before if n.startswith('turnout')))\n"
        "print(*{'typing', 'numpy', 'xarray', 'pydantic', 'matplotlib', 'numba'}"
        " & (set(sys.modules) - before))"
    )
    assert reported.splitlines() == ["turnout turnout.core turnout.core.lazy", ""]


def run_file(folder: Path) -> Path:
    turnout.save_response(sb1_dataset(), folder / "run.nc")
    return folder / "run.nc"


def recording(folder: Path, *, smooth: object) -> xr.Dataset:
    campaign = copied(folder)
    file = sorted(campaign.glob("none_closing_1.*"))[0]
    assert turnout.read_recording(file).channels
    return turnout.import_recording(file, channels=campaign / "channels.toml", smooth=smooth)


def load_known(folder: Path, panel: object) -> object:
    calibration().save(folder / "known.toml")
    return turnout.load_calibration(folder / "known.toml", panel=panel)


BAD: dict[type[Exception], dict[str, Callable[[Path], object]]] = {
    turnout.FileError: {
        "smooth = 0: must be more than 0": lambda folder: recording(folder, smooth=0),
        "run.nc: holds one run, not a campaign": lambda f: turnout.load_campaign(run_file(f)),
        "give its panel too": lambda folder: turnout.build_campaign(folder, places=["drive 1"]),
    },
    turnout.MeasurementError: {
        "(?s)sizes: '13': has no unit.*places: 'sleper 6'": lambda folder: turnout.build_campaign(
            folder, panel=sb1_panel(), sizes=["13"], places=["sleper 6"]
        ),
        "takes what load_campaign": lambda _: turnout.calibrate(sb1_dataset(), sb1_panel()),
        "takes what calibrate": lambda _: turnout.validate(small_campaign(), "known.toml"),
    },
    turnout.PanelError: {
        "calibrate.*\n.*panel = 'sb1': takes a panel from load_panel": (
            lambda _: turnout.calibrate(small_campaign(), "sb1")
        ),
        "build_campaign.*\n.*takes a panel from load_panel": (
            lambda folder: turnout.build_campaign(folder, panel="sb1")
        ),
        "load_calibration.*\n.*takes a panel from load_panel": lambda folder: load_known(
            folder, "sb1"
        ),
    },
    turnout.ResponseError: {
        r"takes a panel from load_panel\(\), not str": lambda _: turnout.simulate("sb1"),
        "interval = '1 ms': must be a number": lambda _: turnout.Save(interval="1 ms"),
        "scheme = '1 ms' must be a Scheme": lambda _: turnout.simulate(sb1_panel(), scheme="1 ms"),
        "save = '1 ms' must be a Save": lambda _: turnout.simulate(sb1_panel(), save="1 ms"),
        "mode = 'quick' and a scheme exclude": (
            lambda _: turnout.simulate(sb1_panel(), mode="quick", scheme=turnout.Scheme())
        ),
        "nothing to draw: the dataset has no energy": (
            lambda _: turnout.figures.plot_energy(sb2_dataset()[["drive_force"]])
        ),
    },
    turnout.SolverError: {
        "mode = 'fast': allowed are waveform, quick": (
            lambda _: turnout.simulate(sb1_panel(), mode="fast")
        ),
    },
    turnout.StudyError: {
        "takes a study from load_study": lambda f: turnout.run_sweep(3, out=f / "out"),
    },
}


@pytest.mark.parametrize(
    ("error", "words"), [(error, words) for error, cases in BAD.items() for words in cases]
)
def test_bad_input_is_refused_with_the_remedy(
    error: type[Exception], words: str, tmp_path: Path
) -> None:
    with pytest.raises(error, match=words):
        BAD[error][words](tmp_path)


def test_an_unknown_name_is_reported_with_the_nearest() -> None:
    with pytest.raises(AttributeError, match="nearest is 'simulate'"):
        turnout.simulat  # type: ignore[attr-defined]  # noqa: B018


@pytest.mark.parametrize("given", ["13mm@sleeper6", 0.013, ["13mm@sleeper6"], {"size": 0.013}])
def test_what_is_no_foreign_object(given: Any) -> None:
    with pytest.raises(turnout.TurnoutError, match=r"foreign_object: .*takes a ForeignObject"):
        turnout.simulate(sb1_panel(), foreign_object=given)


@pytest.mark.parametrize("given", [3, None, 1.5, b"sb1"])
def test_what_is_no_panel_name(given: Any) -> None:
    with pytest.raises(turnout.FileError, match=r"load_panel\(\) takes the name .*'sb1'"):
        turnout.load_panel(given)


# --- panels and objects


def test_a_panel_tells_its_hash_and_is_a_table_without_markup() -> None:
    panel = turnout.load_panel("sb1")
    shown = repr(panel)  # before anything has used the hash
    assert shown == f"LoadedPanel('sb1', hash='{panel.hash[:12]}')"
    assert panel.hash[:12] in panel._repr_html_()
    assert {"drive", "with_overrides", "hash"} <= set(dir(panel))
    assert len(dir(panel)) < 50
    named = panel.with_overrides({"description": "<script>alert(1)</script>"})
    assert "<script" not in named._repr_html_()


@pytest.mark.parametrize("size", [13, 5.0, 1.0, "13 m"])
def test_a_size_in_millimetres_is_asked_about(size: object) -> None:
    with pytest.raises(turnout.PanelError, match='metres[?].* write 0.0.* or "[0-9]+ mm"'):
        turnout.ForeignObject(size=size, at="sleeper 6")  # type: ignore[arg-type]


# --- one throw


def test_simulate_takes_a_mode() -> None:
    quick = turnout.simulate(sb1_panel(), mode="quick")
    assert (quick.attrs["mode"], quick.attrs["step"]) == ("quick", 4e-3)
    same = turnout.simulate(sb1_panel(), scheme=turnout.Scheme.of("quick"))
    np.testing.assert_array_equal(quick["drive_force"], same["drive_force"])
    assert sb1_dataset().attrs["mode"] == "waveform"


def test_written_datasets_keep_to_cf(tmp_path: Path) -> None:
    dataset = sb1_dataset()
    assert dataset.attrs["Conventions"] == "CF-1.11"
    assert dataset["time"].attrs["axis"] == "T"
    modes = turnout.modes(sb1_panel(), count=1)
    for number, item in enumerate((dataset, modes)):
        turnout.save_response(item, tmp_path / f"{number}.nc")
        with xr.open_dataset(tmp_path / f"{number}.nc", decode_times=False) as plain:
            assert plain.attrs["Conventions"] == "CF-1.11"


def test_features_are_those_of_the_accessor() -> None:
    xr.testing.assert_identical(turnout.features(sb1_dataset()), sb1_dataset().turnout.features())


# --- the accessor


def test_the_accessor_is_there_with_the_first_dataset(tmp_path: Path) -> None:
    given = repr(str(run_file(tmp_path)))
    text = (
        "import sys, turnout\nturnout.load_panel('sb1')\nprint('xarray' in sys.modules)\n"
        f"print(turnout.open_response({given}).turnout.summary())"
    )
    needed, summary = run_code(text).split("\n", 1)
    assert needed == "False", "a panel needs no xarray"
    assert summary.startswith("sb1")
    text = (
        "import xarray, turnout\n"
        f"print(xarray.open_dataset({given}, decode_times=False).turnout.verdict().kind)"
    )
    assert run_code(text).strip()


def test_the_accessor_sums_up_a_run() -> None:
    found = sb2_dataset().turnout
    assert repr(found) == repr(found.summary())
    assert "13 mm at sleeper 6" in repr(found)
    assert "<img" in found._repr_html_()
    assert isinstance(found.plot(), Figure)
    assert found.verdict().kind == "detected by TKK" or found.verdict().text
    assert dir(found) == ["features", "plot", "summary", "verdict"]


def test_the_accessor_draws_campaigns_and_modes() -> None:
    campaign = turnout.open_response(made() / "truth.nc")
    assert isinstance(campaign.turnout.plot(), Figure)
    assert len(campaign.turnout.plot(place="sleeper 6").axes) == 5
    assert isinstance(turnout.modes(sb1_panel(), count=1).turnout.plot(), Figure)


# --- measurements


def test_read_and_import_recording(tmp_path: Path) -> None:
    measured = recording(tmp_path, smooth="100 ms")
    assert {"drive_force", "drive_force_unfiltered"} <= set(measured.data_vars)


@cache
def small_campaign() -> turnout.Campaign:
    return turnout.load_campaign(made())


def test_a_campaign_is_loaded_from_its_folder_and_its_file(tmp_path: Path) -> None:
    campaign = small_campaign()
    assert campaign["drive_force"].dims == ("movement", "drive", "time")
    assert len(campaign.table) == campaign.dataset.sizes["movement"]
    campaign.save(tmp_path / "campaign.nc")
    again = turnout.load_campaign(tmp_path / "campaign.nc")
    xr.testing.assert_identical(again.dataset, campaign.dataset)
    html = again._repr_html_()
    assert "sleeper 6" in html
    assert "<script" not in html
    assert "movements" in repr(again)
    assert isinstance(again.plot(place="sleeper 6"), Figure)


# --- calibration and validation

DRIVES = [f"drive.{n}.{what}" for n in "12" for what in ("stiffness", "saturation_force")]


@pytest.fixture(scope="module")
def fitted(
    tmp_path_factory: pytest.TempPathFactory,
) -> tuple[turnout.Campaign, turnout.CalibrationResult]:
    """A virtual campaign of a few throws, and the friction that fits it."""
    folder = tmp_path_factory.mktemp("public") / "campaign"
    panel = turnout.load_panel("sb1")
    campaign = turnout.build_campaign(
        folder, panel=panel, places=["drive 1"], sizes=[0.013], object_free=3, mode="quick"
    )
    assert turnout.load_campaign(folder / "campaign.nc").dataset.sizes["movement"] == 7
    dry = panel.with_overrides({"chair.friction_coefficient": 0.3})
    return campaign, turnout.calibrate(campaign, dry, fix=DRIVES, most=3, mode="quick")


def test_calibrate_finds_the_friction_that_was_thrown(
    fitted: tuple[turnout.Campaign, turnout.CalibrationResult], tmp_path: Path
) -> None:
    _, found = fitted
    truth = turnout.load_panel("sb1").chair["1"].friction_coefficient
    low, high = found.intervals["chair.friction_coefficient"]
    assert low < found.values["chair.friction_coefficient"] < high
    assert found.values["chair.friction_coefficient"] == pytest.approx(truth, rel=0.05)
    assert found.panel.chair["1"].friction_coefficient == pytest.approx(truth, rel=0.05)
    assert found.table.loc["chair.friction_coefficient", "state"] == "fitted"
    assert isinstance(found.plot(), Axes)
    assert found.sweeps
    found.save(tmp_path / "calibration.toml")
    again = turnout.load_calibration(tmp_path / "calibration.toml", panel=found.before)
    assert again.values == found.values
    assert again.panel.hash == found.panel.hash


def test_validate_judges_what_the_fit_has_not_seen(
    fitted: tuple[turnout.Campaign, turnout.CalibrationResult], tmp_path: Path
) -> None:
    campaign, found = fitted
    reported: list[tuple[int, int]] = []
    checked = turnout.validate(campaign, found, report=lambda *now: reported.append(now))
    # Those that predict, then where the model is accepted those that check; each to its end.
    ends = [now for now, after in pairwise([*reported, (0, 0)]) if after[0] <= now[0]]
    assert len(ends) == (1 if checked.verdict.reasons else 2), reported
    assert all(done == total for done, total in ends)
    assert checked.accepted == checked.text.startswith("VALID")
    assert set(checked.table.index) >= {"drive 1", "drive 2"}
    assert "<script" not in checked._repr_html_()
    assert isinstance(checked.plot(), Figure)
    assert len(repr(checked.dataset.turnout.summary()).splitlines()) > 1
    checked.save(tmp_path / "validation.nc")
    assert turnout.open_response(tmp_path / "validation.nc").attrs["kind"] == "validation"


def test_a_calibration_is_a_small_table_without_markup() -> None:
    found = turnout.CalibrationResult(record=calibration(), before=turnout.load_panel("sb1"))
    html = found._repr_html_()
    assert "Autumn &lt;1&gt;" in html
    assert "<script" not in html
    assert found.trusted
    assert found.warnings == ("Drive 2 is at its bound",)
    other = turnout.CalibrationResult(record=calibration(), before=sb1_panel())
    assert "not of sb1 with hash" in other.warnings[-1]
    assert repr(found).startswith("<CalibrationResult sb1 calibrated to Autumn")
    ticks = [text.get_text() for text in found.plot().get_yticklabels()]
    assert ticks == ["chair.friction_coefficient", "drive.1.stiffness"]


# --- sweeps


@pytest.fixture(scope="module")
def swept(tmp_path_factory: pytest.TempPathFactory, worker_processes: None) -> turnout.Sweep:
    folder = tmp_path_factory.mktemp("public")
    return turnout.run_sweep(study_file(folder, count=4), out=folder / "out")


def test_a_sweep_is_run_and_opened(swept: turnout.Sweep) -> None:
    again = turnout.open_sweep(swept.folder)
    assert again.dataset.sizes["scenario"] == 4
    assert again["drive_force"].dims == ("scenario", "drive", "time")
    assert len(again.table) == 4
    assert again.missing == 0
    html = again._repr_html_()
    assert "chair.friction_coefficient" in html
    assert "<script" not in html
    assert repr(again) == "<Sweep tiny: 4 scenarios>"
    assert isinstance(again.plot_effects(), Figure)
    assert "4 scenarios" in repr(again.dataset.turnout)
    for file in (swept.folder / "batches").glob("*.nc"):
        with xr.open_dataset(file, decode_times=False) as plain:
            assert plain.attrs["Conventions"] == "CF-1.11"


# --- figures


@pytest.mark.parametrize(
    "name",
    ["drive_force", "drive_gap", "rail_shape", "gap", "chair_load", "energy"],
)
def test_figures_on_one_pair_of_axes_take_it(name: str) -> None:
    draw = getattr(turnout.figures, f"plot_{name}")
    ax = Figure().subplots()
    assert draw(sb2_dataset(), ax=ax) is ax
    assert ax.lines
    alone = draw(sb2_dataset())
    assert isinstance(alone, Axes)
    assert alone.get_xlabel() == ax.get_xlabel() != ""


# --- documentation

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize("package", PACKAGES)
def test_the_reference_lists_every_name(package: str) -> None:
    page = (ROOT / "docs" / "use" / "api.md").read_text(encoding="utf-8")
    listed = set(re.findall(rf"^    {re.escape(package)}\.(\w+)$", page, flags=re.M))
    assert listed == set(import_module(package).__all__) - {"figures", "detection", "__version__"}
