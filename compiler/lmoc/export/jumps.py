"""What an FMU needs to know of values that step while the equations hold derivatives of them, such as a prescribed
position: which they are, and the rates where they are given."""

from __future__ import annotations

import numpy as np

from lmoc.ir.program import Solve, unfilled, walk
from lmoc.lower.blocks import values_tape
from lmoc.lower.tape import Tape
from lmoc.numerics.events.impulse import law_registers
from lmoc.numerics.events.steps import Steps, moving_relations
from lmoc.numerics.plan.plan import Plan
from lmoc.support.records import dataclass


@dataclass(frozen=True, eq=False)
class JumpTables:
    """The steps of a scene as an FMU holds them.

    Attributes
    ----------
    rates : Tape
        Of the states, and of what shows whether the motion needs more, from `kept` on (`impulse.GivenProgram`).
    registers : those that may step; the first ones that can be given
    tables : lower, upper, origin, second, as of `engine/c/jump.h`
    which, given, results : registers of `rates`
    kept : (2, k) registers of the derivatives, and of `rates`, which begins with their values
    early : relations that are at the start what they were right before
    names : of `registers`
    """

    rates: Tape
    registers: np.ndarray
    tables: tuple[np.ndarray, ...]
    which: np.ndarray
    given: np.ndarray
    results: np.ndarray
    kept: np.ndarray
    early: np.ndarray
    names: tuple[str, ...]


def jump_tables(plan: Plan) -> JumpTables | None:
    """Return the steps of a plan; None where nothing steps."""
    steps = plan.once(Steps)
    if not steps:
        return None
    own = steps.program
    first = unfilled(own.steps, own.results, plan.count)
    first = first[~np.isin(first, np.concatenate([law_registers(plan), plan.states]))]
    blocks = [s.unknowns.ravel() for s in walk(own.steps) if isinstance(s, Solve) and not s.linear]
    unknowns = np.concatenate([np.zeros(0, int), *blocks])
    solved = np.arange(own.count)
    solved[own.own] = steps.given
    early = np.zeros(0, int) if plan.reduced.flat.events is None else moving_relations(plan)
    return JumpTables(
        values_tape(own.steps, own.count), steps.registers, steps.tables, own.which, own.given, own.results,
        np.stack([np.concatenate([first, solved[unknowns]]), np.concatenate([first, unknowns])]),
        early, tuple(plan.reduced.register_name(int(r)) for r in steps.registers),
    )  # fmt: skip
