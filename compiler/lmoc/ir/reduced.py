"""The reduced system: the smallest set of states, and the programs that fill every register from them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import field
from functools import cached_property

import numpy as np

from lmoc.expression.dag import Expr
from lmoc.ir.flat import FlatDAE
from lmoc.ir.law import Switched
from lmoc.ir.program import Program, Registers
from lmoc.messages.diagnostics import Diagnostic, Subject
from lmoc.support.records import dataclass


@dataclass(frozen=True)
class Guard:
    """A decision that depends on parameter values: re-check it for another parameter set.

    `holds(values)` gets `FlatDAE.parameter_values(...)`; `text` says in the user's names what was assumed, such as
    ``wheel.J = 0``. Where it is about many rows, `broken(values)` says it of the first one that has changed. `open`:
    it excludes what is singular, so that where it holds, it holds for all values nearby.
    """

    holds: Callable[[np.ndarray], bool]
    text: str
    broken: Callable[[np.ndarray], str] | None = None
    open: bool = False


@dataclass(frozen=True, eq=False)
class DiscreteStep:
    """Discrete variables that are computed at events, all in one way, over variables of the flat model.

    Attributes
    ----------
    op : "gt", "ge" or "floor" of a relation: ``value > 0``, ``value ≥ 0``, ``floor(value)``; "" for the value itself
    value : Expr
    slots : (n, columns) variables
    target : (n,) discrete variables
    relation : which of `Events.relations`, -1 where it is none; `rows` are those of it
    """

    op: str
    value: Expr
    slots: np.ndarray
    target: np.ndarray
    relation: int
    rows: np.ndarray


@dataclass(frozen=True, eq=False)
class Constraints:
    """The matrix ∂g/∂q of the constraints behind those dependent coordinates that are divided by along the motion.

    Its rows with their dependent coordinates, a square matrix, and the coordinates that could take their place. Where
    fewer constraints tie positions than velocities, those have rows and columns of their own behind the others.

    Attributes
    ----------
    program : Program
        Fills the entries from registers of the right-hand side.
    count : registers, those of the entries included
    row, column, register : (nnz,) places and registers of the entries; columns below the number of rows are dependent
        coordinates, the others are states
    watched : (rows,) dependent coordinates whose rows change along the motion; the others follow by constant pivots
    variable : (columns,) the flat variable of each coordinate
    source : (rows,) the flat equation that each row comes from
    stage : (columns,) how often what is tied there has been integrated, from 0; rows have that of their dependents
    """

    program: Program
    count: int
    row: np.ndarray
    column: np.ndarray
    register: np.ndarray
    watched: np.ndarray
    variable: np.ndarray
    source: np.ndarray
    stage: np.ndarray

    @property
    def rows(self) -> int:
        """Number of rows, and of dependent coordinates."""
        return int(self.row.max()) + 1

    @property
    def shape(self) -> tuple[int, int]:
        """Numbers of rows and columns."""
        return self.rows, len(self.variable)

    @property
    def keys(self) -> tuple[np.ndarray, np.ndarray]:
        """Return numbers for rows and for columns, the same in all choices of coordinates."""
        stage = self.stage.astype(np.int64) << 32
        return self.source + stage[: self.rows], self.variable + stage

    @property
    def place(self) -> np.ndarray:
        """Return where each entry is added to in the matrix by rows."""
        found: np.ndarray = self.row.astype(np.int64) * len(self.variable) + self.column
        return found


@dataclass(frozen=True, eq=False)
class Invariants:
    """The equations that close loops and their derivatives, as far as these hold along a motion without being solved.

    In minimal coordinates they are solved, and vanish to the accuracy of Newton's method.

    Attributes
    ----------
    program : Program
        Fills the residuals from registers of the right-hand side and of what is observed.
    count : registers, those of the residuals included
    residual : (k,) registers
    stage : (k,) 1 for what ties the jets just below the highest (velocities), 2 for what ties those below (positions)
    source : (k,) flat equation that each comes from
    state_stage : (states,) the same for the states
    acceleration : registers that the highest derivatives of the closures are set to, by the right-hand side or by
        whoever leaves those steps out; empty in minimal coordinates
    lower : (2, …) for each of these the residuals of stage 1 and 2 of the same closure, -1 where there is none
    """

    program: Program
    count: int
    residual: np.ndarray
    stage: np.ndarray
    source: np.ndarray
    state_stage: np.ndarray
    acceleration: np.ndarray
    lower: np.ndarray


@dataclass(frozen=True, eq=False)
class StartGuess:
    """Where a start with nonlinear constraints is looked for: the place nearest to the start values where they hold.

    Attributes
    ----------
    states : (n,) values of the states
    unknowns, values : registers of unknowns of nonlinear blocks, and their values
    closed : whether the constraints hold there
    tied, nearest : flat variables that they contain, and their values there, NaN where others may be nearer
    ways : for each loop that can be put together in several ways: flat variables (m,) that tell them apart, and their
        values (k, m) in each, in those taken first
    failures : why the constraints cannot hold anywhere, where that is certain
    doubts : why they may not hold with what is fixed: reasons if no start is found
    """

    states: np.ndarray
    unknowns: np.ndarray
    values: np.ndarray
    closed: bool
    tied: np.ndarray
    nearest: np.ndarray
    ways: tuple[tuple[np.ndarray, np.ndarray], ...] = ()
    failures: tuple[Diagnostic, ...] = ()
    doubts: tuple[Diagnostic, ...] = ()


@dataclass(frozen=True, eq=False)
class Reduced:
    """The result of reduction.

    Attributes
    ----------
    flat : FlatDAE
        Where it comes from.
    values : (flat.count,)
        The parameter values for which the guards were decided.
    registers : Registers
    known : (registers, variables)
        ``w[known[0]] = parameter_values[known[1]]``.
    inputs : (3, n)
        Rows: register, flat variable, order of the derivative. `required_inputs` marks those without which the run
        cannot go (the others serve the energy ledger or observed variables only).
    parameter_program : Program
        Fills the DERIVED registers from the KNOWN ones; run once for each parameter set.
    states, derivatives : (n,) registers
        ``d w[states[i]] / dt = w[derivatives[i]]``. A derivative may be a state (q̇ of a second-order coordinate).
    quadratures, quadrature_derivatives : (m,) registers
        Integrated along, read by no equation.
    rhs : Program
        Fills `derivatives` from states, inputs, parameters and time; nothing that they do not need.
    observe : Program
        Fills everything else, given states, quadratures, inputs and what `rhs` has filled.
    register_of : (flat.count,)
        Register of each flat variable after `rhs` and `observe` (-1: nowhere, see `unavailable`).
    guards : what depends on the parameter values
    notes : dropped redundant equations, chosen coordinates that deserve a word
    counts : {"parts", "equations", "after elimination", "states"} in the order of the stages, for people
    guess : where the start is looked for with these parameter values and the model's start values; None where there
        are no nonlinear constraints
    guess_at : the same for other parameter values (flat.count,), and for variables with values that are fixed at the
        start; None where there is nothing to guess, and in a reduction that has been kept on disk
    switched : where the laws are, whose modes are values of the equations; None without laws
    discrete : the discrete equations in their order, carried out at events
    started : the initial equations of discrete variables in their order, for what these have been before the start
    constraints : what the choice of coordinates divides by; None where that never changes
    undetermined : (k,) flat variables that the model does not determine (reactions in a redundant loop): reported NaN
    invariants : the closures of its loops; None where no constraints change along the motion
    """

    flat: FlatDAE
    values: np.ndarray
    registers: Registers
    known: np.ndarray
    inputs: np.ndarray
    required_inputs: np.ndarray
    parameter_program: Program
    states: np.ndarray
    derivatives: np.ndarray
    quadratures: np.ndarray
    quadrature_derivatives: np.ndarray
    rhs: Program
    observe: Program
    register_of: np.ndarray
    guards: tuple[Guard, ...] = ()
    notes: tuple[Diagnostic, ...] = ()
    counts: dict[str, int] = field(default_factory=dict)
    guess: StartGuess | None = None
    guess_at: Callable[[np.ndarray, tuple[np.ndarray, np.ndarray]], StartGuess] | None = None
    switched: Switched | None = None
    lawful: FlatDAE | None = None  # of a switched form: the flat model with its laws
    free: Reduced | None = None  # of a switched form: all laws open and their forces given, in the same states
    constraints: Constraints | None = None
    undetermined: np.ndarray = field(default_factory=lambda: np.zeros(0, int))
    discrete: tuple[DiscreteStep, ...] = ()
    started: tuple[DiscreteStep, ...] = ()
    invariants: Invariants | None = None

    @property
    def left_out(self) -> tuple[str, ...]:
        """The notes on redundant constraints that have been left out."""
        return tuple(note.message for note in self.notes if note.subject is Subject.LEFT_OUT)

    def register_name(self, register: int) -> str:
        """A register in the user's names; helpers, and those that a plan adds, are ``#n``."""
        variable = -1 if register >= self.registers.count else int(self.registers.variable[register])
        if variable < 0:
            return f"#{register}"
        return self.flat.jet_name(variable, int(self.registers.order[register]))

    @property
    def in_all_coordinates(self) -> bool:
        """Return whether all coordinates of closed loops are states."""
        return self.invariants is not None and len(self.invariants.acceleration) > 0

    @cached_property
    def state_names(self) -> list[str]:
        return [self.register_name(int(r)) for r in self.states]

    def has_states_of(self, origin: Reduced) -> bool:
        """Return whether the states are those of a scene that this one has more variables than; a law's own variables
        are numbered anew, and stand behind those added."""
        first, added = (origin.lawful or origin.flat).count, self.flat.count - origin.flat.count
        own, theirs = (r.registers.variable[r.states] for r in (self, origin))
        orders = [r.registers.order[r.states] for r in (self, origin)]
        return np.array_equal(own - added * (own >= first + added), theirs) and np.array_equal(*orders)

    @cached_property
    def _made_for(self) -> bytes:
        return self.values.tobytes()

    def guards_hold(self, values: np.ndarray, near: bool = False) -> np.ndarray:
        """Return for which runs (runs,) all assumptions hold, by their parameter values (flat.count, runs).

        Parameters
        ----------
        near : the values are as near to some with which all hold as is asked for; what they are is known the next time
        """
        if not near:
            return self._guards_hold(values, near)
        key = values.tobytes()
        if key not in self._near:
            self._near.clear()
            self._near[key] = self._guards_hold(values, near)
        return self._near[key].copy()

    @cached_property
    def _near(self) -> dict[bytes, np.ndarray]:
        return {}

    def _guards_hold(self, values: np.ndarray, near: bool) -> np.ndarray:
        good = np.ones(values.shape[1], bool)
        for guard in self.guards:
            if near and guard.open:
                continue
            together = getattr(guard.holds, "of_runs", None)
            held = None if together is None else together(values)
            if held is None:
                rows = np.flatnonzero(good)
                good[rows] = [guard.holds(np.ascontiguousarray(values[:, k])) for k in rows.tolist()]
            else:
                good &= held
        return good

    def broken_guard(self, values: np.ndarray) -> str | None:
        """The first assumption that does not hold for another parameter set, None where all hold.

        Parameters
        ----------
        values : (≤ flat.count,) of the flat model that was given; the variables that a switched form adds have none
        """
        values = self.flat.extended(values)
        if values.tobytes() == self._made_for:  # some guards cost as much as a reduction
            return None
        guard = next((g for g in self.guards if not g.holds(values)), None)
        return None if guard is None else guard.text if guard.broken is None else guard.broken(values)
