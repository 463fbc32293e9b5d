"""Put the pieces of a reduced system together."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from math import prod

import numpy as np

from lmoc.expression.dag import slots
from lmoc.ir.flat import FlatDAE
from lmoc.ir.program import Apply, Program, Registers, Role, Solve, Step, read
from lmoc.ir.reduced import Constraints, Guard, Invariants, Reduced, StartGuess
from lmoc.messages.diagnostics import Diagnostic
from lmoc.structure.index.system import EquationSystem
from lmoc.structure.linear.coefficients import INPUT, UNKNOWN
from lmoc.structure.linear.substitution import partition
from lmoc.structure.registers.layout import RegisterLayout, inverse_affine, names_of_jets, pattern_of, way_back
from lmoc.support.distinct import first_of_each
from lmoc.support.indices import INDEX
from lmoc.support.records import dataclass


@dataclass(frozen=True, eq=False)
class Solved:
    """The equations of a system solved, before names and the way back are attached.

    Attributes
    ----------
    rhs, rest : the programs, over the layout's registers and `helpers` more
    states, quadratures : registers of jets
    guards, notes, guess, guess_at, constraints, invariants : as in `Reduced`
    """

    system: EquationSystem
    layout: RegisterLayout
    rhs: Program
    rest: Program
    states: np.ndarray
    quadratures: np.ndarray
    helpers: int
    guards: tuple[Guard, ...]
    notes: tuple[Diagnostic, ...]
    guess: StartGuess | None
    guess_at: Callable[[np.ndarray, tuple[np.ndarray, np.ndarray]], StartGuess] | None
    constraints: Callable[[int], Constraints | None] | None  # from the number of registers, as `invariants`
    invariants: Callable[[int], Invariants] | None


def assemble(solved: Solved) -> Reduced:
    """Return the reduced system."""
    system, layout, helpers = solved.system, solved.layout, solved.helpers
    states, quadratures = solved.states, solved.quadratures
    n, flat = system.normalized, system.flat
    rhs, observe = solved.rhs, solved.rest
    register_of, back, named = way_back(system, layout, helpers)
    count = layout.count + helpers + len(named)
    rhs, observe, guesses = _with_guesses(system, layout, rhs, observe, count)
    count += sum(len(g.out) for g in guesses)
    register_of[n.undetermined] = -1
    inputs = layout.inputs()
    known = np.flatnonzero(flat.kind < INPUT)
    return Reduced(
        flat=flat,
        values=n.values,
        registers=_registers(system, layout, states, quadratures, helpers, named, count),
        known=np.stack([layout.base[known], known]),
        inputs=inputs,
        required_inputs=_mask(count, map(read, rhs))[inputs[0]],
        parameter_program=(*(Apply(a.shape, layout.base[a.slots], layout.base[a.target]) for a in n.derived), *guesses),
        states=states,
        derivatives=states + 1,
        quadratures=quadratures,
        quadrature_derivatives=quadratures + 1,
        rhs=rhs,
        observe=(*observe, *back),
        register_of=register_of,
        guards=solved.guards,
        notes=solved.notes,
        guess=solved.guess,
        guess_at=solved.guess_at,
        constraints=None if solved.constraints is None else solved.constraints(count),
        invariants=None if solved.invariants is None else solved.invariants(count),
        counts={
            "parts": _part_count(flat),
            "equations": flat.equation_count,
            "after elimination": system.rows,
            "states": len(states),
        },
        undetermined=n.undetermined,
    )


def _part_count(flat: FlatDAE) -> int:
    """Elements of the scene, those of arrays counted one by one."""
    return sum(prod(k for _, dims in p.path for k in dims) for p in flat.parts if p.leaf)


def _mask(count: int, some: Iterable[np.ndarray]) -> np.ndarray:
    mask = np.zeros(count, bool)
    for registers in some:
        mask[registers] = True
    return mask


def _registers(
    system: EquationSystem,
    layout: RegisterLayout,
    states: np.ndarray,
    quadratures: np.ndarray,
    helpers: int,
    named: np.ndarray,
    count: int,
) -> Registers:
    role = np.full(count, int(Role.COMPUTED), np.uint8)
    variable, order = layout.jets
    kind = system.kind[variable]
    role[: layout.count][kind == INPUT] = Role.INPUT
    role[: layout.count][(kind != INPUT) & (kind != UNKNOWN)] = Role.KNOWN
    role[: layout.count][variable >= system.flat.count] = Role.DERIVED
    role[states], role[quadratures] = Role.STATE, Role.QUADRATURE
    names = np.full(count, -1, INDEX)
    orders = np.zeros(count, INDEX)
    names[: layout.count], orders[: layout.count] = names_of_jets(system, layout)
    at = layout.count + helpers
    names[at : at + len(named)] = named
    role[at + len(named) :] = Role.DERIVED
    return Registers(role, names, orders)


# --------------------------------------------------------------- start values of nonlinear blocks


def _with_guesses(
    system: EquationSystem, layout: RegisterLayout, rhs: Program, observe: Program, first: int
) -> tuple[Program, Program, list[Apply]]:
    """Give Newton's iterations the start values that the model has; steps that compute those from parameters."""
    unknown = [s.unknowns for s in (*rhs, *observe) if isinstance(s, Solve) and not s.linear]
    if not unknown:
        return rhs, observe, []
    wanted = _mask(layout.count, unknown)
    start, steps = _starts(system, layout, wanted, first)

    def with_guess(step: Step) -> Step:
        if not isinstance(step, Solve) or step.linear:
            return step
        return replace(step, guess=start[step.unknowns])

    return tuple(map(with_guess, rhs)), tuple(map(with_guess, observe)), steps


def _starts(
    system: EquationSystem, layout: RegisterLayout, wanted: np.ndarray, first: int
) -> tuple[np.ndarray, list[Apply]]:
    n = system.normalized
    register = np.full(layout.count, -1, INDEX)
    steps: list[Apply] = []
    for a in system.flat.starts:
        hit = np.flatnonzero(system.column[n.root[a.target]] >= 0)
        jet = layout.register_behind(a.target[hit])
        hit, jet = hit[wanted[jet]], jet[wanted[jet]]
        jet, once = first_of_each(jet)
        hit = hit[once]
        if not len(hit):
            continue
        target = a.target[hit]
        for (factor, offset), rows in partition(pattern_of(n, target)):
            rows = np.arange(len(hit)) if rows is None else rows
            columns = [layout.base[a.slots[hit[rows]]]]
            if factor == 0:
                columns.append(layout.base[n.factor[target[rows]]][:, None])
            if offset == 0:
                columns.append(layout.base[n.offset[target[rows]]][:, None])
            shape = inverse_affine(factor, offset, a.shape, a.slots.shape[1])
            table = np.concatenate(columns, axis=1)
            out = first + np.arange(len(rows))
            first += len(rows)
            register[jet[rows]] = out
            steps.append(Apply(shape, table[:, : 1 + max((s.value[0] for s in slots(shape)), default=-1)], out))
    return register, steps
