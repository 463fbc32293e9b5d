"""The flat DAE: one table of variables and groups of equations that share a shape.

Nothing here is made per variable or per equation: a chain of 10⁵ masses has as many blocks and groups as a
chain of three. Names are made on demand.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import field
from enum import IntEnum
from functools import cached_property
from math import prod

import numpy as np

from lmoc.expression.dag import Expr, depends_on_time
from lmoc.expression.evaluate import evaluate
from lmoc.expression.text import to_text
from lmoc.ir.events import Events
from lmoc.ir.law import Laws
from lmoc.ir.look import PLAIN, Look
from lmoc.ir.paths import NamePath, dims_of, element_name, parse_name, pattern
from lmoc.messages.diagnostics import Diagnostic
from lmoc.messages.source import Span
from lmoc.support.records import dataclass

# parts whose force grows with a length or a rate, and the units of what it grows by
_ELASTIC = {"spring", "damper", "spring-damper", "torsion-spring", "torsion-damper"}
_COEFFICIENTS = {"N/m", "N/m3", "N.s/m", "N.m/rad", "N.m.s/rad"}


class Kind(IntEnum):
    """The role of a variable for the solver."""

    CONSTANT = 0
    PARAMETER = 1
    INPUT = 2  # a signal from outside: a top-level `input`
    UNKNOWN = 3  # to be found: potentials, flows, coordinates, forces, energies
    DISCRETE = 4  # changes at events only


class StateSelect(IntEnum):
    """Modelica's stateSelect, 4.9.7.1, in the order of preference."""

    never = 0
    avoid = 1
    default = 2
    prefer = 3
    always = 4


@dataclass(frozen=True)
class Slider:
    """What the declaration of a parameter says of its slider; None where it does not say it."""

    min: float | None = None
    max: float | None = None
    step: float | None = None


@dataclass(frozen=True, eq=False)
class Block:
    """A declared name: the variables ``offset … offset+size-1``, in row-major order of all dimensions of its path.

    ``seg[3].m[2].q`` belongs to the block with path ``(("seg", (N,)), ("m", (M,)), ("q", ()))``.
    """

    path: NamePath
    offset: int
    size: int
    kind: Kind
    unit: str = ""  # as written; "" is unknown
    quantity: str = "Real"  # Real, Integer, Boolean, String, or the enumeration's name
    description: str = ""
    flow: bool = False
    connector: bool = False  # declared in a connector
    output: bool = False  # a top-level `output`
    protected: bool = False
    final: bool = False  # a parameter that cannot be set: it is declared so, or follows from others
    structural: bool = False  # a parameter whose value has shaped the flat model: changing it means flattening again
    state_select: StateSelect = StateSelect.default
    part: int = 0  # index into FlatDAE.parts
    span: Span | None = None
    slider: Slider | None = None  # of a parameter that matters first
    conditional: bool = False  # structural in FlatDAE.decisions alone: as long as these hold, so does the flat model

    @property
    def dims(self) -> tuple[int, ...]:
        return dims_of(self.path)

    def name(self, position: int) -> str:
        """Dotted name of one of its variables (`position` counted from 0 within the block)."""
        return element_name(self.path, position)

    @property
    def pattern(self) -> str:
        """Name of the block as a whole: ``m[1:10000].q``."""
        return pattern(self.path)


@dataclass(frozen=True, eq=False)
class Part:
    """A component instance (or array of them) of a class with equations or connectors; part 0 is the whole model.

    Attributes
    ----------
    path : as of Block
    class_name : str
    ports : pairs (potential, flow) of block indices, one for each potential/flow pair of its own connectors
    leaf : bool
        No part below it has ports: an element of the scene, not an assembly.
    look : in pictures
    """

    path: NamePath
    class_name: str
    description: str
    ports: tuple[tuple[int, int], ...]
    leaf: bool
    span: Span | None = None  # of the declaration
    parent: int = 0
    look: Look = PLAIN

    @property
    def pattern(self) -> str:
        return pattern(self.path)

    def element(self, row: int, rows: int) -> str:
        """Return the name of the element that one of the rows of an equation in it belongs to."""
        return element_name(self.path, row * prod(dims_of(self.path)) // rows)


@dataclass(frozen=True, eq=False)
class Assignments:
    """``target[i] := shape(slots[i])`` for all rows: bindings and attributes of parameters and variables."""

    target: np.ndarray  # (n,) variable indices
    shape: Expr  # over constants, parameters, and (defaults of inputs) time
    slots: np.ndarray  # (n, columns) variable indices
    span: Span | None = None
    numbers: np.ndarray | None = None  # (n,) the right-hand sides where they are plain numbers; the shape is then NaN
    of_class: bool = False  # a start of a type or class of a package, or of a parameter that the start finds: a guess
    rank: int = 0  # of a start: 0 for what counts most where not all can be met

    def values(self, known: np.ndarray, time: float = np.nan) -> np.ndarray:
        """The right-hand sides as an array (n,), given the values of all variables.

        Of many runs, (n, runs) where the values are (variables, runs), or (n, 1) where they are the same in all.
        """
        if self.numbers is not None:
            return self.numbers if known.ndim == 1 else self.numbers[:, None]
        result = np.asarray(evaluate(self.shape, lambda k, _: known[self.slots[:, k]], time), float)
        return result if result.ndim else np.full((len(self.target), *[1] * (known.ndim - 1)), result)


@dataclass(frozen=True, eq=False)
class Group:
    """Equations ``left(slots[i]) = right(slots[i])``, one a row.

    Every column holds variables of one `Kind` only.
    """

    left: Expr
    right: Expr
    slots: np.ndarray  # (n, columns) variable indices
    span: Span | None  # the equation as the user wrote it
    part: int = 0  # whose equation it is
    origin: str = "equation"  # equation, binding, connection, unconnected, sum, argument, law, ledger
    smooth: int = -1  # how often what decides in it without an event is continuously differentiable: from smooth()

    @property
    def rows(self) -> int:
        return len(self.slots)

    @cached_property
    def residual(self) -> Expr:
        return self.left - self.right


@dataclass(frozen=True, eq=False)
class Sums:
    """Segmented sums ``Σ sign[j]·variable[index[j]] = 0`` over ``j`` in ``start[i] … start[i+1]-1``.

    One row a connection set, a total of the ledger, or a sum over a long array.
    """

    start: np.ndarray  # (n+1,)
    index: np.ndarray  # (nnz,) variable indices
    sign: np.ndarray  # (nnz,) ±1.0
    spans: tuple[Span | None, ...] = ()  # places of the connects, deduplicated
    span_of: np.ndarray = field(default_factory=lambda: np.zeros(0, int))  # (n,) index into spans, -1: none

    @property
    def rows(self) -> int:
        return len(self.start) - 1


@dataclass(frozen=True, eq=False)
class Check:
    """``assert(condition, message, level)`` for all rows; `condition` is a shape with logical value."""

    condition: Expr
    message: str
    error: bool  # AssertionLevel.error or .warning
    slots: np.ndarray
    span: Span | None
    at_events: bool = False  # looked at when an event happens, not all the time
    part: int = 0  # index into FlatDAE.parts

    def holds(self, values: np.ndarray) -> np.ndarray:
        """Return for each row whether it holds, for one value (variables,) of each variable and whatever time."""
        used = values[self.slots]
        result = evaluate(self.condition, lambda k, _: used[:, k])
        return np.broadcast_to(np.not_equal(result, 0), (len(used),))


@dataclass(frozen=True, eq=False)
class Decision:
    """Conditions on parameters that have shaped the flat model, one a row: where they are the same, so is the model."""

    condition: Expr
    slots: np.ndarray  # (n, columns) variable indices
    held: np.ndarray  # (n,) whether each of them has held

    def same(self, values: np.ndarray) -> np.ndarray:
        """Return whether all are as they were, for values (variables,) or those of many runs (variables, runs)."""
        found = evaluate(self.condition, lambda k, _: values[self.slots[:, k]])
        held = self.held.reshape(-1, *[1] * (values.ndim - 1))
        shape = len(self.held), *values.shape[1:]
        same: np.ndarray = (np.broadcast_to(np.not_equal(found, 0), shape) == held).all(axis=0)
        return same


@dataclass(frozen=True)
class Experiment:
    """The settings of a model for its runs; None where not stated."""

    start: float | None = None
    stop: float | None = None
    tolerance: float | None = None
    interval: float | None = None


@dataclass(frozen=True, eq=False)
class Simplified:
    """A model with a way to its start: the same variables, and equations with ``homotopy(actual, simplified)``.

    Attributes
    ----------
    flat : the model with ``w*actual + (1 - w)*simplified`` in the place of each homotopy
    weight : the parameter w; the model that is run is that with w = 1
    """

    flat: FlatDAE
    weight: int


@dataclass(frozen=True, eq=False)
class FlatDAE:
    """The flat model.

    `bindings`, `starts`, `fixed`, `nominals` are in an order in which each uses only what precedes it
    (bindings first). A parameter without a row in `bindings` has no value. `starts` has a row only where a start
    value was written (explicitly, or in a type), those that count most last; `fixed` likewise.
    """

    name: str
    description: str
    blocks: tuple[Block, ...]
    parts: tuple[Part, ...]
    groups: tuple[Group, ...]
    sums: Sums
    initial_groups: tuple[Group, ...] = ()
    bindings: tuple[Assignments, ...] = ()  # constants, parameters; default signals of inputs
    starts: tuple[Assignments, ...] = ()
    fixed: tuple[Assignments, ...] = ()
    nominals: tuple[Assignments, ...] = ()
    checks: tuple[Check, ...] = ()
    decisions: tuple[Decision, ...] = ()
    laws: tuple[Laws, ...] = ()  # each leaves a force open that a mode closes (`lmoc.ir.mode`)
    events: Events | None = None  # None: nothing happens at instants
    closed: np.ndarray | None = None  # (laws,) which laws are closed; None: the groups say nothing about the laws
    experiment: Experiment = Experiment()
    overrides: Mapping[str, float] = field(default_factory=dict)  # values the caller gave before flattening
    notes: tuple[Diagnostic, ...] = ()  # warnings and notes of the stages so far
    simplified: Simplified | None = None  # None: there is no homotopy in it

    # ------------------------------------------------------------ counts and kinds

    @cached_property
    def count(self) -> int:
        return self.blocks[-1].offset + self.blocks[-1].size if self.blocks else 0

    @cached_property
    def kind(self) -> np.ndarray:
        return self.per_variable(lambda b: b.kind, np.uint8)

    @cached_property
    def start_rank(self) -> np.ndarray:
        """(count,) the rank of the start value of each variable; 0 where there is none."""
        rank = np.zeros(self.count, np.int64)
        for a in self.starts:
            rank[a.target] = a.rank
        return rank

    @cached_property
    def is_fixed(self) -> np.ndarray:
        """(count,) mask of variables whose start values hold exactly, as far as no parameter decides."""
        fixed, unknown = np.zeros(self.count, bool), np.full(self.count, np.nan)
        for a in self.fixed:
            fixed[a.target] = a.values(unknown) == 1
        return fixed

    @cached_property
    def read_beside(self) -> np.ndarray:
        """The parameters that starts, events and assertions along a run read, and those that are outputs."""
        checks = [c for c in self.checks if c not in self.constant_checks]
        tables = [*(a.slots.ravel() for a in (*self.starts, *self.fixed)), *(c.slots.ravel() for c in checks)]
        outputs = self.per_variable(lambda b: b.output, bool)
        tables += [np.flatnonzero(outputs), *(() if self.events is None else (self.events.read, self.events.clocks()))]
        found: np.ndarray = np.unique(np.concatenate(tables)).astype(int)
        own: np.ndarray = found[self.kind[found] == Kind.PARAMETER]
        return own

    @cached_property
    def input_bindings(self) -> tuple[Assignments, ...]:
        """The default signals of inputs."""
        return tuple(a for a in self.bindings if self.kind[a.target[0]] == Kind.INPUT)

    def per_variable(self, value: Callable[[Block], object], dtype: type) -> np.ndarray:
        """An array over all variables with ``value(block)`` repeated over each block."""
        return np.repeat(np.array([value(b) for b in self.blocks], dtype), [b.size for b in self.blocks])

    @property
    def equation_count(self) -> int:
        return sum(g.rows for g in self.groups) + self.sums.rows

    @cached_property
    def block_of(self) -> np.ndarray:
        """Index of the block of each variable."""
        return np.repeat(np.arange(len(self.blocks)), [b.size for b in self.blocks])

    # ------------------------------------------------------------------------ names

    @cached_property
    def _offsets(self) -> list[int]:
        return [b.offset for b in self.blocks]

    def block_at(self, variable: int) -> Block:
        """The block of a variable; blocks of size 0 are never returned."""
        return self.blocks[bisect_right(self._offsets, variable) - 1]

    def declared_at(self, variable: int) -> Span | None:
        """Return the declaration of the part that owns a variable; for one of the model itself, its own declaration."""
        block = self.block_at(variable)
        return self.parts[block.part].span or block.span

    def variable_name(self, variable: int) -> str:
        block = self.block_at(variable)
        return block.name(variable - block.offset)

    def jet_name(self, variable: int, order: int) -> str:
        name = self.variable_name(variable)
        for _ in range(order):
            name = f"der({name})"
        return name

    @cached_property
    def _by_path(self) -> dict[tuple[str, ...], Block]:
        return {tuple(n for n, _ in b.path): b for b in self.blocks}

    def find(self, name: str) -> np.ndarray | None:
        """Indices of the variables a dotted name means (one, or a whole array), None where there is no such name.

        ``m[3].q`` is one variable; ``m.q`` and ``m[:].q`` are all of them; ``m[2:4].q`` a range. Those of single
        variables are kept.
        """
        found = self._found.get(name) if isinstance(name, str) else None
        if found is None:
            found = self._find(name)
            if found is not None and len(found) == 1:
                found.setflags(write=False)
                self._found[name] = found
        return found

    @cached_property
    def _found(self) -> dict[str, np.ndarray]:
        return {}

    def _find(self, name: str) -> np.ndarray | None:
        parsed = parse_name(name)
        block = None if parsed is None else self._by_path.get(tuple(n for n, _ in parsed))
        if parsed is None or block is None:
            return None
        positions = np.arange(block.size).reshape(block.dims)
        key: list[int | slice] = []
        for (_, given), (_, dims) in zip(parsed, block.path, strict=False):
            if given and len(given) != len(dims):
                return None
            for item, n in zip(given or ((1, None),) * len(dims), dims, strict=False):
                low, high = item if isinstance(item, tuple) else (item, item)
                high = n if high is None else high
                if not (1 <= low and high <= n):
                    return None
                key.append(slice(low - 1, high) if isinstance(item, tuple) else item - 1)
        return block.offset + np.atleast_1d(positions[tuple(key)]).ravel()

    def names(self) -> Iterable[str]:
        """All dotted names, in the order of the table."""
        for block in self.blocks:
            for i in range(block.size):
                yield block.name(i)

    # --------------------------------------------------------------------- values

    def message_of(self, check: Check, row: int) -> str:
        """Return the message of an assertion, with the part in which it does not hold."""
        if check.part == 0:
            return check.message
        return f"{self.parts[check.part].element(row, len(check.slots))}: {check.message}"

    @cached_property
    def coefficients(self) -> np.ndarray:
        """Parameters of springs and dampers that are a stiffness or a damping."""
        found = [
            np.arange(b.offset, b.offset + b.size)
            for b in self.blocks
            if b.kind == Kind.PARAMETER
            and b.unit in _COEFFICIENTS
            and self.parts[b.part].look.symbol in _ELASTIC
            and len(b.path) == len(self.parts[b.part].path) + 1
        ]
        return np.concatenate(found) if found else np.zeros(0, int)

    @cached_property
    def constant_checks(self) -> frozenset[Check]:
        """Assertions about parameters alone: they hold or not before anything moves."""
        fixed = (c for c in self.checks if not (self.kind[c.slots] > Kind.PARAMETER).any())
        return frozenset(c for c in fixed if not depends_on_time(c.condition))

    @cached_property
    def _parameter_bindings(self) -> tuple[np.ndarray, tuple[Assignments, ...]]:
        """Values of what is bound to numbers, NaN elsewhere; and the bindings that depend on others, in order."""
        values, dependent = np.full(self.count, np.nan), []
        for a in self.bindings:
            if len(a.target) and self.kind[a.target[0]] <= Kind.PARAMETER:
                if not a.slots.shape[1]:
                    values[a.target] = a.values(values) if a.numbers is None else a.numbers
                else:
                    dependent.append(a)
        return values, tuple(dependent)

    def parameter_values(self, overrides: Mapping[int, float] | None = None) -> np.ndarray:
        """Values of constants and parameters, NaN elsewhere and where none is given.

        Parameters
        ----------
        overrides : {variable index: value}
            Replace the bindings of these parameters; what is bound to them follows.
        """
        literal, dependent = self._parameter_bindings
        values = literal.copy()
        overrides = overrides or {}
        given = np.fromiter(overrides.keys(), int, len(overrides))
        numbers = np.fromiter(overrides.values(), float, len(overrides))
        return self._bound(values, dependent, given, numbers)

    def parameter_values_of_runs(self, given: np.ndarray, numbers: np.ndarray) -> np.ndarray:
        """Return the values (variables, runs) of many runs, as `parameter_values` of each.

        Parameters
        ----------
        given : (k,) variables in place of whose bindings there are values
        numbers : (k, runs)
        """
        literal, dependent = self._parameter_bindings
        return self._bound(np.repeat(literal[:, None], numbers.shape[1], axis=1), dependent, given, numbers)

    @staticmethod
    def _bound(
        values: np.ndarray, dependent: Sequence[Assignments], given: np.ndarray, numbers: np.ndarray
    ) -> np.ndarray:
        values[given] = numbers
        for a in dependent:
            values[a.target] = a.values(values)
            values[given] = numbers
        return values

    def keeps_shape(self, values: np.ndarray) -> np.ndarray:
        """Return whether the flat model would be the same with other values of what is structural by conditions alone.

        For values (variables,), or for each of many runs (variables, runs).
        """
        kept = np.ones(values.shape[1:], bool)
        for decision in self.decisions:
            kept &= decision.same(values)
        return kept

    def extended(self, values: np.ndarray) -> np.ndarray:
        """Return parameter values (count,) of the model that this one adds variables to: those have none (NaN)."""
        return np.concatenate([values, np.full(self.count - len(values), np.nan)])

    def row_text(self, group: Group, row: int) -> str:
        """One equation in the user's names."""
        names = group.slots[row]

        def name(column: int, order: int) -> str:
            return self.jet_name(int(names[column]), order)

        return f"{to_text(group.left, name)} = {to_text(group.right, name)}"

    def sum_text(self, row: int) -> str:
        """One balance of flows in the user's names."""
        s = self.sums
        terms: list[str] = []
        for j in range(s.start[row], s.start[row + 1]):
            name = self.variable_name(int(s.index[j]))
            lead = " - " if s.sign[j] < 0 else " + "
            terms.append(lead + name if terms else ("-" if s.sign[j] < 0 else "") + name)
        return "".join(terms) + " = 0"
