"""Prismatic rails reduced one by one and put together by hand, without a panel file."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag
from tests.verification.hand_made import ALL_MODES

from turnout.beam.material import ElasticMaterial
from turnout.beam.section_record import SectionProperties
from turnout.law.table import LawTableBuilder
from turnout.mechanism.mechanism import Matrices, Mechanism, Point, RailData, ReducedRail, Support
from turnout.mechanism.reduce import reduce_rail

Floats = NDArray[np.float64]
STEEL = ElasticMaterial(youngs_modulus=2.1e11, poisson_ratio=0.3, density=7850.0)
E, G, RHO = STEEL.youngs_modulus, STEEL.shear_modulus, STEEL.density
AREA, I_VERTICAL, I_LATERAL = 9.3e-3, 1.73e-5, 7.4e-6
EI, LINE_MASS = E * I_LATERAL, RHO * AREA
RIGID_IN_SHEAR = 100.0
"""Shear factor with which a beam of metres obeys Euler and Bernoulli to about 1e-5."""


def prismatic_rail(
    length: float,
    points: Sequence[Point],
    *,
    nodes: Floats,
    clamped: bool = True,
    shear_factor: float = RIGID_IN_SHEAR,
    supports: Sequence[Support] = (),
    gravity: float = 0.0,
    first: int = 0,
) -> ReducedRail:
    """Reduce a rail of constant section with all its modes; `clamped` holds it at x = length."""
    x = np.unique(np.round(np.concatenate((nodes, [0.0, length])), 9))
    values = {
        "area": AREA,
        "second_moment_vertical": I_VERTICAL,
        "second_moment_lateral": I_LATERAL,
        "product_moment": 0.0,
        "torsion_constant": 2.7e-6,
        "shear_factor_vertical": shear_factor,
        "shear_factor_lateral": shear_factor,
        "centroid_y": 0.0,
        "centroid_z": 0.0,
        "shear_centre_y": 0.0,
        "shear_centre_z": 0.0,
    }
    full = {name: np.full(x.size - 1, value) for name, value in values.items()}
    data = RailData(
        name=f"at {first}",
        closes=1.0,
        x=x,
        axis_height=np.zeros(x.size),
        sections=SectionProperties(**full),
        material=STEEL,
        gravity=gravity,
        clamped=("last",) if clamped else (),
        damping=(0.0, 0.0),
        supports=tuple(supports),
        dashpots=(),
        points=tuple(points),
        cutoff_frequency=ALL_MODES,
    )
    return reduce_rail(data, first=first)


def joined(
    laws: LawTableBuilder,
    rails: Sequence[ReducedRail],
    rows: Sequence[Sequence[tuple[int, int]]],
    *,
    load: Floats | None = None,
) -> Mechanism:
    """Put rails and laws together; a row is a sum over (rail, index of its point)."""
    starts = np.concatenate(([0], np.cumsum([rail.body.count for rail in rails])))
    matrix = np.zeros((len(rows), starts[-1]))
    for number, parts in enumerate(rows):
        for rail, point in parts:
            matrix[number, starts[rail] : starts[rail + 1]] += rails[rail].rows[point]
    table = laws.table()
    weight = np.concatenate([rail.load for rail in rails])
    return Mechanism(
        matrices=Matrices(
            stiffness=block_diag(*(rail.stiffness for rail in rails)),
            mass=block_diag(*(rail.mass for rail in rails)),
            damping=block_diag(*(rail.damping for rail in rails)),
            load=weight if load is None else weight + load,
        ),
        core=matrix,
        laws=table,
        law_names=tuple(f"law {i}" for i in range(table.row.size)),
        friction_names=tuple(f"foot {i}" for i in range(table.friction_row.size)),
        rails=tuple(rail.body for rail in rails),
    )
