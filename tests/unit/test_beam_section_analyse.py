"""Analysis of outlines: invariances, several stations, and what is refused."""

import numpy as np
import pytest

from turnout.beam.outline import Outline, make_outline, mirror, move, rotate, scale
from turnout.beam.section_analysis import SectionAnalysis, analyse_outline, analyse_outlines
from turnout.beam.section_record import SectionProperties, mirror_sections
from turnout.core.errors import MechanicsError

# No symmetry, a re-entrant corner and walls of different thickness.
SKEW = make_outline([[0, 0], [0.08, 0], [0.07, 0.02], [0.03, 0.03], [0.02, 0.11], [-0.01, 0.12]])
# Other triangles may cover a moved outline; at this refinement that shows below 2e-3.
MESH = 2e-3


def one(outline: Outline, **options: float) -> dict[str, float]:
    """Return all results of one outline by name."""
    run = analyse_outline(outline, **options)
    values = {name: getattr(run.properties, name) for name in SectionProperties.__slots__}
    values |= {name: getattr(run, name) for name in SectionAnalysis.__slots__[1:]}
    return {name: float(value[0]) for name, value in values.items()}


HERE = one(SKEW)


def test_quarter_turn_swaps_lateral_and_vertical() -> None:
    there = one(rotate(SKEW, angle=0.5 * np.pi))
    for stem in ("second_moment", "shear_factor"):
        for a, b in (("lateral", "vertical"), ("vertical", "lateral")):
            assert there[f"{stem}_{a}"] == pytest.approx(HERE[f"{stem}_{b}"], rel=MESH)
    for name in ("product_moment", "shear_coupling"):
        assert there[name] == pytest.approx(-HERE[name], rel=20 * MESH)
    assert there["shear_centre_y"] == pytest.approx(-HERE["shear_centre_z"], abs=1e-5)
    assert there["shear_centre_z"] == pytest.approx(HERE["shear_centre_y"], abs=1e-5)
    assert there["torsion_constant"] == pytest.approx(HERE["torsion_constant"], rel=MESH)
    assert there["warping_constant"] == pytest.approx(HERE["warping_constant"], rel=5 * MESH)


def test_mirrored_outline_has_mirrored_properties() -> None:
    run = analyse_outline(mirror(SKEW)).properties
    wanted = mirror_sections(analyse_outline(SKEW).properties)
    for name in SectionProperties.__slots__:
        here, there = getattr(wanted, name)[0], getattr(run, name)[0]
        assert there == pytest.approx(here, rel=MESH, abs=1e-12), name


def test_move_only_moves() -> None:
    there = one(move(SKEW, y=0.5, z=-3.0))
    shifts = {"_y": 0.5, "_z": -3.0}
    for name, value in HERE.items():
        wanted = value + shifts.get(name[-2:], 0.0)
        if not name.startswith("error"):
            assert there[name] == pytest.approx(wanted, rel=MESH, abs=1e-9), name


def test_scaling_laws() -> None:
    there = one(scale(SKEW, factor=10.0))
    powers = {
        "area": 2,
        "torsion_constant": 4,
        "second_moment_lateral": 4,
        "warping_constant": 6,
        "shear_factor_lateral": 0,
        "shear_factor_vertical": 0,
        "shear_coupling": 0,
        "shear_centre_y": 1,
        "principal_angle": 0,
    }
    for name, power in powers.items():
        assert there[name] == pytest.approx(10.0**power * HERE[name], rel=1e-6), name


def test_shear_flexibility_is_a_tensor_without_poissons_ratio() -> None:
    turn = 0.4
    flat, turned = (one(o, poisson_ratio=0.0) for o in (SKEW, rotate(SKEW, angle=turn)))
    tensors = [
        np.array(
            [
                [1 / run["shear_factor_lateral"], run["shear_coupling"]],
                [run["shear_coupling"], 1 / run["shear_factor_vertical"]],
            ]
        )
        for run in (flat, turned)
    ]
    rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    np.testing.assert_allclose(tensors[1], rotation @ tensors[0] @ rotation.T, atol=2 * MESH)


def test_poissons_ratio_enters_only_the_shear_factors() -> None:
    rubber = one(SKEW, poisson_ratio=0.5)
    changed = {name for name, value in HERE.items() if rubber[name] != value}
    assert changed == {
        "shear_factor_lateral",
        "shear_factor_vertical",
        "shear_coupling",
        "error_shear_factor",
    }


def test_stations_are_those_of_the_single_outlines() -> None:
    square = make_outline([[0, 0], [0.1, 0], [0.1, 0.1], [0, 0.1]])
    both = analyse_outlines([square, SKEW])
    assert both.properties.area.shape == (2,)
    assert both.properties.torsion_constant[1] == HERE["torsion_constant"]
    assert both.principal_angle[0] == 0.0


def test_finer_mesh_says_that_it_errs_less() -> None:
    fine = one(SKEW, refinements=4)
    for name in ("error_torsion", "error_shear_factor", "error_shear_centre"):
        assert fine[name] < 0.3 * HERE[name]
    assert fine["torsion_constant"] < HERE["torsion_constant"]
    assert one(SKEW, element_length=0.004)["error_torsion"] < HERE["error_torsion"]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"poisson_ratio": -1.0}, "Poisson's ratio"),
        ({"poisson_ratio": 0.6}, "Poisson's ratio"),
        ({"refinements": 0}, "at least 1"),
        ({"element_length": 0.0}, "must be positive"),
        ({"element_length": -0.01}, "must be positive"),
    ],
)
def test_bad_options_are_refused(options: dict[str, float], words: str) -> None:
    with pytest.raises(MechanicsError, match=words):
        analyse_outline(SKEW, **options)


def test_no_outlines_are_refused() -> None:
    with pytest.raises(MechanicsError, match="no outlines"):
        analyse_outlines([])
