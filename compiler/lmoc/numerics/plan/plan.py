"""A reduced system with its signals: what a run integrates, still independent of how it is evaluated."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import field
from functools import cached_property
from typing import TypeVar

import numpy as np

from lmoc.expression.dag import ONE, Expr, slot
from lmoc.ir.flat import Kind
from lmoc.ir.program import Apply, Program, Solve, needed_steps, program_rows, read, walk, written
from lmoc.ir.reduced import Reduced
from lmoc.messages.diagnostics import Diagnostic, Report
from lmoc.numerics.limits import SMALL_PLAN
from lmoc.numerics.signals.signals import Constant, Formula, Signal, gives
from lmoc.numerics.signals.tables import Table
from lmoc.support.records import dataclass
from lmoc.support.sizes import LARGE_BLOCK

Made = TypeVar("Made")

LEDGER = ("ledger.work", "ledger.heat")


@dataclass(frozen=True, eq=False, repr=False)
class Plan:
    """The system that is integrated.

    Attributes
    ----------
    count : number of registers: those of the reduced system and a few for parameters that only signals read
    known : (2, k) as in Reduced, with the parameters of signals
    sampled : registers filled by asking `samplers` at each time
    samplers : (flat variable, order) for each of `sampled`
    constants : {register: flat variable or -1}; inputs that stay as they are, -1 for a derivative (zero)
    absent : registers of inputs whose derivative nobody can give, NaN
    input_program : fills the other input registers
    states : (n,) registers integrated: the states, then the quadratures
    derivatives : (n,)
    program : input_program and what fills `derivatives`
    held : (n,) registers by which laws hold a component: 1 where its derivative is zero, not only up to the rounding of
        the forces on it, else 0; -1 of components that no law can hold
    holding : the part of `program` that fills the derivatives of these
    """

    reduced: Reduced
    count: int
    known: np.ndarray
    sampled: np.ndarray
    samplers: tuple[tuple[int, int], ...]
    constants: tuple[tuple[int, int], ...]
    absent: np.ndarray
    input_program: Program
    states: np.ndarray
    derivatives: np.ndarray
    program: Program
    held: np.ndarray
    holding: Program
    notes: tuple[Diagnostic, ...] = ()
    _made: dict = field(default_factory=dict)

    def __getstate__(self) -> dict[str, object]:
        """Return what a copy begins with: what has been made from the plan belongs to this process."""
        return {**self.__dict__, "_made": {}}

    @property
    def state_count(self) -> int:
        """States without quadratures."""
        return len(self.reduced.states)

    @cached_property
    def ledger(self) -> np.ndarray:
        """(n,) whether a component is work or heat of the energy ledger."""
        variables = [v for name in LEDGER for v in _variables(self.reduced, name)]
        return np.isin(self.reduced.registers.variable[self.states], variables)

    @cached_property
    def accounts(self) -> tuple[int, int]:
        """The components that are the work and the heat of the ledger; -1 where there is none."""
        own = self.reduced.registers.variable[self.states]
        at = [np.flatnonzero(self.ledger & np.isin(own, _variables(self.reduced, name))) for name in LEDGER]
        return (int(at[0][0]), int(at[1][0])) if all(map(len, at)) else (-1, -1)

    @cached_property
    def stored(self) -> int:
        """The register of the stored energy of the ledger; -1 where there is none."""
        found = self.reduced.flat.find("ledger.stored")
        return -1 if found is None else max(-1, int(self.reduced.register_of[found[0]]))

    @cached_property
    def row_count(self) -> int:
        """Rows of all steps, as a measure of size."""
        return program_rows(self.program)

    @property
    def has_large_blocks(self) -> bool:
        """Return whether a block needs sparse factors: then C pays for fewer rows too."""
        return any(isinstance(s, Solve) and s.unknowns.shape[1] > LARGE_BLOCK for s in self.program)

    @cached_property
    def parameters(self) -> np.ndarray:
        """Registers that the program reads and that do not change during a run."""
        changing = np.zeros(self.count, bool)
        for registers in (self.states, self.sampled, *map(written, self.program)):
            changing[registers] = True
        used = np.zeros(self.count, bool)
        for step in self.program:
            used[read(step)] = True
        used[self.derivatives] = True
        for step in walk(self.program):
            if isinstance(step, Solve) and step.guess is not None:
                used[step.guess[step.guess >= 0]] = True
        return np.flatnonzero(used & ~changing)

    @cached_property
    def full_program(self) -> Program:
        """Fills every register that the reduced system knows of."""
        return self.input_program + self.reduced.rhs + self.reduced.observe + self.holding

    def once(self, make: Callable[[Plan], Made]) -> Made:
        """Return ``make(self)``, made once: for what readers of a plan derive from it."""
        if make not in self._made:
            self._made[make] = make(self)
        return self._made[make]

    @cached_property
    def read_parameters(self) -> np.ndarray:
        """(2, k) the columns of `known` whose parameters an equation reads."""
        flat, steps = self.reduced.flat, (*self.reduced.parameter_program, *self.full_program)
        shown = self.reduced.register_of[flat.kind > Kind.PARAMETER]  # a variable may be a parameter by another name
        used = np.zeros(self.count + 1, bool)  # the last one stands for "nowhere"
        for registers in (shown, *map(read, steps)):
            used[registers] = True
        return self.known[:, used[self.known[0]]]

    @cached_property
    def derived(self) -> tuple[np.ndarray, np.ndarray]:
        """Variables of the flat model that follow from parameters alone, and their registers."""
        steps = self.reduced.parameter_program
        filled = np.zeros(self.count + 1, bool)  # the last one stands for "nowhere"
        for step in steps:
            filled[written(step)] = True
        variables = np.flatnonzero(filled[self.reduced.register_of] & (self.reduced.flat.kind == Kind.UNKNOWN))
        return variables, self.reduced.register_of[variables]

    def base(self, values: np.ndarray, signals: Mapping[int, Signal]) -> np.ndarray:
        """The register vector with everything that does not change during a run; NaN elsewhere."""
        from lmoc.numerics.solve.interpreter import Interpreter

        w = np.full(self.count, np.nan)
        w[self.known[0]] = values[self.known[1]]
        for register, variable in self.constants:
            w[register] = signals[variable].value if variable >= 0 else 0.0
        given = w.tobytes() if self.count <= SMALL_PLAN else b""
        before = self._made.get(Plan.base)
        if given and before is not None and before[0] == given:
            return before[1].copy()
        Interpreter(self.reduced.parameter_program, self.count).run(w, np.nan)
        if given:
            self._made[Plan.base] = given, w.copy()
        return w

    def nominal(self, values: np.ndarray) -> np.ndarray:
        """Return the nominal values of the integrated components; NaN where the model gives none.

        Parameters
        ----------
        values : (flat.count,) parameters, for (n,); or (flat.count, runs), for (n, runs)
        """
        flat, table = self.reduced.flat, self.reduced.registers
        given = np.full((flat.count, *values.shape[1:]), np.nan)
        for a in flat.nominals:
            given[a.target] = np.abs(a.values(values))
        variable = table.variable[self.states]
        found = given[variable]
        found[(variable < 0) | (table.order[self.states] > 0)] = np.nan
        return np.where(np.isfinite(found) & (found > 0), found, np.nan)


def build_plan(reduced: Reduced, signals: Mapping[int, Signal], energy: bool, report: Report) -> Plan:
    """Attach signals to a reduced system.

    Raises
    ------
    ModelError
        Through `report.check` of the caller: an input without a signal (E0520), a derivative that a signal cannot
        give (E0522).
    """
    before = len(report.diagnostics)
    inputs = _Inputs(reduced)
    for column, required in zip(reduced.inputs.T.tolist(), reduced.required_inputs.tolist(), strict=True):
        inputs.add(*column, required, signals, report)  # type: ignore[call-arg]
    known, count, input_program = inputs.finish()
    keep = _wanted_quadratures(reduced, energy and not _unknown_power(reduced, inputs.absent))
    quadratures, rates = reduced.quadratures[keep], reduced.quadrature_derivatives[keep]
    extra = needed_steps(reduced.observe, rates, reduced.registers.count)
    held, derivatives, holding = _held(reduced, count)
    none = np.full(len(quadratures), -1)
    return Plan(
        reduced,
        count + sum(2 * len(step.out) for step in holding),
        known,
        np.array(inputs.sampled, int),
        tuple(inputs.samplers),
        (*inputs.constants, *((register, -1) for register in held[held >= 0].tolist())),
        np.array(inputs.absent, int),
        input_program,
        np.concatenate([reduced.states, quadratures]).astype(int),
        np.concatenate([derivatives, rates]).astype(int),
        input_program + reduced.rhs + extra + holding,
        np.concatenate([held, none]).astype(int),
        holding,
        tuple(report.diagnostics[before:]),
    )


def _held(reduced: Reduced, count: int) -> tuple[np.ndarray, np.ndarray, tuple[Apply, ...]]:
    """Return the registers that hold the states, the derivatives behind them, and the step that fills these.

    Parameters
    ----------
    count : registers so far
    """
    held, derivatives = np.full(len(reduced.states), -1), reduced.derivatives.astype(int)
    rows = np.flatnonzero(~np.isin(derivatives, reduced.states))  # the others follow
    mechanism = reduced.constraints is not None or reduced.invariants is not None  # with programs of their own
    if reduced.switched is None or mechanism or not len(rows):
        return held, derivatives, ()
    held[rows] = count + np.arange(len(rows))
    free, derivatives = derivatives[rows], derivatives.copy()
    derivatives[rows] = held[rows] + len(rows)
    step = Apply(slot(0) * (ONE - slot(1)), np.stack([free, held[rows]], axis=1), derivatives[rows])
    return held, derivatives, (step,)


class _Inputs:
    """Sorts the input registers by how they are filled."""

    def __init__(self, reduced: Reduced) -> None:
        self.reduced = reduced
        self.sampled: list[int] = []
        self.samplers: list[tuple[int, int]] = []
        self.constants: list[tuple[int, int]] = []
        self.absent: list[int] = []
        self.unbound: set[int] = set()
        self.formulas: dict[Expr, list[tuple[int, tuple[int, ...]]]] = {}

    def add(self, register: int, variable: int, order: int, required: bool, signals, report: Report) -> None:
        signal = signals.get(variable)
        if signal is None:
            self.absent.append(register)
            if variable not in self.unbound:  # even where no state depends on it: what does would be NaN in silence
                _report_unbound(self.reduced, variable, report)
            self.unbound.add(variable)
        elif isinstance(signal, Constant):
            self.constants.append((register, variable if order == 0 else -1))
        elif not gives(signal, order, required):
            self.absent.append(register)
            _report_rough(self.reduced, variable, order, required, isinstance(signal, Table), report)
        elif isinstance(signal, Formula):
            self.formulas.setdefault(signal.derivative(order), []).append((register, signal.variables))
            if signal.kinked and (order > 2 or (order == 2 and not required)):
                _report_kink(self.reduced, variable, order, report)
        else:
            self.sampled.append(register)
            self.samplers.append((variable, order))

    def finish(self) -> tuple[np.ndarray, int, Program]:
        """Registers of parameters, number of all registers, the program of the formulas."""
        known = self.reduced.known
        register_of = dict(zip(known[1].tolist(), known[0].tolist(), strict=True))
        count = self.reduced.registers.count
        steps, added = [], []
        for shape, rows in self.formulas.items():
            for _, variables in rows:
                for v in variables:
                    if v not in register_of:
                        register_of[v] = count + len(added)
                        added.append(v)
            slots = np.array([[register_of[v] for v in variables] for _, variables in rows], int)
            slots = slots.reshape(len(rows), -1)
            steps.append(Apply(shape, slots, np.array([register for register, _ in rows], int)))
        extra = np.array([count + np.arange(len(added)), np.array(added, int)])
        return np.concatenate([known, extra], axis=1).astype(int), count + len(added), tuple(steps)


def _report_unbound(reduced: Reduced, variable: int, report: Report) -> None:
    flat = reduced.flat
    block = flat.block_at(variable)
    name = flat.variable_name(variable)
    report.error(
        "E0520",
        f"input '{name}' has no signal",
        block.span,
        hint=f"bind it in the model (`input Real {name} = sin(time)`), or give --input {name}='sin(time)'",
    )


def _report_rough(reduced: Reduced, variable: int, order: int, required: bool, table: bool, report: Report) -> None:
    flat = reduced.flat
    jet = flat.jet_name(variable, order)
    name = flat.variable_name(variable)
    if required:
        report.error(
            "E0522",
            f"the signal of input '{name}' does not give its derivative {jet}",
            flat.block_at(variable).span,
            expected=f"a signal with {order} derivative{'s' * (order > 1)}: it prescribes a motion",
            hint="a table has two derivatives, and one where a time occurs twice: there its values jump"
            if table
            else "a formula in time has all derivatives, a table two, a callable those of its method derivative(n)",
        )
    else:
        span = flat.block_at(variable).span
        report.note("N0523", f"{jet} is unknown, so what depends on it is reported as NaN", span)


def _report_kink(reduced: Reduced, variable: int, order: int, report: Report) -> None:
    flat = reduced.flat
    report.warning(
        "W0524",
        f"the formula of input '{flat.variable_name(variable)}' has kinks or jumps, and "
        f"{flat.jet_name(variable, order)} is used: the impulse at a kink is omitted",
        flat.block_at(variable).span,
    )


def _wanted_quadratures(reduced: Reduced, energy: bool) -> np.ndarray:
    if energy:
        return np.ones(len(reduced.quadratures), bool)
    ledger = [v for name in LEDGER for v in _variables(reduced, name)]
    return ~np.isin(reduced.registers.variable[reduced.quadratures], ledger)


def _unknown_power(reduced: Reduced, absent: list[int]) -> bool:
    """Return whether the ledger needs derivatives that no signal gives: then there is none."""
    if not absent:
        return False
    rates = reduced.quadrature_derivatives[~_wanted_quadratures(reduced, False)]
    steps = needed_steps(reduced.observe, rates, reduced.registers.count)
    return any(np.isin(absent, read(step)).any() for step in steps) or bool(np.isin(absent, rates).any())


def _variables(reduced: Reduced, name: str) -> list[int]:
    found = reduced.flat.find(name)
    return [] if found is None else found.tolist()
