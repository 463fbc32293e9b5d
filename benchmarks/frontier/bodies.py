"""The scenes of rigid bodies and springs in the tools that are made for them: MuJoCo, Exudyn, Pinocchio, SymPy.

Closed loops are left out: MuJoCo's are soft, so that no step is small enough for an error of 1e-6, and Exudyn's and
Pinocchio's are a matter of formulations with parameters of their own, which a comparison at equal error cannot choose.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from benchmarks.frontier.scenes import Scene
from benchmarks.frontier.tools import Call, Maker, NotExpressed, solved_by_scipy

GRAVITY = 9.81
MASSES, MASS, STIFFNESS = 100, 0.01, 1e4  # of the string
BARS = 5  # of 1 kg and 1 m
FIXED_STEP = {"pendulum, 2000 s": 0.3, "string of 100 masses": 1e-3, "chain of 5 bars": 0.2}  # s, of steps in scale


def step_count(scene: Scene, rtol: float, order: int) -> int:
    """Return the steps of equal length between two output times, as many as suit an error of about `rtol`."""
    times = scene.times()
    return math.ceil((times[1] - times[0]) / (FIXED_STEP[scene.name] * rtol ** (1 / order)))


def absolute_angles(values: np.ndarray) -> np.ndarray:
    """Return angles to the horizontal and their rates (times, 2n) of those between one bar and the next."""
    return np.cumsum(values.reshape(len(values), 2, -1), axis=2).reshape(len(values), -1)


def _one_of(makers: dict[str, Callable], scene: Scene):
    if scene.name not in makers:
        raise NotExpressed("no scene of bodies in a tree or of springs alone")
    return makers[scene.name]


# ---------------------------------------------------------------------- MuJoCo


def mujoco_rk4(scene: Scene, rtol: float) -> Call:
    """MuJoCo's Runge–Kutta method with steps of equal length."""
    world, angles = _one_of(_MUJOCO, scene)()
    import mujoco

    times, each = scene.times(), step_count(scene, rtol, 4)
    option = f'<option timestep="{float(times[1] - times[0]) / each!r}" integrator="RK4" gravity="0 0 -{GRAVITY}"/>'
    model = mujoco.MjModel.from_xml_string(f"<mujoco>{option}{world}</mujoco>")
    data, start = mujoco.MjData(model), scene.hand()[1]

    def call() -> np.ndarray:
        mujoco.mj_resetData(model, data)
        data.qpos[:] = start[: model.nq]
        values = np.empty((len(times), len(start)))
        for k in range(len(times)):
            if k:
                mujoco.mj_step(model, data, nstep=each)
            values[k, : model.nq], values[k, model.nq :] = data.qpos, data.qvel
        return (absolute_angles(values) if angles else values)[:, scene.columns()]

    return call


def _mujoco_bars(count: int, inertial: str) -> str:
    body = ""
    for k in reversed(range(count)):
        hinge = '<joint type="hinge" axis="0 -1 0"/>'
        body = f'<body pos="{1.0 if k else 0.0} 0 0">{hinge}{inertial}{body}</body>'
    return f"<worldbody>{body}</worldbody>"


def _mujoco_pendulum() -> tuple[str, bool]:
    point = '<inertial pos="0 0 -1" mass="1" diaginertia="1e-12 1e-12 1e-12"/>'
    return _mujoco_bars(1, point), False


def _mujoco_chain() -> tuple[str, bool]:
    inertia = f"1e-12 {1 / 12} {1 / 12}"
    return _mujoco_bars(BARS, f'<inertial pos="0.5 0 0" mass="1" diaginertia="{inertia}"/>'), True


def _mujoco_string() -> tuple[str, bool]:
    """Return masses that slide, with tendons between them as springs, and the outer springs at their joints."""
    masses, springs = "", ""
    for i in range(MASSES):
        outer = f'stiffness="{STIFFNESS}"' if i in (0, MASSES - 1) else ""
        slide = f'<joint name="s{i}" type="slide" axis="1 0 0" {outer}/>'
        masses += f'<body>{slide}<inertial pos="0 0 0" mass="{MASS}" diaginertia="1e-6 1e-6 1e-6"/></body>'
    for i in range(MASSES - 1):
        ends = f'<joint joint="s{i}" coef="-1"/><joint joint="s{i + 1}" coef="1"/>'
        springs += f'<fixed stiffness="{STIFFNESS}" springlength="0">{ends}</fixed>'
    return f"<worldbody>{masses}</worldbody><tendon>{springs}</tendon>", False


_MUJOCO = {
    "pendulum, 2000 s": _mujoco_pendulum,
    "string of 100 masses": _mujoco_string,
    "chain of 5 bars": _mujoco_chain,
}


# ---------------------------------------------------------------------- Exudyn


def exudyn_with(method: str, order: int) -> Maker:
    """Exudyn's explicit methods with steps of equal length, whose output times are those of the others."""

    def make(scene: Scene, rtol: float) -> Call:
        build = _one_of(_EXUDYN, scene)
        import exudyn as exu

        system = exu.SystemContainer().AddSystem()
        nodes, angles = build(exu, system, scene.hand()[1])
        kinds = exu.OutputVariableType.Coordinates, exu.OutputVariableType.Coordinates_t
        inside = {"sensorType": "Node", "storeInternal": True, "writeToFile": False, "fileName": ""}
        sensors = [
            system.AddSensor({**inside, "nodeNumber": node, "outputVariableType": kind})
            for kind in kinds
            for node in nodes
        ]
        system.Assemble()
        times, each = scene.times(), step_count(scene, rtol, order)
        settings = exu.SimulationSettings()
        settings.timeIntegration.endTime = times[-1]
        settings.timeIntegration.numberOfSteps = each * (len(times) - 1)
        settings.timeIntegration.verboseMode = 0
        settings.solution.file.write = False
        settings.solution.sensors.writePeriod = times[1] - times[0]

        def call() -> np.ndarray:
            system.systemData.SetSystemState(initial)
            system.systemData.SetTime(0.0)
            system.SolveDynamic(settings, solverType=getattr(exu.DynamicSolverType, method), updateInitialValues=False)
            values = np.column_stack([system.GetSensorStoredData(sensor)[:, 1:] for sensor in sensors])
            if len(values) != len(times):
                raise RuntimeError(f"{len(values)} output times in place of {len(times)}")
            return (absolute_angles(values) if angles else values)[:, scene.columns()]

        initial = system.systemData.GetSystemState(configuration=exu.ConfigurationType.Initial)
        return call

    return make


def _exudyn_tree(count: int, centre: list[float], inertia: np.ndarray):
    def build(exu, system, start: np.ndarray) -> tuple[list[int], bool]:
        node = system.AddNode({"nodeType": "GenericODE2", "referenceCoordinates": [0.0] * count,
                               "initialCoordinates": start[:count].tolist(),
                               "initialCoordinates_t": start[count:].tolist(),
                               "numberOfODE2Coordinates": count})  # fmt: skip
        system.AddObject({
            "objectType": "KinematicTree", "nodeNumber": node, "jointTypes": [exu.JointType.RevoluteZ] * count,
            "linkParents": list(range(-1, count - 1)),
            "jointTransformations": exu.Matrix3DList([np.eye(3)] * count),
            "jointOffsets": exu.Vector3DList([[1.0 if k else 0.0, 0.0, 0.0] for k in range(count)]),
            "linkInertiasCOM": exu.Matrix3DList([inertia] * count), "linkCOMs": exu.Vector3DList([centre] * count),
            "linkMasses": [1.0] * count, "baseOffset": [0.0, 0.0, 0.0], "gravity": [0.0, -GRAVITY, 0.0],
        })  # fmt: skip
        return [node], True

    return build


def _exudyn_string(exu, system, start: np.ndarray) -> tuple[list[int], bool]:
    ground = system.AddNode({"nodeType": "PointGround", "referenceCoordinates": [0.0, 0.0, 0.0]})
    marker = {"markerType": "NodeCoordinate", "coordinate": 0}
    ends, nodes = [system.AddMarker({**marker, "nodeNumber": ground})], []
    for q, v in start.reshape(2, -1).T.tolist():
        one = {"nodeType": "1D", "referenceCoordinates": [0.0], "initialCoordinates": [q], "initialVelocities": [v]}
        nodes.append(system.AddNode(one))
        system.AddObject({"objectType": "Mass1D", "physicsMass": MASS, "nodeNumber": nodes[-1]})
        ends.append(system.AddMarker({**marker, "nodeNumber": nodes[-1]}))
    ends.append(ends[0])
    spring = {"objectType": "ConnectorCoordinateSpringDamper", "stiffness": STIFFNESS}
    for pair in zip(ends, ends[1:], strict=False):
        system.AddObject({**spring, "markerNumbers": list(pair)})
    return nodes, False


_EXUDYN = {
    "pendulum, 2000 s": _exudyn_tree(1, [0.0, -1.0, 0.0], np.eye(3) * 1e-13),
    "string of 100 masses": _exudyn_string,
    "chain of 5 bars": _exudyn_tree(BARS, [0.5, 0.0, 0.0], np.diag([1e-13, 1 / 12, 1 / 12])),
}


# ---------------------------------------------------------------------- Pinocchio


def pinocchio_aba(scene: Scene, rtol: float) -> Call:
    """Pinocchio's articulated-body algorithm as the right-hand side of SciPy's DOP853."""
    build = _one_of(_PINOCCHIO, scene)
    import pinocchio as pin

    model, angles, forces = build(pin)
    model.gravity.linear = np.array([0.0, -GRAVITY, 0.0])
    data, n = model.createData(), model.nv

    def rhs(_: float, x: np.ndarray) -> np.ndarray:
        q, v = x[:n], x[n:]
        if angles:
            q, v = np.diff(q, prepend=0.0), np.diff(v, prepend=0.0)
        a = pin.aba(model, data, q, v, forces(q))
        return np.concatenate([x[n:], np.cumsum(a) if angles else a])

    return solved_by_scipy(rhs, scene, rtol)


def _pinocchio_bars(count: int, centre: list[float], inertia: np.ndarray):
    def build(pin):
        model, parent = pin.Model(), 0
        for k in range(count):
            place = pin.SE3(np.eye(3), np.array([1.0 if k else 0.0, 0.0, 0.0]))
            parent = model.addJoint(parent, pin.JointModelRZ(), place, f"pin{k}")
            model.appendBodyToJoint(parent, pin.Inertia(1.0, np.array(centre), inertia), pin.SE3.Identity())
        return model, True, lambda _: np.zeros(count)

    return build


def _pinocchio_string(pin):
    model = pin.Model()
    for k in range(MASSES):
        joint = model.addJoint(0, pin.JointModelPX(), pin.SE3.Identity(), f"slide{k}")
        model.appendBodyToJoint(joint, pin.Inertia(MASS, np.zeros(3), np.eye(3) * 1e-6), pin.SE3.Identity())
    return model, False, lambda q: np.diff(STIFFNESS * np.diff(q, prepend=0.0, append=0.0))


_PINOCCHIO = {
    "pendulum, 2000 s": _pinocchio_bars(1, [0.0, -1.0, 0.0], np.eye(3) * 1e-13),
    "string of 100 masses": _pinocchio_string,
    "chain of 5 bars": _pinocchio_bars(BARS, [0.5, 0.0, 0.0], np.diag([1e-13, 1 / 12, 1 / 12])),
}


# ---------------------------------------------------------------------- SymPy


def sympy_lagrange(scene: Scene, rtol: float) -> Call:
    """Equations of Lagrange that `sympy.physics.mechanics` derives, as NumPy functions, with SciPy's DOP853."""
    if scene.name not in _SYMPY:
        raise NotExpressed("no Lagrangian is written for it")
    rhs = scene.once("sympy", lambda: _lagrange(*_SYMPY[scene.name]()))
    return solved_by_scipy(rhs, scene, rtol)


def _lagrange(lagrangian, q: list, loss=0, closed=()) -> Callable[[float, np.ndarray], np.ndarray]:
    """Return ``(t, (q, v)) -> rate`` of a Lagrangian with Rayleigh's function and constraints between positions."""
    import sympy as sp
    from sympy.physics.mechanics import LagrangesMethod, dynamicsymbols

    t, n = dynamicsymbols._t, len(q)
    rates = [sp.diff(x, t) for x in q]
    method = LagrangesMethod(lagrangian, q, hol_coneqs=list(closed) or None)
    method.form_lagranges_equations()
    friction = sp.Matrix([-sp.diff(loss, v) for v in rates])
    forcing = method.forcing_full
    forcing[n : 2 * n, 0] = forcing[n : 2 * n, 0] + friction
    names = sp.symbols(f"x:{2 * n}")
    plain = dict(zip([*rates, *q], [*names[n:], *names[:n]], strict=True))
    matrices = [sp.Matrix(m).subs(plain) for m in (method.mass_matrix_full, forcing)]
    evaluate = sp.lambdify([t, names], matrices, cse=True)

    def rhs(time: float, x: np.ndarray) -> np.ndarray:
        matrix, right = evaluate(time, x)
        return np.linalg.solve(matrix, right)[: 2 * n, 0]

    return rhs


def _coordinates(count: int):
    from sympy.physics.mechanics import dynamicsymbols

    q = dynamicsymbols(f"q:{count}")
    return dynamicsymbols._t, q, [x.diff(dynamicsymbols._t) for x in q]


def _sympy_pendulum():
    import sympy as sp

    _, q, v = _coordinates(1)
    return v[0] ** 2 / 2 + sp.Float(GRAVITY) * sp.cos(q[0]), q


def _sympy_quarter_car():
    import sympy as sp

    t, q, v = _coordinates(2)
    u = sp.Float(0.05) * sp.sin(6 * t)
    kinetic = 25 * v[0] ** 2 + 150 * v[1] ** 2
    potential = 80000 * (q[0] - u) ** 2 + 8000 * (q[1] - q[0]) ** 2 + sp.Float(GRAVITY) * (50 * q[0] + 300 * q[1])
    return kinetic - potential, q, 50 * (v[0] - u.diff(t)) ** 2 + 600 * (v[1] - v[0]) ** 2


def _sympy_car_axis():
    import sympy as sp

    t, q, v = _coordinates(4)
    xl, yl, xr, yr = q
    k = sp.Float(10 * 1e-4 / 2)
    yb = sp.Float(0.1) * sp.sin(10 * t)
    xb = sp.sqrt(1 - yb**2)
    lengths = sp.sqrt(xl**2 + yl**2), sp.sqrt((xr - xb) ** 2 + (yr - yb) ** 2)
    potential = sum((length - sp.Float(0.5)) ** 2 / 2 for length in lengths) + k * (yl + yr)
    closed = xl * xb + yl * yb, (xl - xr) ** 2 + (yl - yr) ** 2 - 1
    return k * sum(rate**2 for rate in v) / 2 - potential, q, 0, closed


def _sympy_chain():
    import sympy as sp

    _, q, v = _coordinates(BARS)
    x, y, lagrangian = sp.Integer(0), sp.Integer(0), sp.Integer(0)
    t = _coordinates(0)[0]
    for angle, rate in zip(q, v, strict=True):
        cx, cy = x + sp.cos(angle) / 2, y + sp.sin(angle) / 2
        lagrangian += (cx.diff(t) ** 2 + cy.diff(t) ** 2) / 2 + rate**2 / 24 - sp.Float(GRAVITY) * cy
        x, y = x + sp.cos(angle), y + sp.sin(angle)
    return lagrangian, q


_SYMPY = {
    "pendulum, 2000 s": _sympy_pendulum,
    "quarter car": _sympy_quarter_car,
    "car axis": _sympy_car_axis,
    "chain of 5 bars": _sympy_chain,
}
