"""The record of a calibration: values, covariance, provenance; written, read and applied."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from turnout.calibration.stages import Fitted
from turnout.core.errors import FileError, PanelError
from turnout.core.files import write_atomic
from turnout.core.problems import choices, shortened
from turnout.core.toml import decode, parse_toml, read_bytes
from turnout.panel.load import LoadedPanel

if TYPE_CHECKING:
    from turnout.calibration.candidate_causes import Cause
    from turnout.calibration.evaluate import Response

Floats = NDArray[np.float64]
# Raised when records of before can no longer be read.
SCHEMA_VERSION = 1


@dataclass(frozen=True, slots=True, kw_only=True)
class StageLog:
    """Record of one stage.

    Attributes
    ----------
    name, method : str
        As of the stage.
    movements : tuple of str
        Those it used.
    values : mapping of str to float
        Where it ended, of the parameters that it changed.
    misfit : float
        Root mean square of the residuals over their expected size.
    evaluations, iterations : int
        Throws simulated for it, and steps of the fit.
    message : str
        How it ended.
    sweep : mapping of str to tuple of float
        Swept values and the misfit of each, as share of the channels' range.
    """

    name: str
    method: str
    movements: tuple[str, ...]
    values: Mapping[str, float]
    misfit: float
    evaluations: int
    iterations: int
    message: str
    sweep: Mapping[str, tuple[float, ...]] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Calibration:
    """Calibrated values of a panel with their uncertainty.

    Attributes
    ----------
    parameters : tuple of Fitted
        All of the plan.
    covariance : ndarray, shape (p, p)
        Of those with state "fitted", in their order [products of their units].
    panel, panel_hash, data, data_hash : str
        What was calibrated, and to what.
    movements : tuple of str
        That the last stage was fitted to.
    stages : tuple of StageLog
        What was done.
    warnings, findings : tuple of str
        Warnings, and findings such as strong correlations, in words.
    distrust : tuple of str
        Why it is not trustworthy, and what to do; empty where it is.
    noise : mapping of str to mapping of str to float
        By channel: white, slow and missed parts and their times of decay.
    scatter : mapping of str to float
        Relative scatter from movement to movement, as estimated.
    about : mapping of str to str
        Versions, scheme, date.
    causes : tuple of str
        Why the panel alone does not follow the measurement, in words, the likeliest first.
    fitted_causes : tuple of str
        Names of those of them that were fitted together with the values.
    sensors : tuple of str
        Sensitivity and zero of each channel and the clock, as stated and as found, in words.
    chain : mapping of str to (float, float)
        Gain and zero of each channel and the clock as found, with their deviations: "gain
        drive_force.1" [-], "zero object_force" [N], "clock" [-].
    effects : mapping of str to mapping of str to float
        By movement of the last stage, as from `movement_rows`.
    objects : tuple of Fitted
        Thickness of each size and position of each place of the objects, as found [m].
    """

    parameters: tuple[Fitted, ...]
    covariance: Floats
    panel: str
    panel_hash: str
    data: str
    data_hash: str
    movements: tuple[str, ...]
    stages: tuple[StageLog, ...]
    warnings: tuple[str, ...] = ()
    findings: tuple[str, ...] = ()
    distrust: tuple[str, ...] = ()
    noise: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    scatter: Mapping[str, float] = field(default_factory=dict)
    about: Mapping[str, str] = field(default_factory=dict)
    causes: tuple[str, ...] = ()
    fitted_causes: tuple[str, ...] = ()
    sensors: tuple[str, ...] = ()
    chain: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    effects: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    objects: tuple[Fitted, ...] = ()

    @property
    def values(self) -> dict[str, float]:
        """Best value of each parameter, in SI."""
        return {item.name: item.value for item in self.parameters}

    @property
    def fitted(self) -> tuple[Fitted, ...]:
        """The parameters that the covariance is of, in its order."""
        return tuple(item for item in self.parameters if item.state == "fitted")

    @property
    def correlation(self) -> Floats:
        """Of the fitted parameters, shape (p, p); NaN where a deviation is zero [-]."""
        size = np.sqrt(np.diag(self.covariance))
        outer = np.outer(size, size)
        found: Floats = np.full_like(outer, np.nan)
        np.divide(self.covariance, outer, out=found, where=outer > 0.0)
        return found

    @property
    def overrides(self) -> dict[str, float]:
        """The panel's keys and the values they take."""
        return {key: item.value for item in self.parameters for key in item.keys}

    def apply(self, panel: LoadedPanel) -> LoadedPanel:
        """Return a panel with the calibrated values, and with the causes that are part of it.

        A bushing that was found to be soft at first, or friction that differs from chair to chair,
        is in the panel; a recorder that averages is not.

        Parameters
        ----------
        panel : LoadedPanel
            The one that was calibrated, or another that has the same keys.

        Raises
        ------
        PanelError
            When the panel lacks keys; with all problems.
        """
        try:
            calibrated = panel.with_overrides(self.overrides)
            if all(item.keys for item in self.parameters):
                return calibrated
            causes = fitted_causes(panel, self.parameters)
            return panel.with_overrides(overrides_with(causes, self.parameters, self.values))
        except PanelError as error:
            problems = [
                f"{text}; the calibration is of panel {self.panel}" for text in error.problems
            ]
            raise PanelError(problems, source=f"calibration on panel {panel.name}") from None

    def save(self, path: Path | str) -> None:
        """Write the record (TOML), completely or not at all."""
        write_atomic(path, calibration_text(self))


TEXTS = ("panel", "panel_hash", "data", "data_hash")
REMARKS = ("warnings", "findings", "causes", "fitted_causes", "sensors")
"""Entries of the file by name: texts, and lists of texts."""


def calibration_text(calibration: Calibration) -> str:
    """Return a calibration as the text of its file."""
    head = {
        "schema_version": SCHEMA_VERSION,
        "kind": "calibration",
        **{name: getattr(calibration, name) for name in (*TEXTS, "movements")},
        "trusted": not calibration.distrust,
        **{name: getattr(calibration, name) for name in ("distrust", *REMARKS)},
    }
    lines = ["# Calibration of a switch panel; apply it with --calibration FILE."]
    lines += [*_lines(head), "", "[about]", *_lines(calibration.about, quoted=True)]
    for kind, items in (("parameter", calibration.parameters), ("object", calibration.objects)):
        for item in items:
            lines += ["", f"[{kind}.{_value(item.name)}]", *_lines(_entry(item))]
    lines += ["", "[covariance]  # products of the SI units of the parameters"]
    lines += [f"names = {_value([item.name for item in calibration.fitted])}", "values = ["]
    lines += [f"  {_value(row)}," for row in calibration.covariance.tolist()]
    lines += ["]", "", "[scatter]  # share of the value, from movement to movement"]
    lines += _lines(calibration.scatter, quoted=True)
    if calibration.chain:
        lines += ["", "[chain]  # of the recordings: value and standard deviation, SI"]
        lines += _lines(calibration.chain, quoted=True)
    for name, sizes in calibration.noise.items():
        lines += ["", f"[noise.{_value(name)}]  # SI", *_lines(sizes)]
    for stage in calibration.stages:
        entries = {name: getattr(stage, name) for name in StageLog.__dataclass_fields__}
        if not stage.sweep:
            del entries["sweep"]
        rows = (f"{row}  # SI" if row.startswith("values =") else row for row in _lines(entries))
        lines += ["", "[[stage]]", *rows]
    if calibration.effects:
        lines += ["", "[effects]  # of each movement, in SI"]
        lines += _lines(calibration.effects, quoted=True)
    return "\n".join(lines) + "\n"


def _entry(item: Fitted) -> dict[str, object]:
    """Return the entry of a value that was fitted, with its unit behind each number."""

    def quantity(value: float) -> float | str:
        return value if item.unit == "1" else f"{float(value)!r} {item.unit}"

    return {
        "keys": item.keys,
        "unit": item.unit,
        "value": quantity(item.value),
        "deviation": quantity(item.deviation),
        "interval_95": [quantity(end) for end in item.interval],
        "lower": quantity(item.lower),
        "upper": quantity(item.upper),
        "start": quantity(item.start),
        "state": item.state,
    }


def _lines(entries: Mapping[str, object], *, quoted: bool = False) -> list[str]:
    """Return a line of TOML for each entry."""
    return [f"{_value(k) if quoted else k} = {_value(v)}" for k, v in entries.items()]


def _value(value: Any) -> str:
    """Return a value as TOML."""
    if isinstance(value, str | bool | int):
        return json.dumps(value, ensure_ascii=False)
    if isinstance(value, Mapping):
        return f"{{ {', '.join(_lines(value, quoted=True))} }}"
    if isinstance(value, Sequence):
        return f"[{', '.join(map(_value, value))}]"
    return repr(float(value))


def load_calibration(path: Path | str) -> Calibration:
    """Read a calibration from its file.

    Raises
    ------
    FileError
        When it cannot be read, or is no calibration; the text says what is missing.
    """
    path = Path(path)
    data = parse_toml(decode(read_bytes(path), source=str(path)), source=str(path)).data
    if data.get("kind") != "calibration":
        message = f"{path}: is not a calibration; `turnout calibrate CAMPAIGN -o FILE` writes one"
        raise FileError(message)
    if data.get("schema_version") != SCHEMA_VERSION:
        message = (
            f"{path}: schema_version = {data.get('schema_version')}: this version reads "
            f"{SCHEMA_VERSION}; calibrate again"
        )
        raise FileError(message)
    try:
        return _read(data)
    except (
        KeyError,
        TypeError,
        ValueError,
        AttributeError,
        OverflowError,
        RecursionError,
    ) as error:
        reason = shortened(f"{type(error).__name__}: {error}", 200)
        message = f"{path}: is damaged ({reason}); calibrate again"
        raise FileError(message) from None


def _read(data: Mapping[str, Any]) -> Calibration:
    parameters = tuple(_fitted(name, item) for name, item in data["parameter"].items())
    count = sum(item.state == "fitted" for item in parameters)
    covariance = np.array(data["covariance"]["values"], dtype=np.float64).reshape(count, count)
    stages = [
        {
            **item,
            "movements": tuple(item["movements"]),
            "sweep": {key: tuple(row) for key, row in item.get("sweep", {}).items()},
        }
        for item in data.get("stage", [])
    ]
    # Files of before have no causes, and sensors as gains.
    remarks = {"causes": [], "fitted_causes": [], "sensors": data.get("gains", []), **data}
    plain: dict[str, Any] = {name: data[name] for name in TEXTS}
    plain |= {name: tuple(remarks[name]) for name in REMARKS}
    plain |= {name: data.get(name, {}) for name in ("noise", "scatter", "about", "effects")}
    return Calibration(
        parameters=parameters,
        covariance=covariance,
        stages=tuple(StageLog(**item) for item in stages),
        movements=tuple(data["movements"]),
        distrust=tuple(data.get("distrust", ())),
        chain={key: (float(a), float(b)) for key, (a, b) in data.get("chain", {}).items()},
        objects=tuple(_fitted(name, item) for name, item in data.get("object", {}).items()),
        **plain,
    )


def _fitted(name: str, item: Mapping[str, Any]) -> Fitted:
    def read(value: object) -> float:
        return _parsed(value, item["unit"], name)

    low, high = item["interval_95"]
    sizes = {key: read(item[key]) for key in ("value", "deviation", "lower", "upper", "start")}
    return Fitted(
        name=name,
        keys=tuple(item["keys"]),
        unit=item["unit"],
        interval=(read(low), read(high)),
        state=item["state"],
        **sizes,
    )


def _parsed(value: object, unit: str, name: str) -> float:
    """Read a number with its unit, which must be the SI unit of the parameter."""
    if unit == "1" and isinstance(value, int | float):
        return float(value)
    number, _, given = str(value).partition(" ")
    if given != unit:
        message = f'{name} = "{value}": must be in {choices([unit])}'
        raise ValueError(message)
    return float(number)


def check_provenance(calibration: Calibration, *panels: LoadedPanel) -> tuple[str, ...]:
    """Say why a calibration is not trustworthy, or that it is of another panel, by hash.

    Parameters
    ----------
    calibration : Calibration
        Its attributes hold the hash of its panel.
    *panels : LoadedPanel
        The same panel before and after what a user sets.

    Returns
    -------
    tuple of str
        Empty where it is trustworthy and belongs to one of them.
    """
    found = tuple(f"is not trustworthy: {text}" for text in calibration.distrust)
    if calibration.panel_hash in [panel.hash for panel in panels]:
        return found
    return (
        *found,
        f"the calibration is of panel {calibration.panel} with hash {calibration.panel_hash[:12]}, "
        f"not of {panels[0].name} with hash {panels[0].hash[:12]}; its values are used "
        "anyway",
    )


def fitted_causes(panel: LoadedPanel, parameters: Sequence[Fitted]) -> "tuple[Cause, ...]":
    """Return the causes whose sizes are among the parameters of a calibration.

    Parameters
    ----------
    panel : LoadedPanel
        That was calibrated.
    parameters : sequence of Fitted
        All of a calibration; the sizes of causes have no keys of the panel.

    Returns
    -------
    tuple of Cause
        A cause that is a key of the panel, such as the modulus of the rails, is none of them: its
        value is set like any other.
    """
    # Only a calibration with causes waits for their table.
    from turnout.calibration.candidate_causes import candidate_causes

    planned = [item for item in parameters if item.keys]
    sizes = {item.name for item in parameters if not item.keys}
    return tuple(
        cause
        for cause in candidate_causes(panel, planned)
        if cause.parameters and all(item.name in sizes for item in cause.sized)
    )


def overrides_with(
    causes: "Sequence[Cause]", parameters: Sequence[Fitted], values: Mapping[str, float]
) -> dict[str, object]:
    """Return the overrides of a panel at values by name of the parameter, causes included.

    Parameters
    ----------
    causes : sequence of Cause
        From `fitted_causes`.
    parameters : sequence of Fitted
        Of the calibration.
    values : mapping of str to float
        Of all of them, in SI.
    """
    found: dict[str, object] = {key: values[item.name] for item in parameters for key in item.keys}
    for cause in causes:
        if cause.law is not None:
            found |= cause.law(values)
    return found


def shaped(
    causes: "Sequence[Cause]", response: "Response", values: Mapping[str, float]
) -> "Response":
    """Return a response as causes that are no part of the panel leave it, such as a recorder."""
    for cause in causes:
        if cause.shape is not None and not response.failure:
            response = cause.shape(response, values)
    return response
