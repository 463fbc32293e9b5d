"""The solved system as casadi functions of states, inputs and parameters: for optimal control and embedding.

A scene with implicit blocks has two forms. In `Functions.ode` the blocks are solved by a casadi rootfinder, which is
differentiable by the implicit function theorem. In `Functions.dae` they lie open: their unknowns are algebraic
variables z of an index-1 system, as collocation, casadi's `idas` and SUNDIALS' IDA take them.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from lmoc.ir.flat import Kind
from lmoc.ir.law import NONE
from lmoc.ir.mode import law_names
from lmoc.ir.program import needed_steps, program_rows
from lmoc.ir.reduced import Reduced
from lmoc.messages.diagnostics import Diagnostic, ModelError
from lmoc.numerics.evaluate.casadi_system import can_lower, lower_shape, lower_steps
from lmoc.numerics.evaluate.opened import open_blocks
from lmoc.support.records import dataclass

if TYPE_CHECKING:
    import casadi

MOST_ROWS = 50_000  # each becomes nodes of its own
_EXACT = 1e-12  # to which the rootfinder solves


@dataclass(frozen=True, eq=False)
class StartValues:
    """A consistent point: time, states, algebraic variables and inputs where the model starts."""

    t: float
    x: np.ndarray
    z: np.ndarray
    u: np.ndarray


@dataclass(frozen=True, eq=False)
class IndexOne:
    """``x' = f(t, x, z, u, p), 0 = g(t, x, z, u, p)``.

    Attributes
    ----------
    states, algebraic, inputs, parameters : names of the components of x, z, u, p
    residual : Function (t, dx, x, z, u, p) → (f - dx, g)
    expressions : {"t", "x", "z", "u", "p", "ode", "alg"} as `casadi.integrator` takes them
    values : (p,) values of the parameters in the model
    start : StartValues, computed on first access
    """

    states: tuple[str, ...]
    algebraic: tuple[str, ...]
    inputs: tuple[str, ...]
    parameters: tuple[str, ...]
    residual: casadi.Function
    expressions: dict[str, casadi.SX]
    values: np.ndarray
    _find_start: Callable[[], StartValues]

    @cached_property
    def start(self) -> StartValues:
        """Return the start of the model, with consistent algebraic variables.

        Raises
        ------
        ModelError
            An input has no signal, or there is no consistent start.
        """
        return self._find_start()

    @property
    def algebraic_idx(self) -> np.ndarray:
        """Places of z in y = (x, z)."""
        return len(self.states) + np.arange(len(self.algebraic))

    @property
    def y0(self) -> np.ndarray:
        """(x, z) at the start."""
        return np.concatenate([self.start.x, self.start.z])

    @property
    def yp0(self) -> np.ndarray:
        """Derivatives of y at the start; zero for z, whose derivatives nobody needs."""
        start, nothing = self.start, np.zeros(len(self.states))
        residual = np.array(self.residual(start.t, nothing, start.x, start.z, start.u, self.values)).ravel()
        return np.concatenate([residual[: len(start.x)], np.zeros(len(start.z))])

    def resfn(self, t: float, y: np.ndarray, yp: np.ndarray, res: np.ndarray) -> None:
        """Write the residual for the model's parameters and the inputs' values at the start, as IDA asks for it."""
        n = len(self.states)
        res[:] = np.array(self.residual(t, yp[:n], y[:n], y[n:], self.start.u, self.values)).ravel()


@dataclass(frozen=True, eq=False)
class Functions:
    """``x' = f(t, x, u, p)``, ``y = h(t, x, u, p)`` in casadi.

    They hold as long as the assumptions of the reduction do (`Reduced.guards`).

    Attributes
    ----------
    states, inputs, parameters, outputs : names of the components of x, u, p, y; an input's derivative that the
        equations contain is an input of its own, ``der(u)``; parameters that are bound to others are not listed
    values : (p,) values of the parameters in the model
    ode : Function (t, x, u, p) → x'
    output : Function (t, x, u, p) → y
    dae : the same with the unknowns of implicit blocks as algebraic variables
    algebraic : Function (t, x, u, p, z) → z
        The algebraic variables, sought from a first guess. `ode` and `output` begin at the model's start; where there
        are several solutions, as with a linkage, and a point lies far from it, use this one or `dae`.
    """

    states: tuple[str, ...]
    inputs: tuple[str, ...]
    parameters: tuple[str, ...]
    outputs: tuple[str, ...]
    values: np.ndarray
    dae: IndexOne
    _right: casadi.Function  # (t, x, z, u, p) -> (x', y)

    @cached_property
    def algebraic(self) -> casadi.Function:
        import casadi as ca

        given = self.dae.expressions
        arguments = [given[name] for name in "txup"]
        names, z = ["t", "x", "u", "p", "guess"], given["z"]
        if not z.numel():
            return ca.Function("algebraic", [*arguments, z], [z], names, ["z"])
        together = ca.vertcat(*arguments)
        problem = {"x": z, "p": together, "g": given["alg"]}
        solver = ca.rootfinder("blocks", "newton", problem, {"abstol": _EXACT, "error_on_fail": True})
        symbols = [ca.MX.sym(name, *argument.shape) for name, argument in zip(names, [*arguments, z])]
        solution = solver(x0=symbols[-1], p=ca.vertcat(*symbols[:-1]))["x"]
        return ca.Function("algebraic", symbols, [solution], names, ["z"])

    @cached_property
    def ode(self) -> casadi.Function:
        return self._closed("ode", "dx", 0)

    @cached_property
    def output(self) -> casadi.Function:
        return self._closed("output", "y", 1)

    @cached_property
    def jacobian(self) -> casadi.Function:
        """(t, x, u, p) → (∂f/∂x, ∂f/∂u, ∂h/∂x, ∂h/∂u): A, B, C and D of the linear model."""
        import casadi as ca

        t, x, u, p = arguments = self._symbols()
        f, h = self.ode(*arguments), self.output(*arguments)
        blocks = [ca.jacobian(g, v) for g in (f, h) for v in (x, u)]
        return ca.Function("jacobian", arguments, blocks, ["t", "x", "u", "p"], ["A", "B", "C", "D"])

    def _symbols(self) -> list:
        """Scalars where everything is explicit, else matrices, which rootfinders need."""
        import casadi as ca

        kind = ca.MX if self.dae.algebraic else ca.SX
        return [kind.sym(name, *self.dae.expressions[name].shape) for name in "txup"]

    def _closed(self, name: str, result: str, which: int) -> casadi.Function:
        """A part of the right-hand side, with the blocks solved from the model's start."""
        import casadi as ca

        t, x, u, p = arguments = self._symbols()
        z = self.algebraic(*arguments, self.dae.start.z) if self.dae.algebraic else ca.SX(0, 1)
        return ca.Function(name, arguments, [self._right(t, x, z, u, p)[which]], ["t", "x", "u", "p"], [result])


def casadi_functions(
    reduced: Reduced, values: np.ndarray, find_start: Callable[[np.ndarray], StartValues]
) -> Functions:
    """Lower a reduced system.

    Parameters
    ----------
    find_start : the start of the model with the values of some registers, (z,) -> StartValues

    Raises
    ------
    ModelError
        E0626 where the system is too large.
    """
    import casadi as ca

    flat = reduced.flat
    outputs = np.flatnonzero(flat.per_variable(lambda b: b.output, bool))
    registers = reduced.register_of[outputs]
    observe = needed_steps(reduced.observe, registers[registers >= 0], reduced.registers.count)
    program, unknowns, residuals = open_blocks(
        reduced.parameter_program + reduced.rhs + observe, lambda block: not can_lower((block,))
    )
    if program_rows(program) > MOST_ROWS:
        raise ModelError([Diagnostic("E0626", f"'{flat.name}' cannot be written as casadi functions: it is too large")])
    parameters, of_variable = _parameters(reduced)
    t, p = ca.SX.sym("t"), ca.vertcat(ca.SX(0, 1), *of_variable[parameters])
    x, u = ca.SX.sym("x", len(reduced.states)), ca.SX.sym("u", reduced.inputs.shape[1])
    z = ca.SX.sym("z", len(unknowns))
    w: list = [None] * reduced.registers.count
    _fill(w, reduced.known[0], of_variable[reduced.known[1]])
    for own, symbols in ((reduced.states, x), (reduced.inputs[0], u), (unknowns, z)):
        _fill(w, own, ca.vertsplit(symbols) if symbols.numel() else [])
    lower_steps(program, w, t)
    f, g = _column(w[r] for r in reduced.derivatives.tolist()), _column(w[r] for r in residuals.tolist())
    y = _column(w[r] if r >= 0 else ca.SX.nan() for r in registers.tolist())
    dx = ca.SX.sym("dx", len(reduced.states))
    names = (
        tuple(reduced.state_names),
        tuple(reduced.register_name(int(r)) for r in unknowns),
        _input_names(reduced),
        tuple(flat.variable_name(int(v)) for v in parameters),
    )
    residual = ca.Function(
        "residual", [t, dx, x, z, u, p], [ca.vertcat(f - dx, g)], ["t", "dx", "x", "z", "u", "p"], ["r"]
    )
    expressions = {"t": t, "x": x, "z": z, "u": u, "p": p, "ode": f, "alg": g}
    dae = IndexOne(*names, residual, expressions, values[parameters], lambda: find_start(unknowns))
    right = ca.Function("right", [t, x, z, u, p], [f, y], ["t", "x", "z", "u", "p"], ["dx", "y"])
    shown = tuple(flat.variable_name(int(v)) for v in outputs)
    return Functions(names[0], names[2], names[3], shown, values[parameters], dae, right)


def _input_names(reduced: Reduced) -> tuple[str, ...]:
    """Return the names of the inputs and their derivatives; of those that hold the mode of a law, with its name."""
    flat, form = reduced.flat, reduced.switched
    held: dict[int, str] = {}
    if form is not None:
        for k, law in enumerate(law_names(flat, form.laws)):
            own = {"closed": form.closed[k], "force": form.push[k], "direction": form.direction[k]}
            held |= {int(v): f"{word}({law})" for word, v in own.items() if v != NONE}
    return tuple(
        held[v] if v in held and order == 0 else flat.jet_name(v, order) for v, order in reduced.inputs[1:].T.tolist()
    )


def _parameters(reduced: Reduced) -> tuple[np.ndarray, np.ndarray]:
    """The independent parameters, and an expression for every parameter and constant."""
    import casadi as ca

    flat = reduced.flat
    of_variable = np.full(flat.count, None, object)
    bound = np.zeros(flat.count, bool)
    for a in flat.bindings:
        bound[a.target] = a.slots.shape[1] > 0 or flat.kind[a.target[0]] != Kind.PARAMETER
    independent = np.flatnonzero((flat.kind == Kind.PARAMETER) & ~bound)
    for v in independent.tolist():
        of_variable[v] = ca.SX.sym(flat.variable_name(v))
    for a in flat.bindings:
        if flat.kind[a.target[0]] in (Kind.CONSTANT, Kind.PARAMETER):
            for i, target in enumerate(a.target.tolist()):
                if of_variable[target] is None:
                    of_variable[target] = _bound(a, i, of_variable)
    return independent, of_variable


def _bound(a, row: int, of_variable: np.ndarray):
    """The right-hand side of one binding."""
    import casadi as ca

    if a.numbers is not None:
        return ca.SX(float(a.numbers[row]))
    return ca.SX(lower_shape(a.shape, lambda k: of_variable[a.slots[row, k]], None))


def _fill(w: list, registers: np.ndarray, expressions) -> None:
    for register, expression in zip(registers.tolist(), expressions, strict=True):
        w[register] = expression


def _column(entries):
    import casadi as ca

    return ca.densify(ca.vertcat(ca.SX(0, 1), *entries))
