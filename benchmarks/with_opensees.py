"""SB1 in OpenSeesPy: its own Timoshenko beams, zero-length springs, Newmark's average acceleration.

All laws are its compiled materials. Friction is elastic-plastic with the limit of the normal force
at rest, which SB1 keeps all the time. Damping is by the initial stiffness, so that a factor serves
until a law changes its segment.
"""

import ctypes
import importlib.util
from pathlib import Path
from types import ModuleType

import numpy as np

from benchmarks.sb1 import Answer, Floats, LinearSystem, at_rest, markers_of, panel_of
from turnout.mechanism.build import rail_data

RESERVE = 10.0
"""Reach of the tables of piecewise-linear laws [m]."""


def engine() -> ModuleType:
    """Load OpenSees with the libraries that it brings along."""
    found = importlib.util.find_spec("openseespylinux")
    if found is not None and found.submodule_search_locations:
        folder = Path(next(iter(found.submodule_search_locations))) / "lib"
        for name in ("quadmath.so.0", "gfortran.so.4", "gomp.so.1", "blas.so.3", "lapack.so.3"):
            if (folder / f"lib{name}").exists():
                ctypes.CDLL(str(folder / f"lib{name}"), mode=ctypes.RTLD_GLOBAL)
    import openseespy.opensees as ops

    return ops  # type: ignore[no-any-return]


class _Model:
    """Numbers of nodes, materials and elements of the model in OpenSees."""

    def __init__(self, ops: ModuleType, system: LinearSystem, case: str) -> None:
        self.ops, self.stations = ops, system.stations
        self.panel, self.objects = panel_of(case)
        self.data = rail_data(self.panel, self.objects)[0]
        self.next = {"node": 0, "material": 0, "element": 0}
        self.weight = -system.stations.normal_stiffness * at_rest(system)[system.stations.vertical]
        self.beams: list[int] = []
        self.node_of = {round(float(x), 6): i + 1 for i, x in enumerate(self.data.x)}
        self.ground: dict[float, int] = {}
        ops.wipe()
        ops.model("basic", "-ndm", 3, "-ndf", 6)
        self.rail()
        self.supports()
        self.friction = [self.chair(s) for s in range(self.weight.size)]
        self.drives = [self.drive(number) for number in range(2)]

    def new(self, what: str) -> int:
        """Return the next number."""
        self.next[what] += 1
        return self.next[what]

    def rail(self) -> None:
        """Add nodes with lumped masses, beams and weight."""
        ops, data = self.ops, self.data
        section, material = data.sections, data.material
        shear = material.youngs_modulus / (2 * (1 + material.poisson_ratio))
        length = np.diff(data.x)
        for x in data.x:
            ops.node(self.new("node"), float(x), 0.0, 0.0)
        lumped = np.zeros((data.x.size, 6))
        vertical, lateral = section.second_moment_vertical, section.second_moment_lateral
        shares = [section.area] * 3 + [vertical + lateral, vertical, lateral]
        for k, value in enumerate(shares):
            share = 0.5 * material.density * length * value
            lumped[:-1, k] += share
            lumped[1:, k] += share
        ops.geomTransf("Linear", 1, 0.0, 0.0, 1.0)
        for i, row in enumerate(lumped):
            ops.mass(i + 1, *row.tolist())
        area = section.area
        for e in range(length.size):
            self.beams.append(self.new("element"))
            ops.element(
                "ElasticTimoshenkoBeam", self.beams[-1], e + 1, e + 2,
                material.youngs_modulus, shear, float(area[e]), float(section.torsion_constant[e]),
                float(vertical[e]), float(lateral[e]),
                float(section.shear_factor_lateral[e] * area[e]),
                float(section.shear_factor_vertical[e] * area[e]), 1,
            )  # fmt: skip
        ops.timeSeries("Constant", 1)
        ops.pattern("Plain", 1, 1)
        for i, row in enumerate(lumped):
            ops.load(i + 1, 0.0, 0.0, -self.data.gravity * float(row[2]), 0.0, 0.0, 0.0)

    def fixed(self, x: float) -> int:
        """Return a node of the ground at a place."""
        key = round(x, 6)
        if key not in self.ground:
            self.ground[key] = self.new("node")
            self.ops.node(self.ground[key], x, 0.0, 0.0)
            self.ops.fix(self.ground[key], *[1] * 6)
        return self.ground[key]

    def material(self, kind: str, *numbers: object) -> int:
        """Add a uniaxial material."""
        number = self.new("material")
        self.ops.uniaxialMaterial(kind, number, *numbers)
        return number

    def spring(self, ground: int, x: float, materials: list[int], directions: list[int]) -> int:
        """Add a zero-length spring that lengthens with the rail's displacement."""
        number = self.new("element")
        node = self.node_of[round(x, 6)]
        self.ops.element(
            "zeroLength", number, ground, node, "-mat", *materials, "-dir", *directions,
        )  # fmt: skip
        return number

    def supports(self) -> None:
        """Add the fastenings."""
        direction = {"ux": 1, "uy": 2, "uz": 3, "rx": 4, "ry": 5, "rz": 6}
        for item in self.data.supports:
            number = self.material("Elastic", item.stiffness)
            x = item.point.x
            self.spring(self.fixed(x), x, [number], [direction[item.point.direction]])

    def contact(self, stiffness: float, clearance: float) -> int:
        """Return a material that resists beyond a clearance, in the positive direction."""
        reach = clearance + RESERVE
        strain = ["-strain", -RESERVE, clearance, reach]
        return self.material(
            "ElasticMultiLinear", *strain, "-stress", 0.0, 0.0, RESERVE * stiffness
        )

    def chair(self, s: int) -> int:
        """Add contact, friction and stop of a chair; return the element of friction."""
        stations = self.stations
        x = self.x(s)
        ground = self.fixed(x)
        stiffness = stations.normal_stiffness
        strain = ["-strain", -RESERVE, 0.0, RESERVE]
        below = self.material(
            "ElasticMultiLinear", *strain, "-stress", -RESERVE * stiffness, 0.0, 0.0
        )
        self.spring(ground, x, [below], [3])
        stop = self.contact(stations.stop_stiffness, float(stations.gap[s]))
        self.spring(ground, x, [stop], [2])
        limit = stations.friction_coefficient * float(self.weight[s])
        slide = self.material(
            "ElasticPP", stations.stick_stiffness, limit / stations.stick_stiffness
        )
        return self.spring(ground, x, [slide], [2])

    def x(self, s: int) -> float:
        """Return the place of a station."""
        return list(self.panel.chair.values())[s].x

    def drive(self, number: int) -> tuple[int, int]:
        """Add a drive; return its element and the node of its marker."""
        stations = self.stations
        x = self.x(int(np.flatnonzero(stations.drive == number)[0]))
        stiffness, limit = stations.drive_stiffness[number], stations.drive_limit[number]
        reach = float(limit / stiffness)
        far = float(limit + (RESERVE - reach) * stations.saturated_stiffness)
        law = self.material(
            "ElasticMultiLinear",
            *("-strain", -RESERVE, -reach, reach, RESERVE),
            *("-stress", -far, -float(limit), float(limit), far),
        )
        marker = self.new("node")
        self.ops.node(marker, x, 0.0, 0.0)
        self.ops.fix(marker, 1, 0, 1, 1, 1, 1)
        return self.spring(marker, x, [law], [2]), marker

    def place_object(self) -> int:
        """Add the object; return its element."""
        stations = self.stations
        s = int(np.flatnonzero(stations.object > 0)[0])
        law = self.contact(stations.object_stiffness, float(stations.gap[s] - stations.object_size))
        return self.spring(self.fixed(self.x(s)), self.x(s), [law], [2])


def run(system: LinearSystem, *, case: str, step: float) -> Answer:
    """Throw the rail of a case once."""
    ops = engine()
    model = _Model(ops, system, case)
    steps = round(model.panel.schedule.end / step)
    times = step * np.arange(steps + 1)
    markers, there = markers_of(case, times)
    _rest(ops)
    _move(ops, model, markers, step)
    _dynamic(ops, model)
    record = np.zeros((model.weight.size + 3, times.size))
    trapped, failed = 0, 0
    for t in range(1, times.size):
        if there[t] and not trapped:
            trapped = model.place_object()
        elif trapped and not there[t]:
            ops.remove("element", trapped)
            trapped = 0
        failed += ops.analyze(1, step) != 0
        for s, element in enumerate(model.friction):
            record[s, t] = ops.eleResponse(element, "material", 1, "stress")[0]
        for d, (element, _marker) in enumerate(model.drives):
            record[model.weight.size + d, t] = ops.eleResponse(element, "material", 1, "stress")[0]
        if trapped:
            record[-1, t] = ops.eleResponse(trapped, "material", 1, "stress")[0]
    count = model.weight.size
    work = {"steps": steps, "unconverged": failed}
    return Answer(times, -record[count : count + 2], record[-1], -record[:count], work)


def _rest(ops: ModuleType) -> None:
    """Find the static equilibrium."""
    ops.constraints("Transformation")
    ops.numberer("RCM")
    ops.system("BandGen")
    ops.test("NormUnbalance", 1e-6, 20)
    ops.algorithm("Newton")
    ops.integrator("LoadControl", 0.0)
    ops.analysis("Static")
    if ops.analyze(1):
        message = "OpenSees found no static equilibrium"
        raise RuntimeError(message)
    ops.loadConst("-time", 0.0)
    ops.wipeAnalysis()


def _move(ops: ModuleType, model: _Model, markers: Floats, step: float) -> None:
    """Prescribe the motion of the markers."""
    for number, (_element, marker) in enumerate(model.drives):
        series = 2 + number
        ops.timeSeries("Path", series, "-dt", step, "-values", *markers[number].tolist())
        ops.pattern("Plain", series, series)
        ops.sp(marker, 2, 1.0)


def _dynamic(ops: ModuleType, model: _Model) -> None:
    """Set up the steps in time."""
    factor = model.data.damping[1]
    ops.region(1, "-ele", *model.beams, "-rayleigh", 0.0, 0.0, factor, 0.0)
    ops.constraints("Transformation")
    ops.numberer("RCM")
    ops.system("BandSPD")
    ops.test("NormUnbalance", 1e-3, 40)
    ops.algorithm("KrylovNewton")
    ops.integrator("Newmark", 0.5, 0.25)
    ops.analysis("Transient")
