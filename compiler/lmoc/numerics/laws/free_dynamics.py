"""A scene with all laws open: the quantities of its laws, and their dependence on forces and states.

The free scene is evaluated, in which the forces are given from outside: the laws leave no implicit block in it, so that
most scenes are one casadi function with its derivatives. Where it has other states than the switched form, or nonlinear
blocks, which have to be followed from place to place, the switched form with all laws open gives the same values.
"""

from __future__ import annotations

import ctypes
from collections.abc import Mapping, Sequence
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from lmoc.ir.flat import Kind
from lmoc.ir.law import JENKINS, NONE, LawKind, Switched
from lmoc.ir.program import Solve, needed_steps, walk
from lmoc.lower.blocks import derivatives_tape
from lmoc.lower.tape import Tape
from lmoc.messages.diagnostics import Report
from lmoc.numerics.evaluate.casadi_system import CasadiDerivatives
from lmoc.numerics.evaluate.function import TapeFunction
from lmoc.numerics.laws.bound_function import fits_casadi, given_registers
from lmoc.numerics.plan.linearity import linear_registers
from lmoc.numerics.plan.plan import Plan, build_plan
from lmoc.numerics.signals.signals import Constant, Signal, sample
from lmoc.numerics.solve.interpreter import Interpreter
from lmoc.numerics.solve.jacobian import Jacobian
from lmoc.numerics.solve.rounding import Rounding
from lmoc.structure.laws.switched import POSITION
from lmoc.support.records import dataclass

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Quantities:
    """Where the quantities of the laws are, an entry for each law.

    Attributes
    ----------
    variables : (6, n) of the flat model, NONE for none: gap, rate, level, limits while slipping and while sticking, and
        the force of Jenkins friction, which is a state
    registers : (6, n) of the plan, -1 for what the program does not compute
    """

    variables: Indices
    registers: Indices

    def known_variables(self, plan: Plan) -> Indices:
        """Return which (6, n) are constants or parameters, NONE for the others."""
        kind = plan.reduced.flat.kind[self.variables]
        return np.where((self.variables != NONE) & (kind <= Kind.PARAMETER), self.variables, NONE)

    def known(self, plan: Plan, values: Array) -> Array:
        """Return the values (6, n) of these, NaN for the others."""
        variables = self.known_variables(plan)
        return np.where(variables != NONE, values[variables], np.nan)


def quantities_of(plan: Plan, form: Switched, degree: Indices) -> Quantities:
    """Return the places of the laws' quantities in a plan.

    Parameters
    ----------
    form : of the plan's flat model
    degree : (n,) relative degrees
    """
    level = np.where(degree == POSITION, form.level, np.where(degree == 0, form.gap, form.rate))
    rate = np.where((form.gap != NONE) & (degree == 0), NONE, form.rate)
    force = np.where(degree == JENKINS, form.force, NONE)
    variables = np.stack([form.gap, rate, level, *limits_of(form), force])
    return Quantities(variables, np.where(variables == NONE, -1, plan.reduced.register_of[variables]))


def mode_registers(plan: Plan) -> Indices:
    """Return the registers (3, laws) that say which laws are closed, with which constant force, or slip whither."""
    form, register = plan.reduced.switched, plan.reduced.register_of
    return np.stack([np.where(v == NONE, -1, register[v]) for v in (form.closed, form.push, form.direction)])


def limits_of(form: Switched) -> tuple[Indices, Indices]:
    """Return the variables of the slip and stick limits; of contact friction, its coefficient."""
    slip, stick = [], []
    for laws in form.laws:
        nothing = np.full(laws.rows, NONE)
        dry = laws.kind is LawKind.DRY_FRICTION
        coefficient = nothing if laws.friction is None else laws.friction
        slip.append(laws.slip if dry else coefficient)
        stick.append(laws.stick if dry else coefficient)
    return np.concatenate(slip), np.concatenate(stick)


class FreeDynamics:
    """The evaluation for one plan, with signals of its kinds: made once.

    Attributes
    ----------
    plan : what is evaluated, the free scene where that is possible
    quantities : Quantities
    stored : register of the ledger's stored energy, -1 for none
    values : (k,) registers of the quantities, in the order of (gap, rate, level, slip, stick, force) without those that
        are not computed; last the stored energy of the ledger, where there is one
    """

    def __init__(self, plan: Plan, signals: Mapping[int, Signal], own: bool = True) -> None:
        """
        Parameters
        ----------
        own : evaluate a plan of the free scene's own where there is one, else always the switched form
        """
        switched = plan.reduced.switched
        self.degree = switched.degree
        self.switched, self.plan = plan, _free_plan(plan, signals) if own else plan
        form = self.plan.reduced.switched
        self.push = _inputs(self.plan, form.push)
        self.quantities = quantities_of(self.plan, form, switched.degree)
        registers = self.quantities.registers
        self.stored = self.plan.stored
        self.values = np.concatenate([registers[registers >= 0], np.full(int(self.stored >= 0), self.stored)])
        self.outputs = np.concatenate([registers[2], self.plan.derivatives])
        self.motions = registers[:2][registers[:2] >= 0]
        self.program = needed_steps(
            self.plan.full_program, np.concatenate([self.values, self.plan.derivatives]), self.plan.count
        )
        self.is_explicit = fits_casadi(self.program)

    def base(self, given: Array, signals: Mapping[int, Signal]) -> Array:
        """Return the registers that do not change between events.

        Parameters
        ----------
        given : the same of the switched form
        """
        if self.plan is self.switched:
            return given.copy()
        plan, reduced = self.plan, self.switched.reduced
        registers, variables = self.switched.known
        own, shared = np.full(plan.reduced.flat.count, np.nan), variables < reduced.lawful.count
        own[variables[shared]] = given[registers[shared]]
        base = plan.base(own, _signals_of(plan.reduced.switched, reduced.lawful.count, signals))
        own_holds, holds = plan.held, self.switched.held
        base[own_holds[own_holds >= 0]] = given[holds[holds >= 0]]
        if reduced.flat.events is not None:
            held = reduced.flat.events.discrete
            there = plan.reduced.register_of[held]
            base[there[there >= 0]] = given[reduced.register_of[held]][there >= 0]
        return base

    def bind(self, base: Array, signals: Mapping[int, Signal]) -> ByEngine | Interpreted:
        """Return the evaluation with the parameters and signals of a run.

        At a time and states it returns the registers `values`, the derivatives of the levels and of the states' rates
        by the forces, and those of gaps and rates by the states.
        """
        return ByEngine(self, base, signals) if self.is_explicit else Interpreted(self, base, signals)

    @cached_property
    def level_rounding(self) -> Rounding:
        """The rounding of the levels that are computed, in the order of the laws."""
        levels = self.quantities.registers[2]
        return Rounding(self.program, levels[levels >= 0], self.plan.count)

    @cached_property
    def functions(self) -> FreeFunctions | None:
        """Return the scene as casadi functions; None where it is too large for that, or has blocks."""
        return FreeFunctions(self) if self.is_explicit else None

    @cached_property
    def tapes(self) -> tuple[Tape, Tape]:
        """Return the derivatives by the forces, with all values, and those by the states."""
        own, count = self.program, self.plan.count
        return derivatives_tape(own, self.by_force, count, True), derivatives_tape(own, self.by_state, count, True)

    @cached_property
    def tables(self) -> tuple[Array, ...]:
        """Where derivatives stand in the matrices of ``lmoc_free_dynamics``; registers of states, quantities, modes."""
        motions, count = np.flatnonzero((self.quantities.registers[:2] >= 0).ravel()), len(self.plan.states)
        force, state = self.by_force, self.by_state
        found = (
            force.rows * len(self.push) + force.columns, motions[state.rows] * count + state.columns,
            self.plan.states, self.quantities.registers, self.inputs,
        )  # fmt: skip
        return tuple(np.ascontiguousarray(v, np.int32) for v in found)

    @cached_property
    def inputs(self) -> Indices:
        """(3, laws) registers that say in which mode each law is; -1 for none."""
        return mode_registers(self.plan)

    @property
    def asks_for_inputs(self) -> bool:
        """Return whether there are inputs whose values Python gives."""
        return not np.isin(self.plan.sampled, self.push).all()

    @cached_property
    def linear(self) -> NDArray[np.bool_]:
        """(2, n) gaps and rates that are linear in the states, with coefficients that depend on parameters alone.

        None where the scene is too large for compiled functions.
        """
        return self.motions_by_shape()[0]

    @cached_property
    def curved(self) -> NDArray[np.bool_]:
        """(2, n) gaps and rates that are not linear in the states: integrators keep them within their errors alone.

        None where the scene has nonlinear blocks, or is too large for compiled functions.
        """
        return self.motions_by_shape()[1]

    def motions_by_shape(self, given: Sequence[int] | Indices = ()) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Return which motions are linear, and which are curved.

        Parameters
        ----------
        given : registers of inputs that may change, beside those that are functions of time
        """
        linear, curved = np.zeros((2, 2, len(self.push)), bool)
        if self.is_explicit:
            plan, there = self.plan, self.quantities.registers[:2] >= 0
            inputs = np.concatenate([plan.sampled[~np.isin(plan.sampled, self.push)], np.asarray(given, int)])
            linear[there] = linear_registers(plan, self.program, inputs)[self.motions]
            implicit = any(isinstance(s, Solve) and not s.linear for s in walk(self.switched.full_program))
            curved[there] = ~linear[there] & (not implicit)
        return linear, curved

    @cached_property
    def by_force(self) -> Jacobian:
        return Jacobian(self.program, self.push, self.outputs, self.plan.count)

    @cached_property
    def by_state(self) -> Jacobian:
        return Jacobian(self.program, self.plan.states, self.motions, self.plan.count)


def free_dynamics(plan: Plan, signals: Mapping[int, Signal]) -> FreeDynamics:
    """Return the evaluation for a plan, made once."""
    made = plan.once(_kept)
    if not made:
        made.append(FreeDynamics(plan, signals))
    return made[0]


def _kept(_: Plan) -> list[FreeDynamics]:
    """Return where that is kept."""
    return []


def _free_plan(plan: Plan, signals: Mapping[int, Signal]) -> Plan:
    """Return the plan of the free scene with the same states; the plan itself where there is none."""
    free = plan.reduced.free
    if free is None or (plan.reduced.switched.degree == JENKINS).any():  # whose forces are states of the switched form
        return plan
    shared, report = plan.reduced.lawful.count, Report()
    made = build_plan(free, _signals_of(free.switched, shared, signals), bool(plan.ledger.any()), report)
    own, other = (p.reduced.registers.variable[p.states] for p in (plan, made))
    same = len(own) == len(other) and (plan.ledger == made.ledger).all() and ((plan.held < 0) == (made.held < 0)).all()
    nonlinear = any(isinstance(s, Solve) and not s.linear for s in walk(made.full_program))
    return made if same and not nonlinear and not report.errors else plan


def _signals_of(form: Switched, shared: int, signals: Mapping[int, Signal]) -> dict[int, Signal]:
    """Return the signals of the variables that two forms share, and zero for what holds a mode."""
    held = form.modes
    return {v: s for v, s in signals.items() if v < shared} | {int(v): Constant(0.0) for v in held}


def _inputs(plan: Plan, variables: Indices) -> Indices:
    """Return the registers of inputs."""
    column, variable, order = plan.reduced.inputs
    return column[[int(np.flatnonzero((variable == v) & (order == 0))[0]) for v in variables]]


# ---------------------------------------------------------------------- one casadi function


class FreeFunctions:
    """An open scene as casadi functions ``(t, x, p, u)``.

    Attributes
    ----------
    parameters : registers of p; the forces are the last ones
    sampled, samplers : registers of u, and (variable, order) of what fills them
    """

    def __init__(self, scene: FreeDynamics) -> None:
        plan, self.laws = scene.plan, len(scene.push)
        sampled = ~np.isin(plan.sampled, scene.push)
        self.sampled = plan.sampled[sampled]
        self.samplers = [plan.samplers[k] for k in np.flatnonzero(sampled)]
        outputs = np.concatenate([scene.values, scene.outputs, scene.motions])
        given = given_registers(scene.program, plan.count, plan, outputs)
        self.parameters = np.concatenate([given[~np.isin(given, scene.push)], scene.push])
        self.lowered = CasadiDerivatives(scene.program, plan.count, plan.states, self.parameters, self.sampled, outputs)
        sizes = len(scene.values), self.laws, len(plan.derivatives), len(scene.motions)
        first = np.cumsum([0, *sizes]).tolist()
        self.values, self.levels, self.rates, self.motions = (
            self.lowered.out[a : a + n] for a, n in zip(first, sizes, strict=False)
        )

    def named(self, name: str, outputs: Sequence):
        """Return a function of the arguments with these results."""
        import casadi as ca

        arguments = [self.lowered.time, self.lowered.x, self.lowered.p, self.lowered.u]
        return ca.Function(name, arguments, [ca.densify(o) for o in outputs])

    @cached_property
    def by_force(self):
        """The derivatives of the levels by the forces."""
        import casadi as ca

        return ca.jacobian(self.levels, self._forces)

    @cached_property
    def has_constant_matrix(self) -> bool:
        """Return whether the levels depend on the forces in the same way everywhere."""
        import casadi as ca

        lowered = self.lowered
        return not ca.depends_on(self.by_force, ca.vertcat(lowered.time, lowered.x, lowered.u))

    @property
    def _forces(self):
        return self.lowered.p[len(self.parameters) - self.laws :]


class FreeInC(ctypes.Structure):
    """``lmoc_free_dynamics`` in ``engine/c/free_dynamics.h``."""

    _fields_ = [
        *[(name, ctypes.c_int64) for name in ("laws", "states", "stored")],
        ("count", ctypes.c_int64 * 2),
        *[(name, ctypes.c_void_p * 2) for name in ("place", "entry", "w", "tape")],
        *[(name, ctypes.c_void_p) for name in ("state", "quantity", "known", "inputs")],
        ("lost", ctypes.c_int64),
    ]


class ByEngine:
    """The program and its derivatives by the engine, with the parameters and signals of a run."""

    def __init__(self, scene: FreeDynamics, base: Array, signals: Mapping[int, Signal]) -> None:
        force, state = scene.tapes
        self._scene, self._size = scene, len(scene.values)
        self._force = TapeFunction(force, scene.plan, np.concatenate([scene.values, force.results]), scene.push)
        self._state = TapeFunction(state, scene.plan, state.results, scene.push)
        self.prepare(base, signals)

    def prepare(self, base: Array, signals: Mapping[int, Signal]) -> None:
        """Take the registers that do not change between events, and the inputs."""
        base = base.copy()
        base[self._scene.push] = 0.0
        for function in (self._force, self._state):
            function.prepare(base, signals)

    def sample(self, t: float) -> None:
        """Take the inputs at a time."""
        for function in (self._force, self._state):
            function.sample(t)

    def in_c(self, known: Array) -> FreeInC:
        """Return what C reads; valid as long as this lives. `known`: (6, n) of quantities without a register."""
        tables = self._scene.tables
        places = [np.ascontiguousarray(t.results, np.int32) for t in self._scene.tapes]
        kernels = [f.kernel.addresses for f in (self._force, self._state)]
        made = FreeInC(len(self._scene.push), len(self._scene.plan.states), self._scene.stored)
        for k in range(2):
            made.count[k], made.place[k], made.entry[k] = len(places[k]), places[k].ctypes.data, tables[k].ctypes.data
            made.w[k], made.tape[k] = kernels[k]
        made.state, made.quantity = tables[2].ctypes.data, tables[3].ctypes.data
        made.known, made.inputs = known.ctypes.data, tables[4].ctypes.data
        made.kept = places, known, self
        return made

    def __call__(self, t: float, x: Array) -> tuple[Array, Array, Array]:
        scene, found = self._scene, self._force(t, x)
        force = _dense(scene.by_force, found[self._size :], (len(scene.outputs), len(scene.push)))
        state = _dense(scene.by_state, self._state(t, x), (len(scene.motions), len(x)))
        return found[: self._size], force, state


# ------------------------------------------------------------------------------ numpy


class Interpreted:
    """The program run by numpy, with the parameters and signals of a run."""

    def __init__(self, scene: FreeDynamics, base: Array, signals: Mapping[int, Signal]) -> None:
        self.scene = scene
        self.interpreter = Interpreter(scene.program, scene.plan.count)
        self.prepare(base, signals)

    def prepare(self, base: Array, signals: Mapping[int, Signal]) -> None:
        """Take the registers that do not change between events, and the inputs."""
        self.base, self.signals = base, signals
        self.interpreter.reset()

    def stand_at(self, unknowns: Indices, solutions: Array) -> None:
        """Start again from these solutions of nonlinear blocks."""
        self.base[unknowns] = solutions
        self.interpreter.reset()

    def __call__(self, t: float, x: Array, mode: Array | None = None) -> tuple[Array, Array, Array]:
        """Evaluate; `mode`: (3, laws) values of `FreeDynamics.inputs`, None where all laws are open."""
        scene, plan, w = self.scene, self.scene.plan, self.base.copy()
        w[plan.states] = x
        if mode is not None:
            w[scene.inputs[scene.inputs >= 0]] = mode[scene.inputs >= 0]
        for register, (variable, order) in zip(plan.sampled, plan.samplers, strict=True):
            w[register] = sample(self.signals[variable], order, np.array([t]))[0]
        self.interpreter.run(w, t)
        force = _dense(scene.by_force, scene.by_force.values(w, t), (len(scene.outputs), len(scene.push)))
        state = _dense(scene.by_state, scene.by_state.values(w, t), (len(scene.motions), len(x)))
        return w[scene.values], force, state


def _dense(jacobian: Jacobian, entries: Array, shape: tuple[int, int]) -> Array:
    matrix = np.zeros(shape)
    matrix[jacobian.rows, jacobian.columns] = entries
    return matrix
