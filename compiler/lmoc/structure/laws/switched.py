"""The switched form of a flat model: the mode of each law is a value, not a structure.

A law leaves its force open. Here it gets the equation

    closed·y + (1 − closed)·(force + direction·limit − push) = 0,

where y is the lowest derivative of its motion that the force acts on at once: the gap itself, its rate, or its
acceleration (the relative degree of the pair). `closed`, `push` and `direction` are inputs that stay as they are
between events. Friction with springs alone around it has no such derivative: its velocity feels the rate of the force.
There the force itself is a state, and the equation one between rates,

    closed·velocity + (1 − closed)·(d/dt(force + direction·limit) − push) = 0,

which keeps a slipping force at its limit as sticking friction keeps its place. So all modes of a scene, 2ⁿ of them,
share one reduction, one set of kernels and one way back to every variable; the free scene with all laws open decides
about coordinates, and a closed law is a row of an implicit linear block. The states keep what a closed law adds,
gap = 0 and rate = 0, as invariants (`engine/c/project.c`).

Reducing every mode by itself (`lmoc.ir.mode`) would give fewer states, and is how the equations of a mode are
printed. For a train of 50 wagons that meets 49 modes it costs 49 reductions and kernels; measured at 25 to 140 ms
each, that is seconds where this form needs nothing (`numerics.laws.delassus_update`: 0.1 ms a mode).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from lmoc.expression.dag import ONE, ZERO, Expr, mul, slot, slots
from lmoc.ir.flat import Assignments, Block, FlatDAE, Group, Kind, StateSelect
from lmoc.ir.law import JENKINS, NONE, LawKind, Laws, Switched, law_count

ORIGIN = "law"
POSITION = 2  # relative degree of a gap between inertias: its second derivative feels the force

_VELOCITY = 1
_HELD = ("closed", "push", "direction")  # the inputs that stay as they are between events
_Columns = dict[str, np.ndarray]


def switched(flat: FlatDAE, degree: np.ndarray) -> tuple[FlatDAE, Switched]:
    """Return the switched form for given relative degrees, (laws,), each 0, 1, 2 or JENKINS; and where its laws are."""
    return _form(flat, degree, _switched_laws)


def free(flat: FlatDAE) -> tuple[FlatDAE, Switched]:
    """Return the form in which all laws are open and their forces are given from outside."""
    return _form(flat, np.full(law_count(flat.laws), POSITION), _free_laws)


def _form(
    flat: FlatDAE, degree: np.ndarray, equations: Callable[[_Added, Laws, _Columns, np.ndarray, np.ndarray], None]
) -> tuple[FlatDAE, Switched]:
    added = _Added(flat)
    tables, levels, first = [], [], 0
    for laws in flat.laws:
        own = degree[first : first + laws.rows]
        first += laws.rows
        columns = _columns(added, laws, own)
        motions = np.stack([columns["gap"], columns["rate"], columns.pop("acceleration")])
        level = motions[np.where(own == JENKINS, _VELOCITY, own), np.arange(laws.rows)]
        equations(added, laws, columns, level, own == JENKINS)
        tables.append(columns)
        levels.append(level)
    table = {name: np.concatenate([c[name] for c in tables]) for name in tables[0]} if tables else {}
    done = replace(
        flat,
        blocks=tuple(added.blocks),
        groups=(*flat.groups, *added.groups),
        bindings=(*flat.bindings, *(_zero(table[n]) for n in _HELD if (table[n] != NONE).any())),
        laws=(),
    )
    return done, Switched(flat.laws, level=np.concatenate(levels), degree=degree, **table)


def _zero(variables: np.ndarray) -> Assignments:
    """Return the binding of inputs to zero: open laws without a push."""
    own = variables[variables != NONE]
    return Assignments(own, ZERO, np.zeros((len(own), 0), int))


class _Added:
    """Variables and equations that a flat model gets."""

    def __init__(self, flat: FlatDAE) -> None:
        directions = [laws.direction for laws in flat.laws if laws.direction is not None]
        held = set(np.concatenate(directions).tolist()) if directions else set()
        own = {int(v) for laws in flat.laws for v in (*laws.motion, *laws.force)} - _differentiated(flat)
        self.blocks = [_held(b) if b.offset in held else _avoided(b) if b.offset in own else b for b in flat.blocks]
        self.groups: list[Group] = []
        self.count = flat.count

    def variables(
        self, name: str, laws: Laws, rows: int, kind: Kind, select: StateSelect = StateSelect.default
    ) -> np.ndarray:
        path = ((f"{name} of law {len(self.blocks)}", (rows,)),)
        block = Block(path, self.count, rows, kind, part=laws.part, span=laws.span, state_select=select)
        self.blocks.append(block)
        self.count += rows
        return np.arange(self.count - rows, self.count)

    def derivative(self, name: str, laws: Laws, of: np.ndarray, wanted: np.ndarray) -> np.ndarray:
        """Return the derivatives of some of the variables `of`, NONE for the others."""
        made = np.full(laws.rows, NONE)
        if wanted.any():
            made[wanted] = self.variables(name, laws, int(wanted.sum()), Kind.UNKNOWN, StateSelect.avoid)
            pair = np.stack([made[wanted], of[wanted]], axis=1)
            self.groups.append(Group(slot(0), slot(1, 1), pair, laws.span, laws.part, ORIGIN))
        return made


def _held(block: Block) -> Block:
    """Return a discrete variable as an input."""
    return replace(block, kind=Kind.INPUT)


def _differentiated(flat: FlatDAE) -> set[int]:
    """Return the variables whose derivatives appear in the equations: coordinates of parts."""
    found: set[int] = set()
    for group in flat.groups:
        leaves = (leaf.value for side in (group.left, group.right) for leaf in slots(side))
        for column in {column for column, order in leaves if order}:
            found.update(group.slots[:, column].tolist())
    return found


def _avoided(block: Block) -> Block:
    """Return a motion or force of a law that is a state only where no coordinate of a part can be one."""
    plain = block.state_select == StateSelect.default
    return replace(block, state_select=StateSelect.avoid) if plain else block


def _columns(added: _Added, laws: Laws, degree: np.ndarray) -> _Columns:
    nothing = np.full(laws.rows, NONE)
    unilateral = laws.kind is LawKind.UNILATERAL
    rate = added.derivative("rate", laws, laws.motion, degree >= 1) if unilateral else laws.motion
    return {
        "force": laws.force,
        "gap": laws.motion if unilateral else nothing,
        "rate": rate,
        "acceleration": added.derivative("acceleration", laws, rate, degree >= POSITION),
        "closed": added.variables("closed", laws, laws.rows, Kind.INPUT),
        "push": added.variables("push", laws, laws.rows, Kind.INPUT),
        "direction": nothing if laws.direction is None else laws.direction,
    }


def _free_laws(added: _Added, laws: Laws, own: _Columns, level: np.ndarray, jenkins: np.ndarray) -> None:
    """Add ``force = push``."""
    table = np.stack([own["force"], own["push"]], axis=1)
    added.groups.append(Group(slot(0), slot(1), table, laws.span, laws.part, ORIGIN))


def _switched_laws(added: _Added, laws: Laws, own: _Columns, level: np.ndarray, jenkins: np.ndarray) -> None:
    """Add ``closed·y + (1 − closed)·(force + direction·limit − push) = 0``, its rate where `jenkins`."""
    columns = [own["closed"], level, own["push"], laws.force]
    excess: Expr = slot(3)
    if laws.kind is LawKind.DRY_FRICTION:
        columns += [own["direction"], laws.column("slip")]
        excess = excess + mul(slot(4), slot(5))
    elif laws.kind is LawKind.CONTACT_FRICTION:
        columns += [own["direction"], laws.column("friction"), laws.column("normal")]
        excess = excess + mul(slot(4), mul(slot(5), slot(6)))
    table = np.stack(columns, axis=1)
    plain, rated = table[~jenkins], table[jenkins]
    if len(plain):
        added.groups.append(Group(_either(excess), ZERO, plain, laws.span, laws.part, ORIGIN))
    if len(rated):
        sums = added.variables("excess", laws, len(rated), Kind.UNKNOWN, StateSelect.avoid)
        parts = np.column_stack([rated, sums])
        last = table.shape[1]
        added.groups.append(Group(slot(last), excess, parts, laws.span, laws.part, ORIGIN))
        added.groups.append(Group(_either(slot(last, 1)), ZERO, parts, laws.span, laws.part, ORIGIN))


def _either(opened: Expr) -> Expr:
    """Return ``closed·y + (1 − closed)·(opened − push)``."""
    return slot(0) * slot(1) + (ONE - slot(0)) * (opened - slot(2))
