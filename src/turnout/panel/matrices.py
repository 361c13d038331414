"""Rails of a panel that come as matrices: their files, and whether what stands there fits."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from turnout.files.problems import Problem, choices, show_value
from turnout.files.regular import user_path
from turnout.panel.matrices_file import read_rail_matrices
from turnout.panel.rail_matrices import RailMatrices

SAME_PLACE = 1e-6
# What something at a rail moves with or acts on.
USES = {
    "chair": ("uy", "uz", "rx"),
    "stop": ("uy", "rx"),
    "stud": ("uy", "rx"),
    "drive": ("uy", "rx"),
    "link": ("uy", "rx"),
    "back_drive": ("uy", "rx"),
}
FASTENING = {
    "stiffness_x": ("ux", "ry"),
    "stiffness_y": ("uy", "rx"),
    "stiffness_z": ("uz",),
    "stiffness_roll": ("rx",),
    "stiffness_pitch": ("ry",),
    "stiffness_yaw": ("rz",),
}

Known = dict[str, RailMatrices]


def read_matrices(
    rails: object, *, folder: Path | None, known: Mapping[str, RailMatrices]
) -> tuple[Known, list[Problem]]:
    """Read the files that rails name.

    Parameters
    ----------
    rails : object
        The table of rails of a document.
    folder : Path or None
        Where relative paths start: the folder of the panel file.
    known : mapping of str to RailMatrices
        Files that were read before, by the name given, so that a panel made from another one does
        not need them.

    Returns
    -------
    matrices : dict of str to RailMatrices
        By the name given.
    problems : list of Problem
        What is wrong with each file.
    """
    found, problems = dict(known), list[Problem]()
    for name, rail in rails.items() if isinstance(rails, dict) else ():
        given = rail.get("matrices") if isinstance(rail, dict) else None
        if not isinstance(given, str) or given in found:
            continue
        matrices, faults = read_rail_matrices((folder or Path()) / user_path(given))
        path = ("rail", name, "matrices")
        problems += [Problem(path, f" = {show_value(given)}: {fault}") for fault in faults]
        if matrices is not None:
            found[given] = matrices
    return found, problems


def check_matrices(records: Mapping[str, Any], matrices: Known) -> Iterator[Problem]:
    """Yield what stands at a rail where its matrices have no node or no coordinate.

    Parameters
    ----------
    records : mapping
        Records by field of the panel, all valid.
    matrices : dict of str to RailMatrices
        By the name given in the rail.
    """
    for name, rail in records["rail"].items():
        given = matrices.get(rail.matrices) if rail.matrices is not None else None
        if given is None:
            continue
        lacking: dict[str, list[str]] = {}
        places: dict[float, set[str]] = {}
        for x, direction in zip(given.x.tolist(), given.direction, strict=True):
            places.setdefault(x, set()).add(direction)
        nodes = np.array(list(places))
        for label, x, directions in _standing(records, name, given):
            nearest = float(nodes[np.argmin(np.abs(nodes - x))])
            if abs(nearest - x) > SAME_PLACE:
                text = f"no node where there is {{}}: the nearest to x = {x:g} m is {nearest:g} m"
                lacking.setdefault(text, []).append(label)
            elif missing := [d for d in directions if d not in places[nearest]]:
                text = f"no {' and no '.join(missing)} at x = {x:g} m, which {{}} needs"
                lacking.setdefault(text, []).append(label)
        for text, labels in lacking.items():
            yield Problem(
                ("rail", name, "matrices"),
                f" = {show_value(rail.matrices)}: has "
                + text.format(choices(labels, most=4).replace("'", ""))
                + "; add it to the model and its table",
            )


def _standing(
    records: Mapping[str, Any], rail: str, given: RailMatrices
) -> Iterator[tuple[str, float, tuple[str, ...]]]:
    """Yield what stands at a rail, where, and what it uses of the rail's motion there."""
    for family, directions in USES.items():
        for name, item in records[family].items():
            rails = item.rail if family == "drive" else item.rails
            if rails is None or rail in ([rails] if isinstance(rails, str) else rails):
                yield f"{family} {name}", item.x, directions
    if given.with_supports:
        return
    for name, item in records["fastening"].items():
        if item.rails is not None and rail not in item.rails:
            continue
        used = [d for key, ds in FASTENING.items() if getattr(item, key) > 0 for d in ds]
        yield f"fastening {name}", item.x, tuple(dict.fromkeys(used))
