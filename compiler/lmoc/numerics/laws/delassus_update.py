"""A mode as an update of the free scene: the forces of closed laws from the Delassus matrix, no block in between.

With all laws open, the levels y (`structure.laws.switched`) are b(t, x) + W·F. In a mode, each force is given or makes
its level vanish,

    F = push − direction·slip   of open laws,        W·F = −b(t, x)   in the rows of closed ones,

a linear system A·F = r. Where W does not depend on the motion, as in all one-dimensional scenes, A is constant in a
mode: it is inverted once, and the functions are those of the free scene in all modes. So a mode costs one inversion of
a matrix in the number of laws, no reduction and no compilation; scenes whose switched form is one small function need
neither.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from lmoc.ir.law import JENKINS, NONE
from lmoc.numerics.evaluate.casadi_stepper import CasadiStepper
from lmoc.numerics.evaluate.casadi_system import Buffered
from lmoc.numerics.laws.bound_function import BoundFunction
from lmoc.numerics.laws.free_dynamics import FreeDynamics, free_dynamics
from lmoc.numerics.observe.slices import Evaluate
from lmoc.numerics.plan.plan import Plan
from lmoc.numerics.problem.stepper import Stepper
from lmoc.numerics.problem.system import System
from lmoc.numerics.signals.signals import Signal
from lmoc.support.records import dataclass

Array = NDArray[np.float64]
MOST_LAWS = 400  # with more, products with full matrices cost more than a sparse block


def updatable(plan: Plan, signals: Mapping[int, Signal]) -> ModeFunctions | None:
    """Return the update of a plan's free scene, made once; None where the scene is not of that kind."""
    made = plan.once(_kept)
    if not made:
        made.append(_update_of(plan, signals))
    return made[0]


def _kept(_: Plan) -> list[ModeFunctions | None]:
    """Return where that is kept."""
    return []


def _update_of(plan: Plan, signals: Mapping[int, Signal]) -> ModeFunctions | None:
    form = plan.reduced.switched
    if form is None or plan.reduced.free is None or form.count > MOST_LAWS or (form.degree == JENKINS).any():
        return None
    held = form.modes
    constant = {variable for _, variable in plan.constants}
    if not constant.issuperset(held.tolist()) or any(laws.normal is not None for laws in form.laws):
        return None  # forces that time stepping fills, friction whose limit is another force
    scene = free_dynamics(plan, signals)
    if scene.plan is plan or scene.functions is None or not scene.functions.has_constant_matrix:
        return None
    return ModeFunctions(scene)


@dataclass(frozen=True, eq=False)
class LawRegisters:
    """Registers of the switched form, an entry for each law; -1 for none."""

    closed: NDArray[np.int64]
    push: NDArray[np.int64]
    direction: NDArray[np.int64]
    slip: NDArray[np.int64]


class ModeFunctions:
    """The functions ``(t, x, p, u)`` of the modes of a scene.

    Attributes
    ----------
    rates : the derivatives of the states
    reading : the registers `FreeDynamics.values` with all laws open, then the forces of the mode
    """

    def __init__(self, scene: FreeDynamics) -> None:
        self.scene, self.laws = scene, len(scene.push)
        form, register = scene.switched.reduced.switched, scene.switched.reduced.register_of
        limits = scene.quantities.registers[3]
        slip = np.where(limits >= 0, NONE, scene.quantities.variables[3])  # those that the function does not give
        self.places = LawRegisters(
            *(np.where(v == NONE, NONE, register[v]) for v in (form.closed, form.push, form.direction, slip))
        )
        self._delassus: tuple[bytes, Array] | None = None
        self._inverse: tuple[Array, NDArray[np.bool_], Array, Array] | None = None
        self._build(np.flatnonzero(limits >= 0))

    def _build(self, sliding: NDArray[np.int64]) -> None:
        """Write the functions; `sliding` are the laws whose slip limits change with time or states."""
        import casadi as ca

        made, n = self.scene.functions, self.laws
        own = len(made.parameters) - n
        registers = self.scene.quantities.registers
        present = np.cumsum((registers >= 0).ravel()).reshape(registers.shape) - 1
        slip = ca.SX(n, 1)
        for k in sliding.tolist():
            slip[k] = made.values[int(present[3, k])]
        free = made.named("free", [made.values, made.levels, slip])
        forced = made.named("forced", [made.rates])
        t, x = ca.MX.sym("t"), ca.MX.sym("x", len(self.scene.plan.states))
        u = ca.MX.sym("u", len(made.samplers))
        sizes = own, n, n, n, n, n * n, n * n
        p = ca.MX.sym("p", sum(sizes))
        given, held, push, direction, limit, inverse, matrix = ca.vertsplit(p, np.cumsum([0, *sizes]).tolist())
        inverse, matrix = ca.reshape(inverse, n, n), ca.reshape(matrix, n, n)
        values, level, varying = free(t, x, ca.vertcat(given, ca.MX.zeros(n)), u)
        right = ca.if_else(held, -level, push - direction * (limit + varying))
        force = ca.mtimes(inverse, right)
        force = force + ca.mtimes(inverse, right - ca.mtimes(matrix, force))  # an inverse is not backward stable
        self.rates = ca.Function("rates", [t, x, p, u], [forced(t, x, ca.vertcat(given, force), u)])
        self.reading = ca.Function("reading", [t, x, p, u], [ca.vertcat(values, force)])
        self.size = sum(sizes)

    def parameters(self, base: Array, signals: Mapping[int, Signal]) -> Array:
        """Return p, (size,), in the mode that stands in the registers of the switched form."""
        places, n, own = self.places, self.laws, self.scene.base(base, signals)
        delassus = self._delassus_of(own, signals)
        held = base[places.closed]
        matrix, inverse = self._inverse_of(delassus, held > 0.5)
        direction, slip = (np.where(r >= 0, base[r], 0.0) for r in (places.direction, places.slip))
        known = own[self.scene.functions.parameters[:-n]]
        return np.concatenate([known, held, base[places.push], direction, slip, inverse, matrix])

    def _inverse_of(self, delassus: Array, closed: NDArray[np.bool_]) -> tuple[Array, Array]:
        """Return A and its inverse, by columns: the one in the mode before, or that of the block of closed laws."""
        if self._inverse is None or self._inverse[0] is not delassus or (self._inverse[1] != closed).any():
            self._inverse = delassus, closed, *inverted(delassus, closed)
        return self._inverse[2:]

    def _delassus_of(self, base: Array, signals: Mapping[int, Signal]) -> Array:
        """Return the matrix (laws, laws) by which the levels depend on the forces, with these parameters."""
        if self._delassus is None or self._delassus[0] != base.tobytes():
            found = self.scene.bind(base, signals)(0.0, np.zeros(len(self.scene.plan.states)))
            self._delassus = base.tobytes(), found[1][: self.laws]
        return self._delassus[1]

    def bind(self, function, base: Array, signals: Mapping[int, Signal]) -> Evaluate:
        """Return ``(times, states) -> results`` of one of the functions in a mode; parameters as of `parameters`."""
        scene = self.scene
        bound = BoundFunction(function, np.arange(self.size), scene.functions.samplers, len(scene.plan.states))
        bound.prepare(self.parameters(base, signals), signals)
        return bound.many


def inverted(delassus: Array, closed: NDArray[np.bool_]) -> tuple[Array, Array]:
    """Return A and its inverse, by columns: rows of W for closed laws, of the unit matrix for open ones.

    The inverse is NaN where closed laws depend on each other: no force is determined.
    """
    n, own = len(closed), np.flatnonzero(closed)
    matrix, inverse = np.where(closed[:, None], delassus, np.eye(n)), np.eye(n)
    try:
        block = np.linalg.inv(delassus[np.ix_(own, own)])
        inverse[np.ix_(own, np.flatnonzero(~closed))] = -block @ delassus[np.ix_(own, np.flatnonzero(~closed))]
        inverse[np.ix_(own, own)] = block
    except np.linalg.LinAlgError:
        inverse[:] = np.nan
    return matrix.T.ravel(), inverse.T.ravel()


class DelassusUpdate(System):
    """The free scene with the forces of the mode."""

    description = "casadi, updated"
    most_steps = 5_000

    def __init__(self, plan: Plan, update: ModeFunctions) -> None:
        super().__init__(plan)
        self.update = update
        self.t, self.x, self.p = np.zeros(1), np.zeros(self.n), np.zeros(update.size)
        self.u = np.zeros(len(plan.sampled))
        self._rhs = Buffered(update.rates, (self.t, self.x, self.p, self.u))
        self._jacobian: Buffered | None = None
        self._stepper: CasadiStepper | None = None

    def prepare(self, base: Array, signals: Mapping[int, Signal]) -> None:
        super().prepare(base, signals)
        self.p[:] = self.update.parameters(base, signals)

    def rhs(self, t: float, x: Array, out: Array) -> None:
        self.evaluations += 1
        self._run(self._rhs, t, x)
        out[:] = self._rhs.results[0]

    def _run(self, call: Buffered, t: float, x: Array) -> None:
        self.t[0] = t
        self.x[:] = x
        if self.samplers:
            self.sample(t, self.u)
        call()

    def _buffered_jacobian(self) -> Buffered:
        if self._jacobian is None:
            import casadi as ca

            arguments = self.update.rates.mx_in()
            matrix = ca.jacobian(self.update.rates(*arguments), arguments[1])
            self._jacobian = Buffered(ca.Function("jacobian", arguments, [matrix]), self._rhs.arguments)
        return self._jacobian

    def pattern(self) -> tuple[Array, Array]:
        sparsity = self._buffered_jacobian().function.sparsity_out(0)
        return np.array(sparsity.colind(), np.int32), np.array(sparsity.row(), np.int32)

    def jacobian_values(self, t: float, x: Array, out: Array) -> None:
        self.jacobians += 1
        call = self._buffered_jacobian()
        self._run(call, t, x)
        out[:] = call.results[0]

    def stepper(self) -> Stepper:
        if self._stepper is None:  # kept, since it serves many runs
            self._stepper = CasadiStepper(self, self.update.rates, self.p)
        return self._stepper
