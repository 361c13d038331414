r"""Steady sliding of a mechanism, and the complex modes about it.

While a foot slides, its friction follows the momentary normal force, so the force of a friction law
on its row depends on another row: :math:`T = s \mu N(g_n)`, with `s` the sense of sliding. The laws
then add to the linear system

.. math:: \lambda = D g + b, \qquad D = D_0 - \sum s \mu k_n\, e_t e_n^T ,

with :math:`D_0` diagonal (the slopes of the laws less those folded into the linear system) and an
unsymmetric part that couples the row of a friction law `t` to that of its normal law `n`. With the
modes and the residual flexibility of `turnout.solver.modal`,

.. math::

    \ddot q + C \dot q + \left(\Lambda - \Phi^T D (I - R D)^{-1} \Phi\right) q = 0 ,

an unsymmetric stiffness: two modes may merge and draw energy from the sliding though Coulomb's
coefficient is constant (mode coupling, flutter). Source of the mechanism: Hoffmann, Fischer,
Allgaier and Gaul, Mechanics Research Communications 29(4), 2002, doi:10.1016/S0093-6413(02)00254-9,
whose two-mass example these equations contain. Valid as long as no foot changes between open,
sliding and sticking: this shows whether a vibration grows, not how large it becomes.

Where friction follows the speed v of a foot, :math:`T = s \mu(v) N`, a swing about steady sliding
adds :math:`\mu'(v) N \dot g_t`, a damper of negative sign where friction falls:

.. math:: C \mapsto C + \Phi^T (I - D R)^{-1} \operatorname{diag}(\mu'(v) N)\, \Phi .

The speed in the swing is that of the modes alone, as in the steps of `turnout.solver.obstruct`.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from turnout.mechanism.mechanism import Mechanism
from turnout.solver.condense import base_stiffness
from turnout.solver.modal import ModalModel

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Complexes = NDArray[np.complex128]

ITERATIONS, ALL_AT_ONCE = 600, 40
PASSES, LEVEL_TOLERANCE = 20, 1e-9
"""Passes in which the speeds of feet and friction at them are sought, and when they end [-]."""


@dataclass(frozen=True, slots=True, eq=False)
class Sliding:
    """A mechanism that rests or slides steadily.

    Attributes
    ----------
    segment : ndarray of int, shape (n_laws,)
        Segment of every law.
    force : ndarray, shape (n_laws,)
        Force with which every law resists [N].
    displacement : ndarray, shape (n_rows,)
        Of every row [m].
    coupling : ndarray, shape (n_rows, n_rows)
        D: what the laws add to the linear system [N/m].
    settled : bool
        Whether every law agrees with the solution; if not, no steady sliding was found.
    damping : ndarray, shape (n_rows,)
        Slope of friction over the speed of each row, negative where it falls [N s/m].
    """

    segment: Ints
    force: Floats
    displacement: Floats
    coupling: Floats
    settled: bool
    damping: Floats


@dataclass(frozen=True, slots=True, eq=False)
class ComplexModes:
    """Eigenvalues of the linear motion about rest or steady sliding, one of each pair.

    Attributes
    ----------
    eigenvalues : ndarray of complex, shape (n,)
        In the order of their magnitude, imaginary part not negative [1/s].
    shapes : ndarray of complex, shape (n_modes, n)
        In modal coordinates of the model.
    """

    eigenvalues: Complexes
    shapes: Complexes

    @property
    def frequencies(self) -> Floats:
        """Damped frequencies [Hz]; 0 for a motion that does not swing."""
        return self.eigenvalues.imag / (2.0 * np.pi)

    @property
    def damping_ratio(self) -> Floats:
        """Share of critical damping [-]; negative for a growing vibration."""
        return -self.eigenvalues.real / np.abs(self.eigenvalues)

    @property
    def growth_rate(self) -> Floats:
        """Rate at which an amplitude grows, negative if it decays [1/s]."""
        return self.eigenvalues.real


def steady_sliding(
    mechanism: Mechanism,
    model: ModalModel,
    *,
    inputs: Floats,
    sense: float,
    friction_factor: float = 1.0,
    rate: Floats | None = None,
) -> Sliding:
    """Find the state in which every foot that carries slides the same way.

    Parameters
    ----------
    mechanism : Mechanism
        Laws that wait for room (foreign objects) stay away.
    model : ModalModel
        Condensed from it.
    inputs : ndarray, shape (n_inputs,)
        Marker positions [m].
    sense : float
        +1.0 where the feet slide in the direction of their rows, -1.0 against it, 0.0 for rest
        without friction.
    friction_factor : float
        Multiplies every friction coefficient [-].
    rate : ndarray, shape (n_inputs,), optional
        Speeds of the markers, by which friction follows its curve over speed [m/s]; default its
        level in motion.
    """
    curves = mechanism.courses
    level: Floats = np.ones(mechanism.laws.friction_row.size)
    state = _sliding_at(mechanism, model, inputs, sense * friction_factor * level)
    if rate is None or not curves.has_curves:
        return state
    for _ in range(PASSES):
        weight = sense * friction_factor * level
        speed = np.abs(_row_speeds(mechanism, model, state, rate, weight))
        before = level
        level, slope = curves.over_speed(speed[mechanism.laws.friction_row])
        state = _sliding_at(mechanism, model, inputs, sense * friction_factor * level)
        if np.allclose(level, before, rtol=0.0, atol=LEVEL_TOLERANCE):
            break
    laws, damping = mechanism.laws, np.zeros(model.row_load.size)
    normal = np.maximum(state.force[laws.friction_normal], 0.0)
    falls = friction_factor * laws.friction_coefficient * slope * normal
    np.add.at(damping, laws.friction_row, abs(sense) * falls)
    return replace(state, damping=damping)


def _row_speeds(
    mechanism: Mechanism, model: ModalModel, state: Sliding, rate: Floats, factor: Floats
) -> Floats:
    """Return the speeds of rows while the markers move on and no law changes its segment [m/s]."""
    laws, rows = mechanism.laws, model.row_load.size
    flexibility = (model.row_modes / model.eigenvalues) @ model.row_modes.T + model.flexibility
    moving = np.where(laws.input_index >= 0, rate[laws.input_index], 0.0)
    pushed = np.where(laws.waits == 0, laws.slope[laws.segment_start[:-1] + state.segment], 0.0)
    pushed = pushed * moving
    shift = np.zeros(rows)
    np.add.at(shift, laws.row, pushed)
    of_normal = factor * laws.friction_coefficient * pushed[laws.friction_normal]
    np.add.at(shift, laws.friction_row, of_normal)
    right: Floats = flexibility @ shift
    return np.asarray(np.linalg.solve(np.eye(rows) - flexibility @ state.coupling, right))


def _sliding_at(mechanism: Mechanism, model: ModalModel, inputs: Floats, factor: Floats) -> Sliding:
    """Return the steady sliding whose coefficients are multiplied by factors with their sense."""
    laws, rows = mechanism.laws, model.row_load.size
    flexibility = (model.row_modes / model.eigenvalues) @ model.row_modes.T + model.flexibility
    unloaded = model.row_modes @ (model.load / model.eigenvalues) + model.row_load
    present = laws.waits == 0
    driven = laws.input_index >= 0
    zero = laws.offset + np.where(driven, inputs[laws.input_index] if inputs.size else 0.0, 0.0)
    segment = np.where(laws.base_segment >= 0, laws.base_segment, _segments_at_zero(mechanism))
    weight = factor * laws.friction_coefficient
    settled = False
    for iteration in range(ITERATIONS):
        at = laws.segment_start[:-1] + segment
        slope = np.where(present, laws.slope[at], 0.0)
        constant = np.where(present, laws.intercept[at] - laws.slope[at] * zero, 0.0)
        coupling = law_coupling(mechanism, slope=slope, weight=weight)
        shift = np.zeros(rows)
        np.add.at(shift, laws.row, -constant)
        np.add.at(shift, laws.friction_row, -weight * constant[laws.friction_normal])
        right: Floats = unloaded + flexibility @ shift
        g = np.linalg.solve(np.eye(rows) - flexibility @ coupling, right).astype(np.float64)
        wanted = np.where(present, _segments(mechanism, g[laws.row] - zero), segment)
        changed = np.flatnonzero(wanted != segment)
        if not changed.size:
            settled = True
            break
        # All at once is quick; one at a time breaks cycles in which laws undo each other.
        step = changed if iteration < ALL_AT_ONCE else changed[iteration % changed.size][None]
        segment[step] += np.sign(wanted[step] - segment[step])
    force: Floats = slope * g[laws.row] + constant
    return Sliding(segment, force, g, coupling, settled, np.zeros(rows))


def law_coupling(
    mechanism: Mechanism, *, slope: Floats, weight: Floats, stick: Floats | None = None
) -> Floats:
    """Form D: contribution of the laws on their present branches to the linear system.

    Parameters
    ----------
    mechanism : Mechanism
        Whose laws couple the rows.
    slope : ndarray, shape (n_laws,)
        Of every law on its segment, 0 where it is absent [N/m].
    weight : ndarray, shape (n_frictions,)
        Sense of sliding times friction coefficient, 0 where a foot does not slide [-].
    stick : ndarray, shape (n_frictions,), optional
        Stiffness of the feet that stick, 0 where they do not [N/m].

    Returns
    -------
    ndarray, shape (n_rows, n_rows)
        [N/m]
    """
    laws, rows = mechanism.laws, mechanism.rows.shape[0]
    normal = laws.friction_normal
    coupling = np.zeros((rows, rows))
    np.add.at(coupling, (laws.row, laws.row), base_stiffness(laws) - slope)
    np.add.at(coupling, (laws.friction_row, laws.row[normal]), -weight * slope[normal])
    if stick is not None:
        np.add.at(coupling, (laws.friction_row, laws.friction_row), -stick)
    return coupling


def stick_coupling(mechanism: Mechanism, state: Sliding) -> Floats:
    """Return the coupling of a state whose carrying feet stick instead, shape (n_rows, n_rows).

    Parameters
    ----------
    mechanism : Mechanism
        Whose laws couple the rows.
    state : Sliding
        At rest, found with ``sense=0.0``.
    """
    laws = mechanism.laws
    carries = state.force[laws.friction_normal] > 0.0
    return law_coupling(
        mechanism,
        slope=np.where(laws.waits == 0, laws.slope[laws.segment_start[:-1] + state.segment], 0.0),
        weight=np.zeros(laws.friction_row.size),
        stick=np.where(carries, laws.stick_stiffness, 0.0),
    )


def complex_modes(
    model: ModalModel,
    coupling: Floats,
    *,
    damping: Floats | None = None,
    with_shapes: bool = True,
) -> ComplexModes:
    """Solve for the free motion of a condensed system with coupled laws.

    Parameters
    ----------
    model : ModalModel
        Its cut-off bounds what can be said: an instability above it, or one that needs a mode above
        it, is not seen.
    coupling : ndarray, shape (n_rows, n_rows)
        D of the module's equations [N/m].
    damping : ndarray, shape (n_rows,), optional
        Slope of friction over the speed of each row [N s/m].
    with_shapes : bool
        Without shapes it takes a third of the time; `shapes` has no rows then.

    Examples
    --------
    >>> from turnout.solver.modal import LinearSystem, split_modes
    >>> given = np.array([[0.4]]), np.zeros(1), np.eye(1)
    >>> model, _ = split_modes(LinearSystem(np.array([[100.0]]), np.eye(1), *given), 10.0)
    >>> found = complex_modes(model, np.array([[0.0]]))
    >>> found.damping_ratio.round(6).tolist()
    [0.02]
    """
    rows, size = model.row_load.size, model.eigenvalues.size
    given = np.zeros(rows) if damping is None else damping
    pushed = np.hstack([coupling @ model.row_modes, given[:, np.newaxis] * model.row_modes])
    force = np.linalg.solve(np.eye(rows) - coupling @ model.flexibility, pushed)
    stiffness = model.stiffness - model.row_modes.T @ force[:, :size]
    # Scaled time makes both halves of the state alike in size.
    scale = float(np.sqrt(np.median(model.eigenvalues)))
    matrix = np.zeros((2 * size, 2 * size))
    matrix[:size, size:] = scale * np.eye(size)
    matrix[size:, :size] = -stiffness / scale
    matrix[size:, size:] = -(model.damping + model.row_modes.T @ force[:, size:])
    if with_shapes:
        values, vectors = np.linalg.eig(matrix)
    else:
        values, vectors = np.linalg.eigvals(matrix), np.empty((0, 2 * size))
    upper = np.flatnonzero(values.imag >= 0.0)
    order = upper[np.argsort(np.abs(values[upper]), kind="stable")]
    shapes = vectors[:size, order]
    return ComplexModes(
        eigenvalues=values[order].astype(np.complex128), shapes=shapes.astype(np.complex128)
    )


def reduced_shapes(model: ModalModel, coupling: Floats, shapes: Complexes) -> Complexes:
    """Return the reduced coordinates of shapes, their static part included, shape (n_dof, n)."""
    rows = model.row_load.size
    force = np.linalg.solve(np.eye(rows) - coupling @ model.flexibility, coupling @ model.row_modes)
    found: Complexes = (model.modes + model.residual_shapes @ force) @ shapes
    return found


def _segments_at_zero(mechanism: Mechanism) -> Ints:
    """Return the segment of every law at zero argument."""
    return _segments(mechanism, np.zeros(mechanism.laws.row.size))


def _segments(mechanism: Mechanism, argument: Floats) -> Ints:
    laws = mechanism.laws
    inner = laws.segment_upper < np.inf
    law_of = np.repeat(np.arange(laws.row.size), np.diff(laws.segment_start))
    passed = inner & (argument[law_of] > laws.segment_upper)
    return np.bincount(law_of[passed], minlength=laws.row.size).astype(np.int64)
