"""The turnout detector on switches with machines of several kinds, each of which moves differently.

What a kind has in common is taken off all throws, or each kind gets a detector of its own.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from turnout.core.threads import one_blas_thread
from turnout.detection.detector.training import LEAST_SOUND
from turnout.open_benchmark.definition import HISTORY, SOUND
from turnout.open_benchmark.method import FOLDS, Judged, Model
from turnout.open_benchmark.ours import DetectorMethod, Taught, sound_count
from turnout.open_benchmark.sides import Side, window_features

Floats = NDArray[np.float64]
Settings = Sequence[Mapping[str, Any]]

AS_ONE, CENTRED, EACH = "as one", "less their means", "each"
"""How machines are learned: all alike, all but less what a kind has in common, or each alone."""
MACHINE_SETTINGS: Settings = (
    {"components": 4, "machines": AS_ONE},
    {"components": 4, "machines": CENTRED},
    {"components": 8, "machines": CENTRED},
    {"components": 4, "machines": EACH},
)


@dataclass(frozen=True)
class MachineDetectorMethod(DetectorMethod):
    """The detector of markers, which further learns what kinds of machines have in common."""

    settings: Settings = MACHINE_SETTINGS

    def fit(self, train: Judged, setting: Mapping[str, Any], *, final: bool = False) -> Model:
        """Teach a detector, or one for each machine, with the training throws."""
        how = setting["machines"]
        if how == CENTRED:
            offset = machine_offsets(train.everything)
            return Centred(super().fit(less_offset(train, offset), setting, final=final), offset)
        if how == AS_ONE:
            return super().fit(train, setting, final=final)
        machines = [str(name) for name in np.unique(train.side.labels["machine"])]
        found = {}
        with one_blas_thread():
            for name in machines:
                own = train.of(train.side.labels["machine"] == name)
                panels = np.unique(own.side.labels["panel"])
                if sound_count(own) >= LEAST_SOUND and len(panels) >= FOLDS:
                    found[name] = self.taught(own, setting, final=final)
            if len(found) < len(machines):
                # too few of some machine: one detector of all of them
                found = {"": self.taught(train, setting, final=final)} | found
        return Taught(found)


@dataclass(frozen=True, eq=False)
class Centred:
    """A model of throws less what their kind of machine has in common.

    Attributes
    ----------
    model : Model
        Of what is left.
    offset : mapping of str to ndarray, shape (n_signals, n_samples)
        By machine.
    """

    model: Model
    offset: Mapping[str, Floats]

    def score(self, judged: Judged) -> Floats:
        """Return the score of what is left."""
        return self.model.score(less_offset(judged, self.offset))

    def judge(self, judged: Judged) -> tuple[Floats, Mapping[str, Any]]:
        """Return the same, and further fields of `Verdicts`."""
        return self.model.judge(less_offset(judged, self.offset))


def machine_offsets(side: Side) -> dict[str, Floats]:
    """Return by how much the mean sound throw of each machine differs from that of all of them."""
    machine = side.labels["machine"]
    sound = np.isin(side.labels["role"], [SOUND, HISTORY])
    means = {str(name): side.clean[sound & (machine == name)].mean(axis=0)
             for name in np.unique(machine[sound])}  # fmt: skip
    middle = np.mean(list(means.values()), axis=0)
    return {name: mean - middle for name, mean in means.items()}


def less_offset(judged: Judged, offset: Mapping[str, Floats]) -> Judged:
    """Return throws less the offset of their machine; a machine without one keeps its throws."""
    if not offset:
        return judged
    nothing = np.zeros_like(next(iter(offset.values())))

    def less(side: Side) -> Side:
        own = np.array([offset.get(str(name), nothing) for name in side.labels["machine"]])
        own = own.reshape(len(side.throw), *nothing.shape)
        return replace(
            side,
            histories=side.histories - own,
            features=side.features - window_features(own, judged.layout),
            clean=side.clean - own if len(side.clean) else side.clean,
        )

    return replace(
        judged,
        side=less(judged.side),
        known=less(judged.known),
        everything=less(judged.everything),
    )
