"""The solved system as casadi functions of states, inputs and parameters: for optimal control and embedding."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from lmoc.ir.flat import Kind
from lmoc.ir.program import needed_steps, program_rows
from lmoc.ir.reduced import Reduced
from lmoc.messages.diagnostics import Diagnostic, ModelError
from lmoc.numerics.evaluate.casadi_system import can_lower, lower_shape, lower_steps

if TYPE_CHECKING:
    import casadi

MOST_ROWS = 50_000  # each becomes nodes of its own


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
    """

    states: tuple[str, ...]
    inputs: tuple[str, ...]
    parameters: tuple[str, ...]
    outputs: tuple[str, ...]
    values: np.ndarray
    ode: casadi.Function
    output: casadi.Function

    @cached_property
    def jacobian(self) -> casadi.Function:
        """(t, x, u, p) → (∂f/∂x, ∂f/∂u, ∂h/∂x, ∂h/∂u): A, B, C and D of the linear model."""
        import casadi as ca

        t, x, u, p = arguments = [ca.SX.sym(*sizes) for sizes in self._sizes]
        f, h = self.ode(*arguments), self.output(*arguments)
        blocks = [ca.jacobian(g, v) for g in (f, h) for v in (x, u)]
        return ca.Function("jacobian", arguments, blocks, ["t", "x", "u", "p"], ["A", "B", "C", "D"])

    @property
    def _sizes(self) -> list[tuple[str, int]]:
        return [("t", 1), ("x", len(self.states)), ("u", len(self.inputs)), ("p", len(self.parameters))]


def casadi_functions(reduced: Reduced, values: np.ndarray) -> Functions:
    """Lower a reduced system.

    Raises
    ------
    ModelError
        E0626 where the system is too large, or implicit and not linear.
    """
    import casadi as ca

    flat = reduced.flat
    outputs = np.flatnonzero(flat.per_variable(lambda b: b.output, bool))
    registers = reduced.register_of[outputs]
    observe = needed_steps(reduced.observe, registers[registers >= 0], reduced.registers.count)
    program = reduced.parameter_program + reduced.rhs + observe
    if not can_lower(program) or program_rows(program) > MOST_ROWS:
        why = "it is too large" if can_lower(program) else "a block of it is nonlinear, or linear with many unknowns"
        raise ModelError([Diagnostic("E0626", f"'{flat.name}' cannot be written as casadi functions: {why}")])
    parameters, of_variable = _parameters(reduced)
    t, p = ca.SX.sym("t"), ca.vertcat(ca.SX(0, 1), *of_variable[parameters])
    x, u = ca.SX.sym("x", len(reduced.states)), ca.SX.sym("u", reduced.inputs.shape[1])
    w: list = [None] * reduced.registers.count
    _fill(w, reduced.known[0], of_variable[reduced.known[1]])
    _fill(w, reduced.states, ca.vertsplit(x) if x.numel() else [])
    _fill(w, reduced.inputs[0], ca.vertsplit(u) if u.numel() else [])
    lower_steps(program, w, t)
    y = [w[r] if r >= 0 else ca.SX.nan() for r in registers.tolist()]
    names = ["t", "x", "u", "p"]
    return Functions(
        tuple(reduced.state_names),
        tuple(flat.jet_name(int(v), int(order)) for v, order in reduced.inputs[1:].T),
        tuple(flat.variable_name(int(v)) for v in parameters),
        tuple(flat.variable_name(int(v)) for v in outputs),
        values[parameters],
        ca.Function("ode", [t, x, u, p], [_column(w[r] for r in reduced.derivatives.tolist())], names, ["dx"]),
        ca.Function("output", [t, x, u, p], [_column(y)], names, ["y"]),
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
