"""Knowledge of a trained detector, as one record and as one file without pickles."""

import hashlib
import io
import json
import zipfile
import zlib
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from turnout.core.errors import FileError
from turnout.core.files import write_atomic
from turnout.core.provenance import version
from turnout.detection.conditions import FORCE, UNITS
from turnout.detection.detector.allowances import (
    Allowances,
    discrepancy_of,
    discrepancy_through_machines,
    gains_of,
    noise_of,
    zeros_of,
)
from turnout.detection.detector.object_kinds import KindSignatures
from turnout.detection.detector.sound_model import SoundModel
from turnout.detection.detector.switch_history import ThrowErrors
from turnout.detection.detector.throw_layout import Layout, Part
from turnout.detection.likelihood import Signatures
from turnout.detection.signal_discrepancy import SignalErrors

Floats = NDArray[np.float64]

SCHEMA = 4
"""Of a detector file. One of format 3 knows no kinds of objects and is read as it is."""
READ = (3, 4)
"""Formats that are read."""
SUFFIX = ".detector"
LARGEST = 400_000_000
"""Of a detector file [bytes]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Calibrated:
    """Results of held-back throws of the population for a way to judge.

    Attributes
    ----------
    part : str
        "cycle" for opening and closing, "closing" for the closing alone.
    history : int
        Sound throws that were known.
    thresholds : mapping of str to float
        Logarithm of the likelihood ratio above which a throw is an alarm, by the rate of false
        alarms, such as "0.001" [-].
    throws : int
        Sound throws behind them, each with its own discrepancy and noise.
    switches, groups : int
        Among how many switches, and in how many groups that share nothing: switches with the same
        sections are in one, and upper limits count groups.
    residual : tuple of float
        Quantiles of what the best hypothesis leaves of a throw, at `RESIDUAL_LEVELS` [-].
    irregularity : tuple of float
        The same of how irregular it is [-].
    size_factor, x_factor : float
        By which intervals of size and place are widened to hold 95 % [-].
    gap_factor : tuple of (float, float)
        The same for the lower and the upper half of the interval of each end gap without an alarm;
        a single pair is for all gaps [-].
    object_gap_factor : tuple of float
        The same for both halves with an alarm; a single one is for all gaps [-].
    place_level : float
        Probability that the set of places must sum to, to hold the true place in 90 % [-].
    cause_thresholds : mapping of str to float
        What speaks for each other cause, from which on it is named; see `support_of` [-].
    gap_reach : tuple of float
        Each gap is called above its limit where that lies at most so many upper half-intervals
        above its median; a single one is for all gaps [-].
    """

    part: str
    history: int
    thresholds: Mapping[str, float]
    throws: int
    switches: int
    groups: int = 0
    residual: tuple[float, ...] = ()
    irregularity: tuple[float, ...] = ()
    size_factor: float = 1.0
    x_factor: float = 1.0
    gap_factor: tuple[tuple[float, float], ...] = ((1.0, 1.0),)
    object_gap_factor: tuple[float, ...] = (1.0,)
    place_level: float = 0.9
    cause_thresholds: Mapping[str, float] = field(default_factory=dict)
    gap_reach: tuple[float, ...] = (0.0,)


RESIDUAL_LEVELS = (0.0, 0.01, 0.1, 0.5, 0.9, 0.99, 0.999, 0.9999)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Setting:
    """Purpose of a detector, beside the throws that it learns from.

    Attributes
    ----------
    layout : Layout
        Of the features.
    places : mapping of str to float
        Where objects are reported [m].
    amplitude : ndarray, shape (n_drives,)
        Peak absolute force of the nominal sound throw [N].
    gaps : tuple of str
        Names of the end gaps.
    limits : tuple of float
        From which on each is open [m].
    allowances : Allowances
        What is assumed beside the population.
    quantity : str
        What of the drives is judged: "force", "current" or "power"; then all that is said to be in
        newtons is in amperes or watts.
    machines : SignalErrors, optional
        How errors of the force show in currents or powers; without it the discrepancy is taken as
        a share of their amplitude.
    """

    layout: Layout
    places: Mapping[str, float]
    amplitude: Floats
    gaps: tuple[str, ...]
    limits: tuple[float, ...]
    allowances: Allowances
    quantity: str = FORCE
    machines: SignalErrors | None = None

    @property
    def unit(self) -> str:
        """Of the quantity."""
        return UNITS[self.quantity]

    def errors(self, mean: Floats, *, allowances: Allowances | None = None) -> ThrowErrors:
        """Return the covariances of throws beside the sound model.

        Parameters
        ----------
        mean : ndarray, shape (n_features,)
            Of sound throws, for the gains of force sensors [N].
        allowances : Allowances, optional
            In place of those assumed, such as those that test throws are drawn with.
        """
        given = allowances or self.allowances
        layout, share = self.layout, given.fixed_share
        conditions = given.conditions
        if self.machines is None:
            whole = discrepancy_of(layout, amplitude=self.amplitude, conditions=conditions)
        else:
            whole = discrepancy_through_machines(
                layout, quantity=self.quantity, errors=self.machines, conditions=conditions
            )
        return ThrowErrors(
            fixed=share * whole + gains_of(layout, mean, gain=given.gain),
            changing=(1.0 - share) * whole
            + noise_of(layout, noise=given.noise_of(self.quantity), rate=given.rate)
            + zeros_of(layout, zero=given.zero_of(self.quantity)),
            timing=given.timing,
            gap=given.gap,
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Knowledge:
    """A trained detector, before it knows anything of one switch.

    Attributes
    ----------
    setting : Setting
        What it is made for.
    model : SoundModel
        Of sound throws.
    signatures : Signatures
        Of objects and other causes.
    causes : tuple of str
        Kinds of signature after the places of objects.
    calibrated : tuple of Calibrated
        Thresholds.
    about : mapping of str to object
        Panel, study, counts of throws, version, for people and for checks.
    object_kinds : KindSignatures, optional
        Signatures by the kind of the object.
    """

    setting: Setting
    model: SoundModel
    signatures: Signatures
    causes: tuple[str, ...]
    calibrated: tuple[Calibrated, ...] = ()
    about: Mapping[str, Any] = field(default_factory=dict)
    object_kinds: KindSignatures | None = None

    @property
    def layout(self) -> Layout:
        """Of the features."""
        return self.setting.layout

    @property
    def places(self) -> tuple[str, ...]:
        """Kinds of signature that are objects, by their place."""
        return tuple(self.setting.places)

    @property
    def kinds(self) -> tuple[str, ...]:
        """Names of all kinds of signature."""
        return self.places + self.causes

    def errors(self, allowances: Allowances | None = None) -> ThrowErrors:
        """Return the covariances beside the sound model, as assumed or as given."""
        middle = self.model.mean[len(self.model.mean) // 2, : self.layout.size]
        return self.setting.errors(middle, allowances=allowances)

    def calibration(self, *, part: str, history: int) -> Calibrated | None:
        """Return what held for the next smaller history; None without any."""
        fitting = [c for c in self.calibrated if c.part == part and c.history <= history]
        return max(fitting, key=lambda item: item.history, default=None)


def store(knowledge: Knowledge, path: Path, *, extra: Mapping[str, Any] | None = None) -> None:
    """Write a detector file: arrays and one text, sealed by a digest.

    Parameters
    ----------
    knowledge : Knowledge
        What is kept.
    path : Path
        Of the file; written whole or not at all.
    extra : mapping, optional
        Further arrays, such as the history of a switch.
    """
    model, signatures = knowledge.model, knowledge.signatures
    arrays: dict[str, NDArray[Any]] = {
        f"model.{name}": np.asarray(getattr(model, name), dtype=_PRECISION.get(name, np.float64))
        for name in MODEL_ARRAYS
    }
    arrays |= {f"signatures.{name}": getattr(signatures, name) for name in SIGNATURE_ARRAYS}
    setting, kinds = knowledge.setting, knowledge.object_kinds
    if kinds is not None:
        arrays |= {f"kinds.{name}": getattr(kinds.signatures, name) for name in SIGNATURE_ARRAYS}
    arrays["amplitude"] = setting.amplitude
    if setting.machines is not None:
        machines = setting.machines
        arrays |= {f"machines.{name}": getattr(machines, name) for name in MACHINE_ARRAYS}
    arrays |= {f"extra.{name}": np.asarray(value) for name, value in (extra or {}).items()}
    said = {
        "schema": SCHEMA,
        "version": version(),
        "layout": asdict(setting.layout),
        "places": list(setting.places.items()),
        "gaps": setting.gaps,
        "limits": setting.limits,
        "allowances": asdict(setting.allowances),
        "quantity": setting.quantity,
        "causes": knowledge.causes,
        "object_kinds": () if kinds is None else kinds.names,
        "calibrated": [asdict(item) for item in knowledge.calibrated],
        "about": dict(knowledge.about),
    }
    text = json.dumps(said, sort_keys=True)
    arrays["said"] = np.frombuffer(text.encode(), dtype=np.uint8)
    arrays["digest"] = np.frombuffer(_digest(arrays).encode(), dtype=np.uint8)
    content = io.BytesIO()
    np.savez_compressed(content, **arrays)  # type: ignore[arg-type]
    write_atomic(path, content.getvalue())


MODEL_ARRAYS = ("level", "weight", "mean", "slope", "switch", "within", "shift")
MACHINE_ARRAYS = ("amplitude", "force_peak", "gain")
SIGNATURE_ARRAYS = ("basis", "change", "gap", "level", "kind", "size", "x")
_PRECISION = {"within": np.float32, "shift": np.float32}


def _digest(arrays: Mapping[str, NDArray[Any]]) -> str:
    found = hashlib.sha256()
    for name in sorted(arrays):
        values = np.ascontiguousarray(arrays[name])
        found.update(f"{name} {values.dtype.str} {values.shape}".encode())
        found.update(values.tobytes())
    return found.hexdigest()


def load(path: Path | str) -> tuple[Knowledge, dict[str, NDArray[Any]]]:
    """Read a detector file.

    Returns
    -------
    knowledge : Knowledge
        Of the detector.
    extra : dict
        Further arrays.

    Raises
    ------
    FileError
        When it is not there, no detector, damaged, or of another version of the format.
    """
    place = Path(path)
    arrays = _read(place)
    digest = bytes(arrays.pop("digest", np.zeros(0, dtype=np.uint8))).decode(errors="replace")
    if "said" not in arrays or digest != _digest(arrays):
        message = f"{place}: damaged (its digest does not fit); train it again, or copy it again"
        raise FileError(message)
    said = json.loads(bytes(arrays["said"]).decode())
    if said.get("schema") not in READ:
        message = (
            f"{place}: detector format {said.get('schema')}, this version reads "
            f"{' and '.join(map(str, READ))}; "
            "train it again: turnout detect train"
        )
        raise FileError(message)
    parts = tuple(Part(**part) for part in said["layout"]["parts"])
    model = SoundModel(
        **{name: arrays[f"model.{name}"].astype(np.float64) for name in MODEL_ARRAYS}
    )
    setting = Setting(
        layout=Layout(parts=parts, drives=tuple(said["layout"]["drives"])),
        places={name: float(x) for name, x in said["places"]},
        amplitude=arrays["amplitude"],
        gaps=tuple(said["gaps"]),
        limits=tuple(said["limits"]),
        allowances=Allowances(**said["allowances"]),
        quantity=said["quantity"],
        machines=_machines(arrays),
    )
    knowledge = Knowledge(
        setting=setting,
        model=model,
        signatures=_signatures(arrays, "signatures"),
        causes=tuple(said["causes"]),
        calibrated=tuple(_calibrated(item) for item in said["calibrated"]),
        about=said["about"],
        object_kinds=KindSignatures(
            names=tuple(said["object_kinds"]), signatures=_signatures(arrays, "kinds")
        )
        if said.get("object_kinds")
        else None,
    )
    extra = {
        name.removeprefix("extra."): value
        for name, value in arrays.items()
        if name.startswith("extra.")
    }
    return knowledge, extra


def _signatures(arrays: Mapping[str, NDArray[Any]], family: str) -> Signatures:
    return Signatures(**{name: arrays[f"{family}.{name}"] for name in SIGNATURE_ARRAYS}).by_level()


def _machines(arrays: Mapping[str, NDArray[Any]]) -> SignalErrors | None:
    """Return the gains of machines, which detectors of forces lack."""
    if "machines.gain" not in arrays:
        return None
    return SignalErrors(**{name: arrays[f"machines.{name}"] for name in MACHINE_ARRAYS})


def _calibrated(item: Mapping[str, Any]) -> Calibrated:
    """Return what was stored, with tuples again."""
    return replace(
        Calibrated(**item),
        residual=tuple(item["residual"]),
        irregularity=tuple(item["irregularity"]),
        gap_factor=tuple((low, high) for low, high in item["gap_factor"]),
        object_gap_factor=tuple(item["object_gap_factor"]),
        gap_reach=tuple(item["gap_reach"]),
    )


def _read(place: Path) -> dict[str, NDArray[Any]]:
    remedy = "a detector is what `turnout detect train` writes"
    try:
        if not place.is_file():
            message = f"{place}: is no file; {remedy}"
            raise FileError(message)
        if place.stat().st_size > LARGEST:
            message = f"{place}: is larger than {LARGEST / 1e6:.0f} MB; {remedy}"
            raise FileError(message)
        with zipfile.ZipFile(place) as packed:
            if sum(item.file_size for item in packed.infolist()) > LARGEST:
                message = f"{place}: holds more than {LARGEST / 1e6:.0f} MB; {remedy}"
                raise FileError(message)
        with np.load(place, allow_pickle=False) as content:
            return {name: content[name] for name in content.files}
    except (
        *(OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile, zlib.error),
        *(RuntimeError, NotImplementedError),  # encrypted, or packed in a way of other programs
    ) as error:
        message = f"{place}: cannot be read as a detector ({error}); {remedy}"
        raise FileError(message) from None
