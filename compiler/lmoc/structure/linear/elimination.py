"""Linear elimination at position level: aliases, gear ratios, offsets and derivatives go out, in passes.

A pass takes all rows that tie one unknown to one other thing by parameter coefficients, makes a spanning forest of
them, and puts the roots everywhere. What was a sum of three may then tie two: passes repeat until nothing is left.
Cf. alias elimination in Otter & Elmqvist, "Transformation of Differential Algebraic Array Equations to Index One
Form", Modelica 2017; here with factors and offsets, and vectorized over the rows of each shape.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import cached_property

import numpy as np

from lmoc.expression.dag import ONE, ZERO, Expr, slots
from lmoc.ir.flat import Block, FlatDAE, StateSelect
from lmoc.ir.reduced import Guard
from lmoc.structure.linear.affine import ZERO_ROOT, Affine, codes, composed, resolve
from lmoc.structure.linear.affine_forest import UNUSED, orient
from lmoc.structure.linear.coefficients import KNOWN, UNKNOWN, Form, Role, form_of, kinds_of, leaves_of, linear_form
from lmoc.structure.linear.derived import NONE, DerivedParameters
from lmoc.structure.linear.steep import largest, ratios
from lmoc.structure.linear.substitution import Rows, equal_columns_merged, merged, substituted
from lmoc.structure.linear.sum_rows import SumRows, as_groups, view
from lmoc.structure.linear.vanishing import Splitter
from lmoc.structure.messages.equations import Equations, Loops
from lmoc.support.distinct import first_of_each
from lmoc.support.indices import INDEX, counted


class Elimination:
    """The equations and the table of eliminated variables while passes go on.

    Attributes
    ----------
    table : Affine
        What stands for each flat variable by now.
    groups, sums : the equations that remain, groups over roots, sums over flat variables
    closed : groups in which no unknown is left
    overdetermined : groups that leave a whole class of coordinates no freedom
    """

    def __init__(self, flat: FlatDAE, values: np.ndarray, asked: np.ndarray):
        self.flat = flat
        self.zero = flat.count
        self.table = Affine.identity(flat.count)
        self._step = Affine.identity(flat.count)
        self.derived = DerivedParameters(values)
        self.splitter = Splitter(flat, self.derived)
        self.loops = Loops(Equations(flat), flat.count)
        self.kind = np.append(kinds_of(flat), KNOWN).astype(np.int8)
        self.closed: list[Rows] = []
        self.overdetermined: list[Rows] = []
        self.empty_sums: list[int] = []
        self.groups = self._first_groups()
        self.sums = self._first_sums()
        self.differentiated = self._differentiated()
        self._score = self._scores(asked)

    # ---------------------------------------------------------------- beginning

    def _first_groups(self) -> list[Rows]:
        groups, number = [], 0
        for g in self.flat.groups:
            if g.rows:
                source = counted(number, number + g.rows)
                kinds = tuple(self.kind[g.slots[0]].tolist())
                rows = Rows(g.residual, kinds, g.slots.astype(INDEX, copy=False), source)
                groups.append(rows.with_shape(g.residual))
                number += g.rows
        twins = [part for g in merged(groups) for part in equal_columns_merged(g)]
        return self._without_closed(part for g in twins for part in self.splitter.by_factors(g))

    def _first_sums(self) -> SumRows:
        sums = self.flat.sums
        first = self.loops.equations.first_sum
        row = np.repeat(counted(0, sums.rows), np.diff(sums.start))
        return SumRows(row, sums.index.astype(INDEX, copy=False), sums.sign, counted(first, first + sums.rows))

    def _differentiated(self) -> np.ndarray:
        """The variables that are differentiated somewhere."""
        mask = np.zeros(self.flat.count + 1, bool)
        for g in self.groups:
            for leaf in slots(g.shape):
                if leaf.value[1] > 0:
                    mask[g.column(leaf)] = True
        return mask

    def _scores(self, asked: np.ndarray) -> np.ndarray:
        """The lower, the better a root.

        Asked for, preferred, differentiated, a length or an angle, not of a connector; avoided ones last.
        """
        flat = self.flat
        rank = {StateSelect.always: 1, StateSelect.prefer: 1, StateSelect.default: 2}

        def score_of(b: Block) -> int:
            return PREFERRED // 2 * rank.get(b.state_select, 3) + 2 * (not _is_position(b)) + b.connector

        score = flat.per_variable(score_of, INDEX)
        score[~self.differentiated[:-1]] += 4
        score[asked] = np.arange(-len(asked), 0)
        return np.append(score, 0)

    @cached_property
    def _measure(self) -> np.ndarray:
        """Return the units of variables as numbers: 0 for positions, one for each other unit, -1 where unknown."""
        units: dict[str, int] = {}

        def measure(b: Block) -> int:
            return 0 if _is_position(b) else units.setdefault(b.unit, len(units) + 1) if b.unit else -1

        return np.append(self.flat.per_variable(measure, INDEX), 0)

    def marked(self, mark: Callable[[Block], bool]) -> np.ndarray:
        """The roots that stand for variables of marked blocks; a mask over flat variables and the constant 0."""
        mask = np.zeros(self.flat.count + 1, bool)
        blocks = self.flat.per_variable(mark, bool)
        mask[self.table.root[:-1][blocks & (self.table.order[:-1] == 0)]] = True
        mask[self.zero] = False
        return mask

    @property
    def coordinates(self) -> np.ndarray:
        """The roots that stand for positions of connectors or are differentiated."""
        result: np.ndarray = self.marked(lambda b: b.connector and not b.flow) | self.differentiated
        return result

    # ------------------------------------------------------------------- passes

    def run(self) -> None:
        """Eliminate until nothing changes.

        Derivatives come first: with ``v = der(q), a = der(v), m*a = -k*q`` this leaves the coordinate q, whereas the
        alias of a and q would lead to ``q = -m/k*der(v)``.
        """
        while self._derivative_pass() | self._alias_pass():
            pass

    def _alias_pass(self) -> bool:
        """Eliminate along all rows ``a·x + b·y + c = 0``; whether there were any."""
        self._refresh_sums()
        batches: list[tuple[Rows, Form]] = []
        others: list[tuple[Rows, Form]] = []
        for g in self.groups:
            form = form_of(g.shape, g.kinds)
            (batches if form.role == Role.ALIAS else others).append((g, form))
        plain = self.sum_view.plain
        short = np.flatnonzero((plain.lengths == 1) | (plain.lengths == 2)) if len(plain.source) else np.zeros(0, int)
        if not batches and not len(short):
            return False
        pieces = [(g, form, self._end(g, form, 0), self._end(g, form, 1)) for g, form in batches]
        if len(short):
            pieces += self._sum_pieces(short)
        first = np.concatenate([p[2] for p in pieces])
        second = np.concatenate([p[3] for p in pieces])
        known = self.kind != UNKNOWN
        ratio = np.concatenate([self._ratios(g, form) for g, form, *_ in pieces])
        direction = orient(first, second, known, largest(first, second, ratio, known, self._score))
        left, linked, at = [g for g, _ in others], [], 0
        for g, form, a, b in pieces:
            way = direction[at : at + len(a)]
            at += len(a)
            linked += self._link(g, form, (a, b), way)
            if (way == UNUSED).any():
                left.append(g.take(np.flatnonzero(way == UNUSED)))
        self.groups = left
        self._apply(np.concatenate(linked))
        return True

    def _ratios(self, g: Rows, form: Form) -> np.ndarray:
        """The magnitudes of the first variable over the second in rows of two; 1 elsewhere.

        Of what has one unit: that a force is a billion times the length that it follows from is a matter of units.
        """
        factor = form.link(0)[1]
        ratio = np.ones(len(g.source))
        if len(form.leaves) < 2 or factor is ONE or not slots(factor):
            return ratio
        first, second = (self._measure[self._end(g, form, leaf)] for leaf in (0, 1))
        alike = np.flatnonzero((first == second) & (first >= 0))
        if not len(alike):
            return ratio
        ratio[alike], same = ratios(factor, g.slots[alike], self.derived)
        self.splitter.guards.append(Guard(same, "which of two variables the other one is derived from"))
        return ratio

    def _end(self, g: Rows, form: Form, leaf: int) -> np.ndarray:
        """The variables at one end of the rows, the constant 0 where there is one end only."""
        return g.column(form.leaves[leaf]) if leaf < len(form.leaves) else np.full(len(g.source), self.zero, INDEX)

    def _link(self, g: Rows, form: Form, ends: tuple[np.ndarray, np.ndarray], way: np.ndarray) -> list[np.ndarray]:
        """Enter the rows that are in the forest into the step table; returns the children."""
        linked = []
        for direction in (1, 2):
            rows = np.flatnonzero(way == direction)
            if len(rows):
                child, parent = ends[direction - 1][rows], ends[2 - direction][rows]
                self._enter(g.take(rows), form.link(direction - 1), child, parent, 0)
                linked.append(child)
        return linked

    def _enter(
        self, g: Rows, link: tuple[int, Expr, int, Expr], child: np.ndarray, parent: np.ndarray, order: int
    ) -> None:
        sign, factor, offset_sign, offset = link
        step = self._step
        step.root[child], step.order[child], step.sign[child] = parent, order, sign
        step.factor[child] = NONE if factor is ONE else self.derived.define(factor, g.slots)
        step.offset_sign[child] = offset_sign
        step.offset[child] = NONE if offset is ZERO else self.derived.define(offset, g.slots)
        self.loops.link(child, parent, g.source)

    def _sum_pieces(self, short: np.ndarray) -> list[tuple[Rows, Form, np.ndarray, np.ndarray]]:
        """Balances of one or two flows as rows of equations, taken out of the sums."""
        view_ = self.sum_view
        chosen = np.zeros(len(view_.plain.source), bool)
        chosen[short] = True
        keep = np.ones(len(self.sums.source), bool)
        keep[view_.plain_rest[short]] = False
        self.sums = self.sums.take(keep)
        pieces = []
        for g in as_groups(view_.plain.take(chosen)):
            form = form_of(g.shape, g.kinds)
            pieces.append((g, form, self._end(g, form, 0), self._end(g, form, 1)))
        return pieces

    def _derivative_pass(self) -> bool:
        """Replace v by c·der(x) along all rows that say so; whether there were any.

        A variable is replaced once; further rows for it, and rows that would close a circle, stay equations, and so
        do those of a variable preferred as a state over x. ``f = m·der(v)`` stays where positions tell f as well (it
        is the force of a spring, and follows from these), where f is differentiated itself (``J·der(w) = k·i`` beside
        ``L·der(i) = …``: the current is a state, not the acceleration), and where f shall be a state.
        """
        pieces = [(g, f) for g in self.groups if (f := form_of(g.shape, g.kinds)).role == Role.DERIVATIVE]
        if not pieces:
            return False
        child = np.concatenate([g.column(f.leaves[0]) for g, f in pieces])
        parent = np.concatenate([g.column(f.leaves[1]) for g, f in pieces])
        wanted = self._score < PREFERRED
        definition = np.concatenate([np.full(len(g.source), f.link(0)[1] is ONE) for g, f in pieces])
        needed = self._beside_positions() | self.differentiated | wanted
        free = np.flatnonzero((~wanted[child] | wanted[parent]) & (definition | ~needed[child]))
        taken = np.zeros(len(child), bool)
        taken[free] = first_without_circles(child[free], parent[free], self._score)
        if not taken.any():
            return False
        left, at = [], 0
        chosen = {id(g) for g, _ in pieces}
        for g, form in pieces:
            mine = taken[at : at + len(g.source)]
            at += len(g.source)
            rows = g.take(np.flatnonzero(mine))
            if len(rows.source):
                ends = rows.column(form.leaves[0]), rows.column(form.leaves[1])
                self._enter(rows, form.link(0), *ends, form.leaves[1].value[1])
            if not mine.all():
                left.append(g.take(np.flatnonzero(~mine)))
        self.groups = [g for g in self.groups if id(g) not in chosen] + left
        self._apply(child[taken])
        return True

    def _beside_positions(self) -> np.ndarray:
        """The variables, no coordinates themselves, in linear equations with undifferentiated coordinates; a mask."""
        mask = np.zeros(self.flat.count + 1, bool)
        for g in self.groups:
            if form_of(g.shape, g.kinds).role == Role.NONE and linear_form(g.shape, g.kinds) is not None:
                columns = [g.column(leaf) for leaf in leaves_of(g.shape, g.kinds, UNKNOWN) if leaf.value[1] == 0]
                if len(columns) > 1:
                    table = np.stack(columns, axis=1)
                    position = self.differentiated[table]
                    mask[table[position.any(axis=1)[:, None] & ~position]] = True
        return mask

    # -------------------------------------------------------------- substitution

    def _apply(self, linked: np.ndarray) -> None:
        """Follow the new links to their roots and put these into the table and the groups."""
        step, table = self._step, self.table
        step.put(linked, with_codes(step.take(linked), self.zero))
        resolve(step, linked, self.zero, self.derived)
        rows = np.flatnonzero(step.root[table.root] != table.root)
        table.put(rows, composed(table.take(rows), step.take(table.root[rows]), self.zero, self.derived))
        self.groups = self._without_closed(
            part for g in self.groups for new in substituted(g, step, self.kind) for part in self._opened(g, new, step)
        )
        step.put(linked, Affine(linked, *_OWN.columns()[1:]))

    def _fixed(self, old: Rows, step: Affine) -> bool:
        """Return whether an unknown of the rows has become a constant, which may be a factor of other unknowns."""
        if linear_form(old.shape, old.kinds) is not None:
            return False
        columns = [c for c, kind in enumerate(old.kinds) if kind == UNKNOWN]
        return bool((step.code[old.slots[:, columns]] & ZERO_ROOT).any())

    def _opened(self, old: Rows, new: Rows, step: Affine) -> list[Rows]:
        """The parts of a group after its variables have been replaced, sorted by what has cancelled or is zero."""
        fixed = new is not old and self._fixed(old, step)
        if not fixed and (new is old or not new.looped):
            return [new]
        parts = self.splitter.by_factors(new) if fixed else self.splitter.by_coefficients(new)
        if new.looped == 2 and old.looped != 2:
            for part in parts:
                if form_of(part.shape, part.kinds).role == Role.ALIAS:
                    self.overdetermined.append(part)
        return parts

    def _without_closed(self, groups: Iterable[Rows]) -> list[Rows]:
        rest: list[Rows] = []
        for g in merged(groups):
            (self.closed if form_of(g.shape, g.kinds).role == Role.CLOSED else rest).append(g)
        return rest

    def _refresh_sums(self) -> None:
        """Look at the sums through the table; those that have become equations of another kind move to the groups."""
        self.sum_view = view(self.sums, self.table, self.kind, self.zero)
        self.sums = self.sum_view.rest
        plain = self.sum_view.plain
        empty = plain.lengths == 0
        if empty.any():
            self.empty_sums += plain.source[empty].tolist()
            keep = np.ones(len(self.sums.source), bool)
            keep[self.sum_view.plain_rest[empty]] = False
            self.sums = self.sums.take(keep)
            self.sum_view = view(self.sums, self.table, self.kind, self.zero)
        irregular = self.sum_view.irregular
        if len(irregular.source):
            self.add(as_groups(irregular))

    def add(self, groups: list[Rows]) -> None:
        """Further equations over flat variables."""
        new = [
            part
            for g in groups
            for r in substituted(g, self.table, self.kind)
            for part in self._opened(g, r, self.table)
        ]
        self.groups = self._without_closed([*self.groups, *new])


LENGTHS_AND_ANGLES = frozenset({"m", "rad", "deg", "mm", "cm", "km"})
PREFERRED = 16  # scores of variables preferred as states are below
_OWN = Affine.identity(0)  # the row of a variable that is its own root


def with_codes(rows: Affine, zero: int) -> Affine:
    rows.code = codes(rows, zero)
    return rows


def first_without_circles(child: np.ndarray, parent: np.ndarray, score: np.ndarray) -> np.ndarray:
    """Of the links child → parent, the first of each child, less one in each circle; a mask.

    A circle is opened at the variable with the lowest (score, number), which then stays.
    """
    unique, first = first_of_each(child)
    taken = np.zeros(len(child), bool)
    taken[first] = True
    position = np.searchsorted(unique, parent[first])
    inside = position < len(unique)
    inside[inside] = unique[position[inside]] == parent[first][inside]
    after = np.where(inside, position, len(unique))  # the next link on the way up, len(unique) where it ends
    jump = np.append(after, len(unique))
    for _ in range(len(unique).bit_length() + 1):
        if (jump == len(unique)).all():
            return taken
        jump = jump[jump]
    # what has not ended by now runs in a circle; such rows are rare
    state = np.zeros(len(unique) + 1, np.int8)
    state[-1] = 2
    for start in np.flatnonzero(jump[:-1] != len(unique)).tolist():
        path, node = [], start
        while state[node] == 0:
            state[node] = 1
            path.append(node)
            node = int(after[node])
        if state[node] == 1:
            circle = path[path.index(node) :]
            taken[first[min(circle, key=lambda k: (score[unique[k]], k))]] = False
        state[path] = 2
    return taken


def _is_position(b: Block) -> bool:
    return b.unit in LENGTHS_AND_ANGLES or not b.unit
