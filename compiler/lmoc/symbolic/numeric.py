"""Linear models in numbers, for scenes of any size: derivatives of the programs, without SymPy."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property

import numpy as np

from lmoc.expression.dag import postorder
from lmoc.ir.flat import Kind
from lmoc.ir.program import Apply, Program, Solve, Step, needed_steps, read
from lmoc.ir.reduced import Reduced
from lmoc.messages.diagnostics import Diagnostic, ModelError, SimulationError, nearest
from lmoc.numerics.evaluate.at_points import AtPoints
from lmoc.numerics.options.options import RunOptions
from lmoc.numerics.run.simulate import Simulator
from lmoc.numerics.solve.interpreter import Interpreter
from lmoc.numerics.start.parameters import sources_without_value
from lmoc.structure.laws.degree import dependent
from lmoc.structure.messages.equations import listed
from lmoc.support.records import dataclass
from lmoc.symbolic.jumps import NoDerivativeError, jumps_at, no_derivative, switches
from lmoc.symbolic.linearize import LinearModel
from lmoc.symbolic.system import coordinates_of, refuse
from lmoc.symbolic.values import no_value

MOST_STATES = 4000  # 1 GB for the handful of full matrices that a derivation holds at a time
NEWTON_STEPS = 60
APPROACH = 25  # points on the way from the start to where implicit equations are wanted


@dataclass(frozen=True, eq=False)
class Pose:
    """A point at which the implicit equations are fulfilled: states, and the registers they are solved for."""

    states: np.ndarray
    registers: np.ndarray
    values: np.ndarray


def _is_nonlinear(step: Step) -> bool:
    return isinstance(step, Solve) and not step.linear


class NumericSystem:
    """Rates of the states, outputs, and their Jacobians at any point.

    Parameters
    ----------
    reduced : Reduced
    values : (flat.count,)
        Parameter values.
    outputs : (p,) flat variables

    Attributes
    ----------
    states, inputs : names
    jets : (3, k)
        As `Reduced.inputs`: registers of the inputs and their derivatives.
    """

    def __init__(self, reduced: Reduced, values: np.ndarray, outputs: Sequence[int]):
        flat, count = reduced.flat, reduced.registers.count
        self.reduced = reduced
        self.outputs = np.asarray(outputs, int)
        self.states = reduced.state_names
        self.input_variables = np.flatnonzero(flat.kind == Kind.INPUT)
        self.inputs = [flat.variable_name(int(v)) for v in self.input_variables]
        self.jets = reduced.inputs
        switched = np.setdiff1d(self.jets[1], self.input_variables)
        if len(switched):
            names = listed([f"'{flat.variable_name(int(v))}'" for v in switched[:4]])
            raise refuse(f"the equations switch with {names}: there is no linear model of them yet")
        seen = reduced.register_of[self.outputs]
        self.targets = np.concatenate([reduced.derivatives, seen[seen >= 0]]).astype(int)
        self._shown = np.flatnonzero(seen >= 0)
        program = reduced.rhs + needed_steps(reduced.observe, seen[seen >= 0], count)
        self._sources = np.concatenate([reduced.states, self.jets[0]]).astype(int)
        self._at = AtPoints(program, count, self._sources, self.targets, patient=reduced.guess is None)
        self._values = values
        self._w = self._at.w
        self._w[reduced.known[0]] = values[reduced.known[1]]
        self._check_values(values)
        Interpreter(reduced.parameter_program, count).run(self._w, np.nan)
        self._w[self.jets[0]] = 0.0
        self._at.forget()

    def _check_values(self, values: np.ndarray) -> None:
        """Every parameter that the programs read has a value."""
        known, used = self.reduced.known, np.zeros(len(self._w), bool)
        for step in (*self.reduced.parameter_program, *self.program):
            used[read(step)] = True
        missing = known[1][np.isnan(self._w[known[0]]) & used[known[0]]]
        if len(missing):
            flat = self.reduced.flat
            sources = {s for v in missing[:12].tolist() for s in sources_without_value(flat, v, values)}
            raise no_value(sorted(map(flat.variable_name, sources)))

    def _place(self, x: np.ndarray, u: np.ndarray, time: float) -> None:
        orders, variables = self.jets[2], self.jets[1]
        at = np.searchsorted(self.input_variables, variables)
        jets = np.where(orders == 0, u[at], 0.0) if len(variables) else np.zeros(0)
        self._at.run(np.concatenate([x, jets]), time)

    def rates_with(self, x: np.ndarray, jets: np.ndarray, time: float) -> np.ndarray:
        """(n,) derivatives of the states for given inputs and their derivatives, in the order of `jets`."""
        self._at.run(np.concatenate([x, jets]), time)
        return self._w[self.reduced.derivatives].copy()

    def rates(self, x: np.ndarray, u: np.ndarray, time: float = 0.0) -> np.ndarray:
        """(n,) derivatives of the states; the inputs' derivatives are zero."""
        self._place(x, u, time)
        return self._w[self.reduced.derivatives].copy()

    def matrices(self, x: np.ndarray, u: np.ndarray, time: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
        """Values (n + p,) of rates and outputs, and their Jacobian by states and input jets.

        Raises
        ------
        NotDerivableError
            E0660: a full matrix of so many states takes gigabytes, and its eigenvalues an hour.
        """
        if len(self.states) > MOST_STATES:
            raise refuse(f"a matrix of {len(self.states)} by {len(self.states)} is too large: {MOST_STATES} at most")
        self._place(x, u, time)
        dense = self._at.derivatives(time)
        n, p = len(self.states), len(self.outputs)
        full = np.zeros((n + p, dense.shape[1]))
        full[n + np.flatnonzero(np.isin(self.outputs, self.reduced.undetermined))] = np.nan
        full[:n], full[n + self._shown] = dense[:n], dense[n:]
        values = np.full(n + p, np.nan)
        values[:n], values[n + self._shown] = self._w[self.targets[:n]], self._w[self.targets[n:]]
        return values, full

    @property
    def program(self) -> Program:
        """Return the function of the rates and the outputs."""
        return self._at.program

    def finite(self, shown: np.ndarray) -> bool:
        """Return whether the outputs of a mask have values where the programs have run last."""
        seen = self.reduced.register_of[self.outputs[shown]]
        return bool(np.isfinite(self._w[seen[seen >= 0]]).all())

    def is_linear(self) -> bool:
        """The Jacobians at two points are the same, and no formula has cases."""
        if self.switches:
            return False
        generator = np.random.default_rng(3)
        points = [generator.uniform(-1, 1, len(self.states) + len(self.inputs)) for _ in range(2)]
        n = len(self.states)
        first, second = (self.matrices(p[:n], p[n:], time)[1] for p, time in zip(points, (0.3, 0.7), strict=True))
        self._at.forget()
        size = max(1.0, float(np.abs(first).max(initial=0.0)))
        return bool(np.allclose(first, second, rtol=1e-9, atol=1e-12 * size))

    @cached_property
    def switches(self) -> bool:
        """Whether formulas have cases that change with states and inputs."""
        return switches(self.program, dependent(self.program, self._sources, len(self._w)))

    def check_no_jump(self, x: np.ndarray, u: np.ndarray, time: float) -> None:
        """Raise E0663 where the rates jump at a point."""
        if not self.switches:
            return
        n = len(x)
        k = jumps_at(lambda place: self.rates(place[:n], place[n:], time), np.concatenate([x, u]))
        if k is not None:
            names = [*self.states, *self.inputs]
            raise no_derivative(f"something that depends on '{names[k]}'")

    @cached_property
    def pose(self) -> Pose | None:
        """Return the start of the scene with inputs of zero; None where it is irrelevant or does not exist."""
        unknowns = [step.unknowns.ravel() for step in self.program if _is_nonlinear(step)]
        if not unknowns:
            return None
        try:
            options = RunOptions(times=[self.reduced.flat.experiment.start or 0.0])
            found = Simulator(self.reduced).run(self._values, options, dict.fromkeys(self.inputs, 0.0))
        except (ModelError, SimulationError):
            return None
        registers, table = np.concatenate(unknowns), self.reduced.registers
        registers = registers[(table.order[registers] == 0) & (table.variable[registers] >= 0)]
        return Pose(found.states[0], registers, found.of(table.variable[registers])[0])

    def approach(self, x: np.ndarray, u: np.ndarray, time: float = 0.0) -> None:
        """Follow the implicit equations from the start to a point, so that they stay on the branch of the start."""
        if self.pose is None:
            return
        self._at.forget()
        self._w[self.pose.registers] = self.pose.values
        for share in np.linspace(0.0, 1.0, APPROACH):
            at = self.pose.states + share * (x - self.pose.states)
            if not np.isfinite(self.rates(at, share * u, time)).all():
                break

    def dependent(self) -> np.ndarray:
        """Return the coordinates that implicit equations gave where the programs have run last."""
        return np.zeros(0) if self.pose is None else self._w[self.pose.registers].copy()

    def can_start_at(self, x: np.ndarray, u: np.ndarray) -> bool:
        """Return whether a run can start at a place on the branch that is followed from the scene's start.

        It cannot where constraints that were left out as redundant do not hold: these depend on the branch.
        """
        if self.pose is None:
            return True
        options = RunOptions(times=[self.reduced.flat.experiment.start or 0.0])
        initial, inputs = (dict(zip(*pair, strict=True)) for pair in ((self.states, x), (self.inputs, u)))
        try:
            found = Simulator(self.reduced).run(self._values, options, inputs, initial)
        except (ModelError, SimulationError):
            return False
        self.approach(x, u)
        variables = self.reduced.registers.variable[self.pose.registers]
        apart = found.of(variables)[0] - self.dependent()
        return bool(np.abs(np.sin(apart / 2)).max(initial=0.0) < 1e-6)  # of lengths, too; angles may differ by turns

    def rest(self, u: np.ndarray, start: np.ndarray | None = None) -> np.ndarray | None:
        """A state of rest by Newton's method, the shortest step where there is a choice; None where none is found."""
        x = np.zeros(len(self.states)) if start is None else start.copy()
        n = len(x)
        for _ in range(NEWTON_STEPS):
            values, jacobian = self.matrices(x, u)
            if not (np.isfinite(values[:n]).all() and np.isfinite(jacobian[:n, :n]).all()):
                return None
            step = _newton_step(jacobian[:n, :n], values[:n])
            x = x - step
            if np.abs(step).max(initial=0.0) <= 1e-12 * (1.0 + np.abs(x).max(initial=0.0)):
                break
        x[np.abs(x) < 1e-14 * (1.0 + np.abs(x).max(initial=0.0))] = 0.0  # below what the iteration can tell
        scale = 1.0 + np.abs(jacobian[:n, :n]).sum(axis=1) * (1.0 + np.abs(x).max(initial=0.0)) if n else 1.0
        return x if np.all(np.abs(self.rates(x, u)) <= 1e-9 * scale) else None


def _newton_step(A: np.ndarray, b: np.ndarray) -> np.ndarray:
    """The solution of A x = b, the shortest best one where A is singular: rows of one size, whatever is stiff."""
    largest = np.abs(A).max(axis=1, initial=0.0)
    largest = np.where(largest > 0, largest, 1.0)
    A, b = A / largest[:, None], b / largest
    try:
        x = np.linalg.solve(A, b)
    except np.linalg.LinAlgError:
        x = np.full(len(b), np.nan)
    size = np.abs(A).sum(axis=1) * np.abs(x).max(initial=0.0) + np.abs(b)
    if np.all(np.isfinite(x)) and np.all(np.abs(A @ x - b) <= 1e-12 * size) and np.abs(x).max(initial=0.0) < 1e12:
        return x
    return np.linalg.lstsq(A, b, rcond=1e-12)[0]


def linearize_numerically(
    reduced: Reduced,
    values: np.ndarray,
    point: Mapping[str, float],
    outputs: Sequence[str],
    time: float = 0.0,
    system: NumericSystem | None = None,
) -> LinearModel:
    """Linear model about a point.

    Parameters
    ----------
    point : {state or input name: number}
        Zero where nothing is given.
    outputs : names of variables

    Raises
    ------
    ModelError
        E0662 a parameter without a value, E0663 a point where something has no derivative.
    """
    system = system or NumericSystem(reduced, values, [variable(reduced, name) for name in outputs])
    n, p = len(system.states), len(outputs)
    x = np.array([float(point.get(name, 0.0)) for name in system.states])
    u = np.array([float(point.get(name, 0.0)) for name in system.inputs])
    system.approach(x, u, time)
    system.check_no_jump(x, u, time)
    found, jacobian = system.matrices(x, u, time)
    _check_derivatives(system, outputs, jacobian)
    orders = system.jets[2]
    highest = int(orders.max(initial=0)) + 1
    Bs = [np.zeros((n, len(u))) for _ in range(highest)]
    Ds = [np.zeros((p, len(u))) for _ in range(highest)]
    for column, (v, order) in enumerate(zip(system.jets[1], orders, strict=True)):
        at = int(np.searchsorted(system.input_variables, v))
        Bs[order][:, at], Ds[order][:, at] = jacobian[:n, n + column], jacobian[n:, n + column]
    return LinearModel(
        states=list(system.states),
        inputs=list(system.inputs),
        outputs=list(outputs),
        A=jacobian[:n, :n],
        Bs=tuple(Bs),
        C=jacobian[n:, :n],
        Ds=tuple(Ds),
        point={
            **dict(zip(system.states, x.tolist(), strict=True)),
            **dict(zip(system.inputs, u.tolist(), strict=True)),
        },
        drift=found[:n],
        output_values=found[n:],
        coordinates=coordinates_of(reduced),
        time=time if contains_time(system.program) else None,
    )


def _check_derivatives(system: NumericSystem, outputs: Sequence[str], jacobian: np.ndarray) -> None:
    """At a singular point of implicit equations not everything has a derivative: say what has none."""
    n, known = len(system.states), ~np.isin(system.outputs, system.reduced.undetermined)
    names = [f"der({name})" for name in system.states] + list(outputs)
    lost = ~np.isfinite(jacobian).all(axis=1) & np.concatenate([np.ones(n, bool), known])
    if lost.any():
        who = listed([f"'{names[k]}'" for k in np.flatnonzero(lost)[:6].tolist()])
        message = f"no linear model of {who}: there is no derivative at this point"
        if not system.finite(lost[n:]):
            message = f"no linear model of {who}: at this point it has no value (0/0, or the root or logarithm of zero)"
            hint = "choose a point where it has one, as `--at name=value`, or other outputs: linearize(outputs=[…])"
            raise NoDerivativeError([Diagnostic("E0663", message, hint=hint)])
        hint = "the implicit equations are singular there: choose another point, or other outputs"
        raise NoDerivativeError([Diagnostic("E0663", message, hint=hint)])


def contains_time(program: Program) -> bool:
    return any(
        any(node.op == "time" for node in postorder(step.shape))
        if isinstance(step, Apply)
        else isinstance(step, Solve) and contains_time(step.inner)
        for step in program
    )


def variable(reduced: Reduced, name: str) -> int:
    """Index of one variable by name.

    Raises
    ------
    ModelError
        E0661 where there is no such variable.
    """
    flat = reduced.flat
    found = flat.find(name)
    if found is None or len(found) != 1:
        hint = nearest(name, flat.names()) if flat.count < 5000 else ""
        raise ModelError([Diagnostic("E0661", f"there is no variable '{name}'", hint=hint)])
    return int(found[0])
