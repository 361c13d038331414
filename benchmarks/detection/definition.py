"""Definition of the benchmark: switches, their panels and machines, and numbers of throws.

Everything follows from the number of a switch and from one seed. Panels are the cases of the study
`plausible-panels` as it was when the benchmark was frozen (`panels.toml`). States, and what differs
from throw to throw, are those of the reference case of detection then, about the values of the
panel. A panel belongs to one side of the split with all its switches.
"""

from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from turnout.calibration.load_study import load_study
from turnout.core.errors import StudyError
from turnout.core.json_files import to_plain
from turnout.core.provenance import content_hash
from turnout.detection.reference import reference_study
from turnout.panel.load import LoadedPanel
from turnout.study.study import Study

VERSION = 2
"""Of the definition; raised when throws or the split change."""
SEED = 5_000_000
"""Added to the seed of the reference study, so that no throw is one that others trained on [-]."""
PANELS = Path(__file__).with_name("panels.toml")
MACHINES = (("jea73", "jea73-drive2"), ("s700k", "s700k"), ("m70", "m70"))
"""Machines of Drive 1 and Drive 2 of the switches that have some."""
TEST_SHARE = 0.4
"""Of the panels, whose switches are all for testing [-]."""
RATES = (125.0, 50.0, 25.0)
"""Samples a second of the recorders, switch by switch in turn [Hz]."""
MARKERS, WITH_MACHINES = "markers", "machines"
TRAIN, TEST = "train", "test"
HISTORY, SOUND, OBJECT = "history", "sound", "object"
HARD = ("stone", "metal")
"""Kinds that a90 of a place is of."""
MID_SPAN = ("sleeper 4", "sleeper 5", "sleeper 6", "sleeper 7", "sleeper 8")
EQUAL = 1e-3
"""Rate of false alarms of the test throws themselves at which methods are also compared [-]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Counts:
    """How many switches and throws there are.

    Attributes
    ----------
    switches, machines : int
        In all, and those whose drives are machines instead of markers.
    known : int
        Sound throws of each switch in the first half of its year: its history.
    sound, objects : int
        Throws of each switch in the other half of its year, judged.
    causes : int
        Throws of each other cause, of each switch.
    """

    switches: int
    machines: int
    known: int
    sound: int
    objects: int
    causes: int

    def __post_init__(self) -> None:
        """Refuse counts that are too small, all of them at once."""
        least = {
            "switches": 4, "machines": 0, "known": 1, "sound": 1, "objects": 1, "causes": 0,
        }  # fmt: skip
        faults = [
            f"{name} = {getattr(self, name)}: must be {number} or more"
            for name, number in least.items()
            if getattr(self, name) < number
        ]
        if self.machines > self.switches:
            faults.append(f"machines = {self.machines}: must be at most {self.switches}, switches")
        if faults:
            raise StudyError(faults, source="benchmark")


PRESETS = {
    "full": Counts(switches=200, machines=40, known=200, sound=104, objects=156, causes=10),
    "reduced": Counts(switches=80, machines=16, known=20, sound=60, objects=39, causes=2),
    "small": Counts(switches=24, machines=12, known=20, sound=44, objects=13, causes=1),
}
"""Sizes of the benchmark by name; a smaller one is no part of a larger one."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Switch:
    """One switch of the benchmark.

    Attributes
    ----------
    number : int
        From 0.
    panel : int
        Case of the study of panels.
    machines : tuple of str
        Of each drive; none where drives are markers.
    rate : float
        Of its recorder [Hz].
    split : str
        "train" or "test".
    phase : float
        Where in the year its first throw lies, from 0 for the first of January to 1 [-].
    """

    number: int
    panel: int
    machines: tuple[str, ...]
    rate: float
    split: str
    phase: float

    @property
    def track(self) -> str:
        """Return "markers" or "machines", which are judged apart."""
        return WITH_MACHINES if self.machines else MARKERS


@lru_cache(maxsize=1)
def panels_study() -> Study:
    """Return the study whose cases are the panels."""
    return load_study(PANELS)


LATER = ("movement.ramp", "object_defaults.face_slope", "drive.rod_slope")
"""Inputs of the reference case that came after this version was frozen."""


def population_of(panel: LoadedPanel | None = None) -> Study:
    """Return the reference case as it was when this version was frozen.

    Parameters
    ----------
    panel : LoadedPanel, optional
        As of `reference_study`.
    """
    study = reference_study(panel)
    design = study.design
    kept = [number for number, item in enumerate(design.drawn) if item.name not in LATER]
    copula = None if design.copula is None else design.copula[np.ix_(kept, kept)]
    drawn = tuple(design.drawn[number] for number in kept)
    variables = {name: item for name, item in study.variables.items() if name not in LATER}
    return replace(study, variables=variables, design=replace(design, drawn=drawn, copula=copula))


def test_panels(panels: int) -> frozenset[int]:
    """Return which panels are for testing.

    Examples
    --------
    >>> len(test_panels(50))
    20
    """
    order = np.random.default_rng([SEED, 1]).permutation(panels)
    return frozenset(order[: round(TEST_SHARE * panels)].tolist())


def switches_of(counts: Counts, *, panels: int | None = None) -> list[Switch]:
    """Return all switches of a benchmark.

    Parameters
    ----------
    counts : Counts
        Of the benchmark.
    panels : int, optional
        Cases of the study of panels; default as many as it has.

    Examples
    --------
    >>> found = switches_of(PRESETS["full"], panels=50)
    >>> len(found), len({item.panel for item in found}), found[0].split == found[50].split
    (200, 50, True)
    """
    count = panels_study().count if panels is None else panels
    tested = test_panels(count)
    order = np.random.default_rng([SEED, 2]).permutation(count).tolist()
    first = counts.switches - counts.machines
    found = []
    for number in range(counts.switches):
        panel = int(order[number % count])
        machines = MACHINES[number % len(MACHINES)] if number >= first else ()
        found.append(
            Switch(
                number=number,
                panel=panel,
                machines=machines,
                rate=RATES[int(np.random.default_rng([SEED, 3, number]).integers(len(RATES)))],
                split=TEST if panel in tested else TRAIN,
                phase=float(np.random.default_rng([SEED, 4, number]).random()),
            )
        )
    return found


def definition_digest(counts: Counts) -> str:
    """Return a digest of all that determines a benchmark but the version of the program."""
    content = {
        "version": VERSION,
        "seed": SEED,
        "counts": asdict(counts),
        "panels": panels_study().digest,
        "reference": population_of().digest,
        "switches": [asdict(item) for item in switches_of(counts)],
    }
    return content_hash(to_plain(content))
