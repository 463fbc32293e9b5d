"""The programs of a page's scene as bytes, which the engine reads there (``engine/c/page.c``)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lmoc.engine.instant import TABLES
from lmoc.ir.program import Program, Solve, walk
from lmoc.lower.blocks import derivatives_tape, values_tape
from lmoc.lower.packed import Packer
from lmoc.lower.tape import Tape
from lmoc.numerics.coordinates.limits import LIMITS
from lmoc.numerics.coordinates.passage import gauss_tables
from lmoc.numerics.dop853.dense_output import LAST_WEIGHTS
from lmoc.numerics.dop853.rules import RULES
from lmoc.numerics.evaluate import engine_stepper
from lmoc.numerics.evaluate.engine_system import has_branches
from lmoc.numerics.plan.plan import Plan
from lmoc.numerics.signals.curves import Curve
from lmoc.support.records import dataclass
from lmoc.view.javascript.coordinates import CoordinateTables
from lmoc.view.javascript.jumps import JumpTables
from lmoc.view.javascript.laws import LawTables

Programs = dict[str, Program | list[Program]]
Numbers = dict[str, int | list[int]]
START = "start"  # the program whose unknowns are the states: they may be sought from far away


@dataclass(frozen=True, eq=False)
class InstantTables:
    """What the iteration of events reads.

    Attributes
    ----------
    zeros, seen : registers of the zero functions, and of the variables that `reinit` sets
    single : registers of `initial()`, `terminal()` and of the stored energy where a jump of states changes it; which
        states of the ledger are work and heat; -1 for none
    columns : as of `numerics.events.tables.Tables`
    """

    zeros: np.ndarray
    seen: np.ndarray
    single: tuple[int, int, int, int, int]
    columns: dict[str, np.ndarray]


def packed_programs(
    plan: Plan,
    programs: Programs,
    registers: int,
    curves: Sequence[tuple[int, int, Curve]],
    events: InstantTables | None = None,
    laws: LawTables | None = None,
    jumps: JumpTables | None = None,
    watch: CoordinateTables | None = None,
) -> tuple[bytes, Numbers]:
    """Return the programs over registers, and the number of each by its name; ``rhs`` is among them.

    Parameters
    ----------
    curves : (register, order, curve) of signals: which derivative of a table stands where
    """
    tapes: list[Tape] = []
    patient: list[bool] = []
    patience = not has_branches(plan)

    def write(name: str, program: Program) -> int:
        tapes.append(values_tape(program, registers, tapes[-1].size if tapes else 0))
        patient.append(patience or name == START)
        return len(tapes) - 1

    numbers: Numbers = {
        name: [write(name, one) for one in own] if isinstance(own, list) else write(name, own)
        for name, own in programs.items()
    }
    derived = []
    if laws is not None:
        for rule in (laws.by_force, laws.by_state):
            tapes.append(derivatives_tape(laws.program, rule, registers, True, tapes[-1].size))
            patient.append(patience)
            derived.append(len(tapes) - 1)
    p = Packer()
    p.each((tapes[-1].size, has_branches(plan), numbers["rhs"]))
    for table in (plan.states, plan.derivatives, unknowns_of(plan)):
        p.integers(table)
    p.integer(len(curves))
    for register, order, curve in curves:
        p.each((register, order))
        for values in curve.pieces(order):
            p.reals(values)
    for row in (engine_stepper.weights(), engine_stepper.nodes(), engine_stepper.dense(), LAST_WEIGHTS):
        p.reals(row)
    p.reals(list(vars(RULES).values()))
    p.integer(len(tapes))
    for tape, own in zip(tapes, patient, strict=True):
        p.tape(tape, own)
    p.integer(events is not None)
    if events is not None:
        _pack_events(p, events, numbers)
    p.integer(laws is not None)
    if laws is not None:
        p.each((*derived, _one(numbers, "lawRoots"), *laws.single))
        _pack_laws(p, laws, [tapes[number].results for number in derived])
    p.integer(watch is not None)
    if watch is not None:
        _pack_watch(p, watch, _one(numbers, "constraints"))
    p.integer(jumps is not None)
    if jumps is not None:
        p.each((*(_one(numbers, name) for name in ("jumps", "jumped")), *jumps.single))
        for table in jumps.tables:
            p.integers(table)
    return p.finish(), numbers


def _one(numbers: Numbers, name: str) -> int:
    """Return the number of a program that is one alone."""
    return int(np.asarray(numbers[name]))


def _pack_events(p: Packer, events: InstantTables, numbers: Numbers) -> None:
    """What happens at instants, as `lmoc_page_read_events` reads it."""
    p.each(_one(numbers, name) for name in ("look", "assign", "lines"))
    p.each(events.single)
    for table in (events.zeros, events.seen, *(events.columns[name] for name in TABLES)):
        p.integers(table)


def _pack_laws(p: Packer, laws: LawTables, results: Sequence[np.ndarray]) -> None:
    """The laws, as `lmoc_page_read_laws` reads them behind the numbers of their programs."""
    for table in laws.tables:
        p.integers(table)
    for places, entries in zip(results, laws.entries, strict=True):
        p.integers(places)
        p.integers(entries)


def _pack_watch(p: Packer, watch: CoordinateTables, program: int) -> None:
    """What the choice of coordinates is judged by, as `lmoc_page_read_coordinates` reads it."""
    p.each((program, *watch.own.shape, watch.ranked))
    p.integers(watch.own.watched)
    p.reals(watch.units)
    for table in (watch.entries, watch.own.place, watch.told, watch.solved):
        p.integers(table)
    p.reals(gauss_tables())
    p.reals(list(vars(LIMITS).values()))


def unknowns_of(plan: Plan) -> np.ndarray:
    """Return the registers of the unknowns of nonlinear blocks."""
    found = [s.unknowns.ravel() for s in walk(plan.full_program) if isinstance(s, Solve) and not s.linear]
    return np.unique(np.concatenate([np.zeros(0, int), *found]).astype(int))
