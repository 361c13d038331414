"""Stone, ice, snow, wood and metal along a prescribed compression: force, memory, energy.

Reference: the closed forms of docs/use/objects.md, written here again over the compression alone. A
light mass is moved in and out by a stiff spring; the force at each instant must be that of the
closed form to 1e-6 of its peak, and what is dissipated the area of the loop.
"""

from collections.abc import Callable

import numpy as np
import pytest
from tests.verification.hand_made import (
    curve_of,
    energy_residual,
    hand_made,
    linear_spring,
    obstruction,
    run,
)

from turnout.law.object_kind import Compression
from turnout.law.table import LawTableBuilder
from turnout.solver.integration import History

CLOSE = 1e-6
CONTACT, SIZE, CLEARANCE = 40e6, 0.02, 0.003
LENGTH, DEPTH, AREA = 0.03, 0.02, 6e-4
FROST = 263.15
CURVES: dict[str, Compression] = {
    "stone": curve_of("stone", size=SIZE, strength=20e6, contact=CONTACT, piece=0.6),
    "ice": curve_of("ice", size=SIZE, area=AREA, strength=10e6, contact=CONTACT, piece=0.2),
    "snow": curve_of(
        "snow", size=SIZE, area=AREA, density=300.0, temperature=FROST, contact=CONTACT
    ),
    "wood": curve_of("wood", size=SIZE, area=AREA, strength=5e6, contact=CONTACT),
    "metal": curve_of("metal", size=SIZE, area=1e-5, strength=235e6, contact=CONTACT),
}


def way(reach: float) -> Callable[[np.ndarray], np.ndarray]:
    """Go in three times, each time deeper, and out again."""
    return lambda t: reach * (0.4 + 0.2 * np.floor(t)) * np.sin(np.pi * (t % 1.0)) ** 2


def moved(
    curve: Compression, *, step: float = 1e-3, deepest: float = 0.0, **options: bool
) -> History:
    laws = LawTableBuilder()
    linear_spring(laws, 0, 1e10, input_index=0)
    law = laws.add_piecewise(
        0, breakpoints=curve.breakpoints, slopes=curve.slopes, offset=CLEARANCE, waits=True
    )
    memory = obstruction(law, curve, size=SIZE, deepest=deepest)
    mechanism = hand_made(laws, mass=[1.0], obstructions=memory)
    return run(mechanism, way(0.02), end=3.0, step=step, **options)


def compression(history: History) -> np.ndarray:
    return history.g[:, 0] - CLEARANCE


def stone_force(e: np.ndarray, *, late: bool = False) -> np.ndarray:
    """Return the force, where `late` with failures after the instants at which they are passed."""
    size, lost, found = SIZE, 0.0, []
    for value in e:
        trial = CONTACT * max(value - lost, 0.0)
        if late:
            found.append(min(trial, 20e6 * size**2))
        while trial > 20e6 * size**2:
            lost, size = lost + 0.4 * size, 0.6 * size
            trial = CONTACT * max(value - lost, 0.0)
        if not late:
            found.append(trial)
    return np.array(found)


ICE_STIFFNESS = 1.0 / (1.0 / CONTACT + SIZE / (9e9 * AREA))
ICE_FORCE, CYCLE, LASTING = 10e6 * AREA, 0.1 * SIZE, 0.8 * SIZE
ICE_MEAN = 0.3 * ICE_FORCE + ICE_FORCE**2 / (2.0 * ICE_STIFFNESS * CYCLE)  # falls to zero


def ice_force(e: np.ndarray, *, late: bool = False) -> np.ndarray:
    k, limit = ICE_STIFFNESS, ICE_FORCE
    deepest, found, broken = 0.0, [], False

    def on(x: float) -> float:
        return max(min(k * x, limit), k * (x - LASTING))

    for value in e:
        fails = not broken and value > ICE_FORCE / k + 0.3 * CYCLE
        if fails and not late:
            broken, limit = True, ICE_MEAN
        deepest = max(deepest, value)
        found.append(max(on(deepest) - k * (deepest - value), 0.0))
        if fails and late:
            broken, limit = True, ICE_MEAN
    return np.array(found)


def dented_force(points: np.ndarray, k: float) -> Callable[[np.ndarray], np.ndarray]:
    """Return the force of an envelope through (lasting compression, force) that keeps its dent."""
    envelope = np.vstack(([0.0, 0.0], points + np.outer(points[:, 1] / k, [1.0, 0.0])))

    def force(e: np.ndarray) -> np.ndarray:
        def on(x: float) -> float:
            beyond = max(x - envelope[-1, 0], 0.0)
            return float(np.interp(x, *envelope.T)) + k * beyond

        deepest, found = 0.0, []
        for value in e:
            back = on(deepest) - k * (deepest - value)
            found.append(on(value) if value > deepest else max(back, 0.0))
            deepest = max(deepest, value)
        return np.array(found)

    return force


def snow_force(e: np.ndarray) -> np.ndarray:
    density = np.geomspace(300.0, 917.0, 12)
    force = 10e6 * (density / 917.0) ** 4.5 * AREA
    k = 1.0 / (1.0 / CONTACT + SIZE / (9e9 * AREA))
    return dented_force(np.column_stack((SIZE * (1.0 - 300.0 / density), force)), k)(e)


def wood_force(e: np.ndarray) -> np.ndarray:
    k = 1.0 / (1.0 / CONTACT + SIZE / (0.4e9 * AREA))
    limit = 5e6 * AREA
    points = [[0.0, limit], [0.5 * SIZE, 2.0 * limit], [0.65 * SIZE, 10.0 * limit]]
    return dented_force(np.array(points), k)(e)


def metal_force(e: np.ndarray) -> np.ndarray:
    k = 1.0 / (1.0 / CONTACT + SIZE / (210e9 * 1e-5))
    points = [[0.0, 2350.0], [0.5 * SIZE, 2350.0 + 2e9 * 1e-5 * 0.5]]
    return dented_force(np.array(points), k)(e)


FORCES: dict[str, Callable[..., np.ndarray]] = {
    "stone": stone_force,
    "ice": ice_force,
    "snow": snow_force,
    "wood": wood_force,
    "metal": metal_force,
}


@pytest.mark.parametrize("kind", CURVES)
def test_the_force_follows_the_closed_form(kind: str) -> None:
    history = moved(CURVES[kind])
    e, force = compression(history), history.law_force[:, 1]
    off = np.abs(force - FORCES[kind](e))
    if kind in ("stone", "ice"):  # a failure may fall on a stored instant
        off = np.minimum(off, np.abs(force - FORCES[kind](e, late=True)))
    assert force.max() > 1000.0
    assert history.obstructions.dissipated[0] > 0.9
    assert np.max(off) < CLOSE * force.max()


@pytest.mark.parametrize("kind", CURVES)
def test_what_is_dissipated_is_the_area_of_the_loop(kind: str) -> None:
    history = moved(CURVES[kind], step=2e-4)
    at = np.arange(history.time.size)
    e = np.interp(np.arange(0.0, at[-1], 0.1), at, compression(history))
    force = FORCES[kind](e)
    area = float(np.sum(0.5 * (force[1:] + force[:-1]) * np.diff(e)))
    dissipated = float(history.obstructions.dissipated[0])
    assert dissipated == pytest.approx(history.ledger[-1, 6], rel=1e-12)
    assert dissipated == pytest.approx(area, rel=0.02)
    assert np.all(np.diff(history.ledger[:, 6]) >= -1e-9)
    assert energy_residual(history) < CLOSE
    assert energy_residual(history, without="objects") > 1e-3


def test_a_stone_splits_at_the_square_of_its_size() -> None:
    history = moved(CURVES["stone"])
    assert 0.8 < history.law_force[:, 1].max() / (20e6 * SIZE**2) <= 1.0 + CLOSE
    assert history.obstructions.broken[0] >= 2
    assert history.obstructions.size[0] == pytest.approx(
        SIZE * 0.6 ** int(history.obstructions.broken[0]), rel=CLOSE
    )


def test_a_stone_without_a_piece_is_gone() -> None:
    curve = curve_of("stone", size=SIZE, strength=20e6, contact=CONTACT, piece=0.0)
    history = moved(curve)
    peak = int(np.argmax(history.law_force[:, 1]))
    assert history.obstructions.size[0] == 0.0
    assert np.all(history.law_force[peak + 1 :, 1] == 0.0)


def test_ice_fails_once_and_is_crushed_at_the_mean_force_of_its_saw_tooth() -> None:
    history = moved(CURVES["ice"])
    force, e = history.law_force[:, 1], compression(history)
    before = e < ICE_FORCE / ICE_STIFFNESS + 0.3 * CYCLE
    first = int(np.argmin(before))
    assert force[:first].max() == pytest.approx(ICE_FORCE, rel=CLOSE)
    assert force[first : first + 20] == pytest.approx(ICE_MEAN, rel=CLOSE)
    assert history.obstructions.broken[0] == 1


def test_ice_dissipates_the_closed_form() -> None:
    """Crushing at the full force, the elastic part that falls, and the mean force from there."""
    for step in (1e-3, 4e-3):
        history = moved(CURVES["ice"], step=step)
        found = float(history.obstructions.dissipated[0])
        left = float(history.obstructions.deepest[0]) - ICE_MEAN / ICE_STIFFNESS
        first = 0.3 * CYCLE * ICE_FORCE
        first += 0.5 * (ICE_FORCE**2 - ICE_MEAN**2) / ICE_STIFFNESS
        lasting = 0.3 * CYCLE + (ICE_FORCE - ICE_MEAN) / ICE_STIFFNESS
        assert found == pytest.approx(first + ICE_MEAN * (left - lasting), rel=1e-6)


def test_stone_dissipates_the_closed_form() -> None:
    for step in (1e-3, 4e-3):
        obstructions = moved(CURVES["stone"], step=step).obstructions
        forces = 20e6 * (SIZE * 0.6 ** np.arange(int(obstructions.broken[0]))) ** 2
        elastic = float(np.sum(forces**2) / (2.0 * CONTACT))
        assert obstructions.dissipated[0] == pytest.approx(elastic, rel=1e-6)


@pytest.mark.parametrize("kind", ["snow", "wood", "metal"])
def test_a_dent_that_was_there_before_is_remembered(kind: str) -> None:
    before = moved(CURVES[kind])
    deepest = float(before.obstructions.deepest[0])
    again = moved(CURVES[kind], deepest=deepest)
    e = compression(again)
    expected = FORCES[kind](np.concatenate(([deepest], e)))[1:]
    peak = again.law_force[:, 1].max()
    assert np.max(np.abs(again.law_force[:, 1] - expected)) < CLOSE * peak
    assert abs(again.obstructions.dissipated[0]) < 1e-3 * before.obstructions.dissipated[0]


@pytest.mark.parametrize("kind", CURVES)
def test_without_inertia_the_force_follows_the_closed_form_too(kind: str) -> None:
    history = moved(CURVES[kind], inertia=False)
    late = {"late": True} if kind in ("stone", "ice") else {}
    expected = FORCES[kind](compression(history), **late)
    force = history.law_force[:, 1]
    assert np.max(np.abs(force - expected)) < CLOSE * force.max()
    assert energy_residual(history) < CLOSE
