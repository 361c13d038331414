"""The matrices of a panel's rails for other programs: whole, and as superelements."""

import re

import numpy as np
import scipy.sparse as sp

from turnout.core.threads import one_blas_thread
from turnout.mechanism.build import rail_data
from turnout.mechanism.mechanism import RailData
from turnout.mechanism.reduce import superelement_of
from turnout.mechanism.structure import bare_structure
from turnout.panel.matrices import DIRECTIONS, matrices_bytes
from turnout.panel.model import Panel
from turnout.panel.records import RailMatrices


def export_matrices(panel: Panel) -> dict[str, bytes]:
    """Return the content of two MATLAB files for each rail.

    Parameters
    ----------
    panel : Panel
        A checked panel; foreign objects are left out.

    Returns
    -------
    dict of str to bytes
        By file name: ``rail_NAME.mat`` holds the bare rail, ``rail_NAME_superelement.mat`` what is
        left after the reduction, with its fastenings. Either can stand in for the rail's beams, as
        ``rail.NAME.matrices``.
    """
    files: dict[str, bytes] = {}
    with one_blas_thread():
        for data in rail_data(panel):
            stem = _file_stem(data.name, files)
            files[f"{stem}.mat"] = _full_matrices(data, panel.gravity)
            files[f"{stem}_superelement.mat"] = _superelement_matrices(data, panel.gravity)
    return files


def _full_matrices(data: RailData, gravity: float) -> bytes:
    bare = bare_structure(data)
    if data.matrices is not None:
        given = data.matrices
    else:
        given = RailMatrices(
            stiffness=bare.stiffness,
            mass=bare.mass,
            damping=bare.damping,
            unit_weight=bare.load / gravity if gravity else None,
            x=np.repeat(bare.x, len(DIRECTIONS)),
            z=np.repeat(data.axis_height, len(DIRECTIONS)),
            direction=DIRECTIONS * bare.x.size,
            rows=None,
            with_supports=False,
            digest="",
        )
    return matrices_bytes(given, extra={"rail": data.name})


def _superelement_matrices(data: RailData, gravity: float) -> bytes:
    structure, element, damping = superelement_of(data)
    transformation = element.transformation
    rows = sp.csr_array(structure.motion @ transformation)
    given = RailMatrices(
        stiffness=sp.csr_array(element.stiffness),
        mass=sp.csr_array(element.mass),
        damping=sp.csr_array(0.5 * (damping + damping.T)),
        unit_weight=transformation.T @ structure.load / gravity if gravity else None,
        x=np.repeat(structure.x, len(DIRECTIONS))[structure.known],
        z=np.zeros(int(np.count_nonzero(structure.known))),
        direction=tuple(np.tile(DIRECTIONS, structure.x.size)[structure.known].tolist()),
        rows=sp.csr_array(rows[np.flatnonzero(structure.known)]),
        with_supports=True,
        digest="",
    )
    names = np.array([structure.names[i] for i in element.interface], dtype=object)
    return matrices_bytes(
        given,
        extra={
            "rail": data.name,
            "transformation": sp.csc_matrix(transformation),
            "interface_names": names[:, np.newaxis],
            "frequencies_kept": element.frequencies_kept[:, np.newaxis],
            "cutoff_frequency": element.cutoff_frequency,
        },
    )


def _file_stem(name: str, taken: dict[str, bytes]) -> str:
    """Return a file name for a rail, whatever its name holds."""
    plain = re.sub(r"[^A-Za-z0-9-]+", "_", name).strip("_") or "unnamed"
    stem = plain if plain.startswith("stock_rail") else f"rail_{plain}"
    while f"{stem}.mat" in taken:
        stem += "_"
    return stem
