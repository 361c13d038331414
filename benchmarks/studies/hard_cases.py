"""Cases of `benchmarks.studies.hard_campaigns`: differences from the model and its recording."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.signal import butter, sosfilt, sosfilt_zi

from turnout.core.moving_average import moving_average
from turnout.core.scheme import Scheme
from turnout.core.toml import parse_toml
from turnout.measurement.chain.apply import parse_channel_map
from turnout.panel.foreign_object import ForeignObject, resolve_objects
from turnout.panel.load import LoadedPanel, load_panel
from turnout.study.virtual.campaign_files import WrittenThrow, sheet_text, write_throw
from turnout.study.virtual.campaign_plan import Case
from turnout.study.virtual.disturbance import Disturbance, Transducer, add_disturbance
from turnout.study.virtual.record_throw import (
    CurrentLaw,
    Window,
    finer_panel,
    finer_scheme,
    record_throw,
)
from turnout.study.virtual.series import FIELDS
from turnout.throw.save import Save
from turnout.throw.simulate import simulate

Floats = NDArray[np.float64]
Values = dict[str, float]
MU = "chair.friction_coefficient"
K1, K2 = "drive.1.stiffness", "drive.2.stiffness"
S1, S2 = "drive.1.saturation_force", "drive.2.saturation_force"
TRUTH: Values = {MU: 0.33, K1: 690e3, S1: 6400.0, K2: 880e3, S2: 5700.0}
THROWS = (
    *(("closing", "none", 0.0),) * 3,
    ("opening", "none", 0.0),
    ("closing", "drive 1", 0.010),
    ("closing", "drive 1", 0.013),
    ("closing", "drive 1", 0.029),
    ("closing", "sleeper 3", 0.021),
    ("closing", "sleeper 7", 0.013),
    ("closing", "sleeper 7", 0.013),
    ("closing", "sleeper 9", 0.024),
    ("closing", "sleeper 10", 0.018),
    ("closing", "drive 2", 0.008),
    ("closing", "drive 2", 0.010),
)
SCATTER = 0.02
WINDOW, LAW = Window(lead=2.0, length=8.0), CurrentLaw(time_out=4.5)
LEAD, AVERAGE, SOFT = 0.15, 0.1, 2e-3
# Of further cases: play [m], where a bushing softens as a share of its slip level and to which
# share of its stiffness, cut-off of the recorder's filter [Hz], a gain of all channels [-].
PLAY, SOFTENS, SOFTENED, CUT_OFF, ALIKE = 1.5e-3, 0.7, 0.35, 6.0, 0.012
LAG = 0.12
# By which a rail is longer [m]; friction of a day that is colder, as a share of that before [-].
LONGER = 0.6
COLDER = 1.15
# Of the recorder's seconds, as a share too short [-].
CLOCK = 0.01
HUMMING = Transducer(noise=5.0, drift=3.0, hum=60.0, step=40e3 / 2**16)
# Of the amplifier, against aliases: a mean over this time [s].
ANTI_ALIAS = 8e-3
NOTE = "synthetic: hard campaign of benchmarks.studies.hard_campaigns, not measured"


@dataclass(frozen=True, kw_only=True)
class Hard:
    """A case: changes of the switch, the truth of the parameters, and the cause to be named.

    Attributes
    ----------
    what : str
        What differs from the model.
    cause, drive : str
        Name of the cause, and the drive that it is of; empty where nothing differs, or for all.
    overrides : callable
        Of the panel, from the generator and the number of a throw.
    truth : callable
        From the true panel's usual truth and the overrides of all throws to the true values.
    seen : callable
        From a perfect recording to the one of this chain, by number of the throw.
    columns : mapping of str to str
        Columns that the channel map names wrongly.
    start : mapping of str to float
        Where the fit starts; default the library's values.
    lag : float
        With which the force of drive 2 follows contact [s].
    thicker, displaced : float
        What objects are thicker than the run sheet says, and further from the toe [m].
    disturbance : Disturbance
        Noise, drift, hum and cross-talk of the recording.
    """

    what: str
    cause: str = ""
    drive: str = ""
    overrides: Callable[[np.random.Generator, int], dict[str, object]] = lambda rng, number: {}
    truth: Callable[[LoadedPanel, list[dict[str, object]]], Values] = lambda panel, made: {}
    seen: Callable[[xr.Dataset, int], xr.Dataset] = lambda dataset, number: dataset
    columns: Mapping[str, str] = field(default_factory=dict)
    start: Values = field(default_factory=dict)
    lag: float = 0.0
    thicker: float = 0.0
    displaced: float = 0.0
    disturbance: Disturbance = field(default_factory=Disturbance)


def gains(dataset: xr.Dataset, number: int) -> xr.Dataset:
    """Return a recording whose gauges and load cell are 1 to 2 % off."""
    rods = dataset["drive_force"] * xr.DataArray([1.015, 0.982], dims="drive")
    rods = rods.transpose(*dataset["drive_force"].dims)
    return dataset.assign(drive_force=rods, object_force=1.01 * dataset["object_force"])


def averaged(dataset: xr.Dataset, number: int) -> xr.Dataset:
    """Return a recording in which every force sample is the mean of the last 0.1 s."""
    rate = WINDOW.rate
    late = round(0.5 * AVERAGE * rate)

    def past(row: Floats) -> Floats:
        smooth = moving_average(row, rate=rate, window=AVERAGE)
        return np.concatenate((np.full(late, row[0]), smooth[:-late]))

    rods = dataset["drive_force"]
    rows = np.stack([past(row) for row in rods.values])
    return dataset.assign(
        drive_force=rods.copy(data=rows),
        object_force=dataset["object_force"].copy(data=past(dataset["object_force"].values)),
    )


def led(dataset: xr.Dataset, number: int) -> xr.Dataset:
    """Return a recording whose motors run 150 ms before the rods move."""
    early = round(LEAD * WINDOW.rate)
    currents = dataset["drive_current"]
    rows = np.hstack((currents.values[:, early:], np.repeat(currents.values[:, -1:], early, 1)))
    return dataset.assign(drive_current=currents.copy(data=rows))


def filtered(dataset: xr.Dataset, number: int) -> xr.Dataset:
    """Return a recording behind a low-pass of two poles."""
    poles = butter(2, CUT_OFF, fs=WINDOW.rate, output="sos")

    def past(rows: Floats) -> Floats:
        start = sosfilt_zi(poles)[:, None, :] * np.atleast_2d(rows)[:, :1]
        found, _ = sosfilt(poles, np.atleast_2d(rows), zi=start)
        return np.asarray(found.reshape(rows.shape), dtype=np.float64)

    return dataset.assign(
        {
            name: dataset[name].copy(data=past(dataset[name].values))
            for name in ("drive_force", "object_force")
        }
    )


def alike(dataset: xr.Dataset, number: int) -> xr.Dataset:
    """Return a recording whose channels all read too much alike, behind motors that lead."""
    return led(
        dataset.assign(
            {name: (1.0 + ALIKE) * dataset[name] for name in ("drive_force", "object_force")}
        ),
        number,
    )


def scaled(dataset: xr.Dataset, number: int) -> xr.Dataset:
    """Return a recording whose channels all read 3 % too much."""
    return dataset.assign({n: 1.03 * dataset[n] for n in ("drive_force", "object_force")})


def dead(dataset: xr.Dataset, number: int) -> xr.Dataset:
    """Return a recording whose second rod is silent from the ninth on."""
    if number < 8:
        return dataset
    rods = dataset["drive_force"]
    return dataset.assign(
        drive_force=rods.copy(data=np.vstack((rods.values[:1], 0 * rods.values[1:])))
    )


def soft_bushings(rng: np.random.Generator, number: int) -> dict[str, object]:
    """Return bushings with a quarter of their stiffness over the first 2 mm to either side."""
    found: dict[str, object] = {}
    for drive, k, level in (("1", TRUTH[K1], TRUTH[S1]), ("2", TRUTH[K2], TRUTH[S2])):
        first = 0.25 * k * SOFT
        knee = SOFT + (level - first) / k
        found |= _table(drive, ((SOFT, first), (knee, level)))
    return found


def _table(drive: str, points: tuple[tuple[float, float], ...]) -> dict[str, object]:
    """Return a bushing through points [m, N], alike to both sides, that slips at the last."""
    knee, level = points[-1]
    half = (*points, (1.0, level + 1e4 * (1.0 - knee)))
    return {
        f"drive.{drive}.extension": [-x for x, _ in reversed(half)] + [x for x, _ in half],
        f"drive.{drive}.force": [-f for _, f in reversed(half)] + [f for _, f in half],
    }


def with_play(rng: np.random.Generator, number: int) -> dict[str, object]:
    """Return a drive 1 that has play before it pushes."""
    return _table("1", ((PLAY, 1.0), (PLAY + TRUTH[S1] / TRUTH[K1], TRUTH[S1])))


def with_knee(rng: np.random.Generator, number: int) -> dict[str, object]:
    """Return a drive 2 that softens before it slips."""
    first = SOFTENS * TRUTH[S2]
    bend = first / TRUTH[K2]
    knee = bend + (TRUTH[S2] - first) / (SOFTENED * TRUTH[K2])
    return _table("2", ((bend, first), (knee, TRUTH[S2])))


def by_chair(rng: np.random.Generator, number: int) -> dict[str, object]:
    """Return friction of 0.2 to 0.6 from chair to chair, and rails 20 % more compliant."""
    chairs = np.random.default_rng(24).uniform(0.2, 0.6, 16)
    names = load_panel("sb1").chair
    shares = {
        f"chair.{name}.friction_coefficient": float(value)
        for name, value in zip(names, chairs, strict=True)
    }
    return {**shares, "section.prismatic.second_moment_lateral": 7.4e-6 / 1.2}


def worn(rng: np.random.Generator, number: int) -> dict[str, object]:
    """Return a clutch of drive 2 that slips 6 % higher, scattering by 5 %."""
    return {S2: TRUTH[S2] * (1.06 + 0.05 * float(rng.standard_normal()))}


def longer(rng: np.random.Generator, number: int) -> dict[str, object]:
    """Return a rail that is 0.6 m longer between its last chair and its first fastening."""
    fastenings = load_panel("sb1").fastening
    moved = {f"fastening.{name}.x": item.x + LONGER for name, item in fastenings.items()}
    return {**moved, "rail.switch.end": 14.0 + LONGER}


def of_day(rng: np.random.Generator, number: int) -> dict[str, object]:
    """Return friction of two days, of which the second is colder."""
    return {MU: TRUTH[MU] * (COLDER if number >= len(THROWS) // 2 else 1.0)}


def mean_of_days(panel: LoadedPanel, made: list[dict[str, object]]) -> Values:
    """Return friction as the mean over the throws."""
    return {MU: float(np.mean([float(str(item[MU])) for item in made]))}


def mean_level(panel: LoadedPanel, made: list[dict[str, object]]) -> Values:
    """Return the mean slip level of the throws."""
    return {S2: float(np.mean([float(str(item[S2])) for item in made]))}


def load_weighted(panel: LoadedPanel, made: list[dict[str, object]]) -> Values:
    """Return friction weighted by the chairs' normal force while the rail closes."""
    run = simulate(panel.with_overrides(made[0]), save=Save(fields=("chair_normal_force",)))
    loads = run["chair_normal_force"].sel(time=slice(1.2, 3.8)).mean("time").sum("rail")
    friction = [
        float(str(made[0][f"chair.{n}.friction_coefficient"])) for n in loads["chair"].values
    ]
    return {MU: float(np.average(friction, weights=loads.values))}


CASES: dict[str, Hard] = {
    "right": Hard(what="nothing but mesh, step and damping"),
    "gains": Hard(what="gauges +1.5 and -1.8 %, load cell +1 %", cause="gain", seen=gains),
    "average": Hard(
        what="the recorder averages over the last 0.1 s", cause="recorder filter", seen=averaged
    ),
    "bushing": Hard(
        what="bushings soft for 2 mm",
        cause="bushing shape",
        overrides=soft_bushings,
    ),
    "chairs": Hard(
        what="friction 0.2 to 0.6 from chair to chair, rails 20 % more compliant",
        cause="friction by chair",
        overrides=by_chair,
        truth=load_weighted,
    ),
    "clutch": Hard(
        what="clutch of drive 2 slips 6 % higher, scattering by 5 %",
        cause="clutch",
        drive="2",
        overrides=worn,
        truth=mean_level,
    ),
    "sections": Hard(
        what="lateral second moment 10 % and area 3 % larger",
        cause="sections",
        overrides=lambda rng, number: {
            "section.prismatic.second_moment_lateral": 1.1 * 7.4e-6,
            "section.prismatic.area": 1.03 * 9.3e-3,
        },
    ),
    "lead": Hard(what="motors lead the rods by 150 ms", cause="timing", seen=led),
    "dead": Hard(what="rod 2 silent in 6 of 14 recordings", cause="dead channel", seen=dead),
    "swapped": Hard(
        what="columns of the rods exchanged in the channel map",
        cause="swapped channels",
        columns={"Rod 1": "Rod 2", "Rod 2": "Rod 1"},
    ),
    "start": Hard(
        what="nothing; the fit starts from friction 0.5, stiffness 400 and 1,400 kN/m",
        start={MU: 0.5, K1: 400e3, K2: 1.4e6, S1: 7500.0, S2: 7500.0},
    ),
}


FURTHER: dict[str, Hard] = {
    "play": Hard(
        what="play of 1.5 mm before drive 1 pushes",
        cause="drive law",
        drive="1",
        overrides=with_play,
    ),
    "knee": Hard(
        what="bushing of drive 2 at 35 % of its stiffness above 70 % of its slip level",
        cause="drive law",
        drive="2",
        overrides=with_knee,
    ),
    "filter": Hard(
        what="the recorder filters at 6 Hz with two poles", cause="recorder filter", seen=filtered
    ),
    "lag": Hard(
        what="the force of drive 2 follows contact with a lag of 120 ms",
        cause="drive law",
        drive="2",
        lag=LAG,
    ),
    "alike": Hard(
        what="all channels read 1.2 % too much, motors lead by 150 ms", cause="timing", seen=alike
    ),
}
UNLISTED: dict[str, Hard] = {
    "thick": Hard(what="objects 1 mm thicker than stated", cause="objects", thicker=1e-3),
    "place": Hard(what="objects 0.1 m further from the toe", cause="objects", displaced=0.1),
    "clock": Hard(
        what="seconds of the recorder 1 % too short",
        cause="timing",
        disturbance=Disturbance(clock_rate=CLOCK),
    ),
    "hum": Hard(
        what="mains hum of 60 N", disturbance=Disturbance(drive_force=HUMMING, object_force=HUMMING)
    ),
    "scaled": Hard(what="all channels read 3 % too much", seen=scaled),
    "softer": Hard(
        what="rails 8 % softer",
        cause="sections",
        overrides=lambda rng, number: {"material.youngs_modulus": 0.92 * 210e9},
    ),
    "cross-talk": Hard(
        what="each rod reads 2 % of the other's force",
        cause="cross-talk",
        disturbance=Disturbance(cross_talk=0.02),
    ),
    "longer": Hard(
        what="fastenings begin 0.6 m further from the toe", cause="sections", overrides=longer
    ),
    "days": Hard(
        what="friction 15 % higher on the second of two days",
        overrides=of_day,
        truth=mean_of_days,
    ),
    "both": Hard(
        what="objects 1 mm thicker, and play of 1.5 mm before drive 1 pushes",
        cause="drive law",
        drive="1",
        overrides=with_play,
        thicker=1e-3,
    ),
}
GROUPS = {"hard": CASES, "further": FURTHER, "unlisted": UNLISTED}
ALL = {**CASES, **FURTHER, **UNLISTED}


def channel_map(drives: list[str]) -> str:
    """Return a channel map of amplifier volts."""
    lines = [f"# {NOTE}", 'title = "amplifier volts"', ""]
    for name in drives:
        lines += [
            *(f"[drive_force.{name}]", f'column = "Rod {name}"', 'kind = "strain bridge"'),
            *('unit = "V"', 'excitation = "5 V"', "gain = 1000.0", 'bridge = "full T"'),
            *("gauge_factor = 2.1", "poisson_ratio = 0.3", 'youngs_modulus = "210 GPa"'),
            *('section_modulus = "6.28 cm^3"', 'eccentricity = "60 mm"', ""),
            *(f"[drive_current.{name}]", f'column = "Clamp {name}"', 'kind = "clamp"'),
            *('unit = "V"', 'sensitivity = "100 mV/A"', ""),
        ]
    lines += [
        *("[object_force]", 'column = "Load cell"', 'kind = "load cell"', 'unit = "V"'),
        *('excitation = "5 V"', "gain = 1000.0", 'sensitivity = "1 mV/V"', 'capacity = "20 kN"'),
        "optional = true",
    ]
    return "\n".join(lines) + "\n"


def make(case: Hard, folder: Path, *, seed: int, panel_name: str = "sb1") -> Values:
    """Write a campaign of a panel, and return the true values."""
    folder.mkdir(parents=True)
    panel = finer_panel(load_panel(panel_name, overrides=TRUTH))
    text = channel_map(list(panel.drive))
    wired = parse_channel_map(parse_toml(text, source="channels.toml"))
    scheme = replace(finer_scheme(), output_interval=Scheme().output_interval)
    rows, made = [], []
    for number, (direction, place, size) in enumerate(THROWS):
        rng = np.random.default_rng([seed, number])
        changed = case.overrides(rng, number)
        made.append(changed)
        run = simulate(
            _scattered(panel.with_overrides(changed), rng),
            foreign_object=_trapped(case, panel, place, size),
            scheme=scheme,
            save=Save(fields=FIELDS),
        )
        true = record_throw(
            run,
            direction=direction,
            window=WINDOW,
            law=LAW,
            build_up_lag={"2": case.lag} if case.lag else None,
        )
        if size < 0.013:
            true = true.assign(object_force=0.0 * true["object_force"])
        disturbed = add_disturbance(
            case.seen(_amplified(true), number), rng=rng, disturbance=case.disturbance
        )
        file = f"throw-{number + 1:02d}.mat"
        write_throw(disturbed, folder / file, channel_map=wired, number=number, note=NOTE)
        row = Case(name=file, direction=direction, size=size, place=place, repeat=number + 1)
        rows.append(WrittenThrow(row, file, bool(true.attrs["slipped"])))
    sheet = sheet_text(rows, note=NOTE, title="hard campaign")
    (folder / "runs.csv").write_text(sheet, encoding="utf-8")
    for number, (one, other) in enumerate(case.columns.items()):
        text = text.replace(f'"{one}"', f'"@{number}"') if number == 0 else text
        text = (
            text.replace(f'"{other}"', f'"{one}"')
            if number == 0
            else text.replace('"@0"', f'"{one}"')
        )
    (folder / "channels.toml").write_text(text, encoding="utf-8")
    return {**TRUTH, **case.truth(panel, made)}


def _trapped(case: Hard, panel: LoadedPanel, place: str, size: float) -> ForeignObject | None:
    """Return the object of a throw as it truly is."""
    if not size:
        return None
    stated = ForeignObject(size, place)
    x = resolve_objects(panel, [stated])[-1].x + case.displaced
    return ForeignObject(size + case.thicker, f"x = {x!r} m" if case.displaced else place)


def _amplified(true: xr.Dataset) -> xr.Dataset:
    """Return a recording behind the filter of its amplifiers."""
    return true.assign(
        {
            name: true[name].copy(
                data=moving_average(true[name].values, rate=WINDOW.rate, window=ANTI_ALIAS)
            )
            for name in ("drive_force", "object_force")
        }
    )


def _scattered(panel: LoadedPanel, rng: np.random.Generator) -> LoadedPanel:
    """Return a panel with the friction of one throw."""
    share = 1.0 + SCATTER * float(rng.standard_normal())
    return panel.with_overrides(
        {
            f"chair.{name}.friction_coefficient": share * chair.friction_coefficient
            for name, chair in panel.chair.items()
        }
    )
