"""SB1 in Exudyn: the linear system as one object, all laws in user functions that are compiled.

The object's force and Jacobian user functions evaluate the same laws as the banded program; the
anchors of friction move on after each step. The trapezoidal rule (generalised-alpha with spectral
radius 1) with a modified Newton that renews its Jacobian when it contracts too slowly.
"""

import exudyn
import numpy as np
import scipy.sparse as sp
from exudyn.itemInterface import NodeGenericODE2, ObjectGenericODE2, VObjectGenericODE2

from benchmarks.sb1 import Answer, Floats, LinearSystem, evaluate, markers_of
from turnout.panel.load import load_panel

TOLERANCE = 1e-6
"""Of Newton's residual; tighter ones cost ten times as much and change nothing that is judged."""


class _Laws:
    """The state of all laws between calls of Exudyn."""

    def __init__(self, system: LinearSystem, rest: Floats, *, case: str, step: float) -> None:
        stations = system.stations
        self.case, self.step = case, step
        self.lateral, self.vertical = stations.lateral, stations.vertical
        self.arrays = stations.arrays()
        self.count = self.lateral.size
        self.out = np.zeros((9, self.count))
        self.signs = np.zeros((5, self.count), dtype=np.int64)
        self.anchor = rest[self.lateral].copy()
        self.steps = round(load_panel("sb1").schedule.end / step)
        times = step * np.arange(self.steps + 1)
        self.markers, self.there = markers_of(case, times)
        self.markers = np.ascontiguousarray(self.markers.T)
        self.force = np.zeros(rest.size)
        self.record = np.zeros((self.count + 3, self.steps + 1))
        self.evaluations = self.jacobians = 0
        places = np.concatenate((self.lateral, self.lateral, self.vertical))
        columns = np.concatenate((self.lateral, self.vertical, self.vertical))
        self.places = np.stack((places, columns), axis=1).astype(float)
        self.at(rest, 0)
        self.store(0)

    def at(self, q: Floats, number: int) -> None:
        """Evaluate the laws."""
        evaluate(
            *self.arrays,
            q[self.lateral], q[self.vertical], self.anchor, self.markers[number],
            self.there[number], self.out, self.signs,
        )  # fmt: skip

    def number(self, time: float) -> int:
        """Return the number of the step that ends at a time."""
        return min(round(time / self.step), self.steps)

    def resist(self, mbs: object, time: float, item: int, q: Floats, q_t: Floats) -> Floats:
        """Return the force of all laws on the coordinates."""
        self.evaluations += 1
        self.at(np.asarray(q), self.number(time))
        self.force[self.lateral] = -self.out[0]
        self.force[self.vertical] = -self.out[1]
        return self.force

    def derivative(
        self, mbs: object, time: float, item: int, q: Floats, q_t: Floats, factor: float, _: float
    ) -> Floats:
        """Return the laws' part of the Jacobian."""
        self.jacobians += 1
        self.at(np.asarray(q), self.number(time))
        return factor * self.out[2:5].ravel()

    def store(self, number: int) -> None:
        """Keep forces, move anchors on."""
        count, out = self.count, self.out
        self.record[:count, number] = -out[5]
        drive = self.arrays[0][2]
        for at in np.flatnonzero(drive >= 0):
            self.record[count + drive[at], number] = out[6, at]
        self.record[count + 2, number] = out[7].sum()
        stick = self.arrays[3][2]
        self.anchor = self.lateral_now - out[5] / stick if number else self.anchor

    def finish_step(self, mbs: object, time: float) -> bool:
        """Store a step that has been accepted."""
        q = np.asarray(mbs.systemData.GetODE2Coordinates())  # type: ignore[attr-defined]
        number = self.number(time)
        self.at(q, number)
        self.lateral_now = q[self.lateral]
        self.store(number)
        return True


def run(system: LinearSystem, rest: Floats, *, case: str, step: float, dense: bool) -> Answer:
    """Throw the rail of a case once."""
    laws = _Laws(system, rest, case=case, step=step)
    container = exudyn.SystemContainer()
    mbs = container.AddSystem()
    size = rest.size
    node = mbs.AddNode(
        NodeGenericODE2(
            referenceCoordinates=np.zeros(size),
            initialCoordinates=rest,
            initialCoordinates_t=np.zeros(size),
            numberOfODE2Coordinates=size,
        )
    )

    def jacobian(*given: object) -> exudyn.MatrixContainer:
        values = laws.derivative(*given)  # type: ignore[arg-type]
        acts = values != 0.0
        found = exudyn.MatrixContainer()
        if dense:
            matrix = np.zeros((size, size))
            rows, columns = laws.places[acts].astype(int).T
            matrix[rows, columns] = values[acts]
            found.SetWithDenseMatrix(matrix, useDenseMatrix=True)
        else:
            triplets = np.column_stack((laws.places[acts], values[acts]))
            found.SetWithSparseMatrix(triplets, size, size, useDenseMatrix=False)
        return found

    mbs.AddObject(
        ObjectGenericODE2(
            nodeNumbers=[node],
            massMatrix=_container(system.mass, dense=dense),
            stiffnessMatrix=_container(system.stiffness, dense=dense),
            dampingMatrix=_container(system.damping, dense=dense),
            forceVector=system.load,
            forceUserFunction=laws.resist,
            jacobianUserFunction=jacobian,
            visualization=VObjectGenericODE2(show=False),
        )
    )
    mbs.SetPostStepUserFunction(laws.finish_step)
    mbs.Assemble()
    settings = _settings(laws.steps, step, dense=dense)
    done = mbs.SolveDynamic(
        settings, solverType=exudyn.DynamicSolverType.GeneralizedAlpha, showHints=False
    )
    count = laws.count
    work = {
        "steps": laws.steps,
        "evaluations": laws.evaluations,
        "Jacobians": laws.jacobians,
        "unconverged": 0 if done else 1,
    }
    record = laws.record
    times = step * np.arange(laws.steps + 1)
    return Answer(times, record[count : count + 2], record[count + 2], record[:count], work)


def _container(matrix: object, *, dense: bool) -> exudyn.MatrixContainer:
    found = exudyn.MatrixContainer()
    if dense:
        found.SetWithDenseMatrix(matrix.toarray(), useDenseMatrix=True)  # type: ignore[attr-defined]
    else:
        found.SetWithSparseMatrix(sp.csr_matrix(matrix))  # type: ignore[attr-defined]
    return found


def _settings(steps: int, step: float, *, dense: bool) -> exudyn.SimulationSettings:
    settings = exudyn.SimulationSettings()
    integration = settings.timeIntegration
    integration.numberOfSteps, integration.endTime = steps, steps * step
    integration.verboseMode = 0
    integration.newton.useModifiedNewton = True
    integration.newton.relativeTolerance = TOLERANCE
    integration.newton.modifiedNewtonJacUpdatePerStep = False
    integration.generalizedAlpha.spectralRadius = 1.0
    integration.generalizedAlpha.computeInitialAccelerations = True
    settings.solution.file.write = False
    kind = exudyn.LinearSolverType
    settings.linearSolver.solverType = kind.EXUdense if dense else kind.EigenSparse
    return settings
