"""Reduced systems written by hand, so that numerics is tested without the stages before it."""

from __future__ import annotations

import numpy as np

from lmoc.expression import dag
from lmoc.expression.dag import Expr, slot
from lmoc.ir.flat import Assignments, Block, FlatDAE, Kind, Sums
from lmoc.ir.program import Apply, Registers, Role
from lmoc.ir.reduced import Reduced

NO_SUMS = Sums(np.zeros(1, int), np.zeros(0, int), np.zeros(0))


class Scene:
    """Collects variables and explicit equations; a variable is the slot whose column is its index."""

    def __init__(self) -> None:
        self.names: list[str] = []
        self.kinds: list[Kind] = []
        self.bindings: list[Assignments] = []
        self.starts: list[Assignments] = []
        self.fixed: list[Assignments] = []
        self.nominals: list[Assignments] = []
        self.rates: dict[int, Expr] = {}
        self.quadratures: dict[int, Expr] = {}
        self.algebraic: dict[int, Expr] = {}

    def variable(self, name: str, kind: Kind = Kind.UNKNOWN) -> Expr:
        self.names.append(name)
        self.kinds.append(kind)
        return slot(len(self.names) - 1)

    def parameter(self, name: str, value: float) -> Expr:
        x = self.variable(name, Kind.PARAMETER)
        self.bindings.append(self.assignment(x, dag.const(value)))
        return x

    def input(self, name: str, default: Expr | None = None) -> Expr:
        x = self.variable(name, Kind.INPUT)
        if default is not None:
            self.bindings.append(self.assignment(x, default))
        return x

    def state(self, name: str, start: float | None = None, fixed: bool | None = None) -> Expr:
        x = self.variable(name)
        self.rates[x.value[0]] = dag.ZERO
        self.begin(x, start, fixed)
        return x

    def begin(self, x: Expr, start: float | None = None, fixed: bool | None = None) -> None:
        if start is not None:
            self.starts.append(self.assignment(x, dag.const(start)))
        if fixed is not None:
            self.fixed.append(self.assignment(x, dag.const(fixed)))

    def rate(self, x: Expr, value) -> None:
        self.rates[x.value[0]] = dag.lift(value)

    def quadrature(self, name: str, value) -> Expr:
        x = self.variable(name)
        self.quadratures[x.value[0]] = dag.lift(value)
        return x

    def define(self, name: str, value) -> Expr:
        x = self.variable(name)
        self.algebraic[x.value[0]] = dag.lift(value)
        return x

    @staticmethod
    def assignment(x: Expr, value: Expr) -> Assignments:
        shape, slots = compress(value)
        return Assignments(np.array([x.value[0]]), shape, slots)

    # ------------------------------------------------------------------------------------------

    def flat(self, **more) -> FlatDAE:
        blocks = [
            Block(tuple((part, ()) for part in name.split(".")), i, 1, kind)
            for i, (name, kind) in enumerate(zip(self.names, self.kinds, strict=True))
        ]
        attributes = {k: tuple(getattr(self, k)) for k in ("bindings", "starts", "fixed", "nominals")}
        return FlatDAE("Scene", "", tuple(blocks), (), (), NO_SUMS, **attributes, **more)

    def reduced(self, steps=None, observe=None, more_registers: int = 0, **flat_more) -> Reduced:
        """Registers are the variables, then the right-hand sides, then `more_registers` helpers."""
        flat = self.flat(**flat_more)
        n = flat.count
        rates = {v: n + i for i, v in enumerate([*self.rates, *self.quadratures])}
        count = n + len(rates) + more_registers
        role = np.full(count, Role.COMPUTED)
        known = np.flatnonzero((flat.kind == Kind.PARAMETER) | (flat.kind == Kind.CONSTANT))
        inputs = np.flatnonzero(flat.kind == Kind.INPUT)
        rhs = [apply_step(v, e) for v, e in self.algebraic.items()] if steps is None else list(steps)
        rhs += [apply_step(rates[v], e) for v, e in self.rates.items()]
        watch = [apply_step(rates[v], e) for v, e in self.quadratures.items()] + list(observe or ())
        variable = np.concatenate([np.arange(n), [*rates], np.full(more_registers, -1)]).astype(int)
        order = np.concatenate([np.zeros(n), np.ones(len(rates)), np.zeros(more_registers)]).astype(int)
        as_array = lambda d: np.array([rates[v] for v in d], int)  # noqa: E731
        return Reduced(
            flat,
            flat.parameter_values(),
            Registers(role, variable, order),
            np.array([known, known]),
            np.array([inputs, inputs, 0 * inputs]),
            np.ones(len(inputs), bool),
            (),
            np.array([*self.rates], int),
            as_array(self.rates),
            np.array([*self.quadratures], int),
            as_array(self.quadratures),
            tuple(rhs),
            tuple(watch),
            np.arange(n),
        )


def compress(value: Expr) -> tuple[Expr, np.ndarray]:
    """The shape with columns 0, 1, … and its row of slots."""
    leaves = dag.slots(value)
    shape = dag.substitute(value, {leaf: slot(k) for k, leaf in enumerate(leaves)})
    return shape, np.array([[leaf.value[0] for leaf in leaves]], int).reshape(1, -1)


def apply_step(register: int, value: Expr) -> Apply:
    shape, slots = compress(value)
    return Apply(shape, slots, np.array([register]))


def oscillator(m=2.0, k=50.0, c=0.0, q0=0.1, ledger=True) -> Scene:
    """A mass on a spring and a damper, driven by an input f, with its energy ledger."""
    s = Scene()
    m_, k_, c_ = s.parameter("m", m), s.parameter("k", k), s.parameter("c", c)
    f = s.input("f", dag.ZERO)
    q, v = s.state("q", q0), s.state("v")
    a = s.define("a", (f - k_ * q - c_ * v) / m_)
    s.rate(q, v)
    s.rate(v, a)
    if ledger:
        s.define("ledger.stored", 0.5 * m_ * v * v + 0.5 * k_ * q * q)
        lost, supplied = s.define("ledger.lost", c_ * v * v), s.define("ledger.supplied", f * v)
        s.quadrature("ledger.work", supplied)
        s.quadrature("ledger.heat", lost)
    return s
