"""Blocks of a few equations: alike ones are solved together, as formulas where they are linear and small."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial

import numpy as np

from lmoc.expression.dag import Expr, postorder, slot, slots, substitute
from lmoc.expression.evaluate import evaluate
from lmoc.ir.program import Apply, Solve, Step
from lmoc.structure.blocks.block_equations import SquareSystem
from lmoc.structure.blocks.tearing import Tearing, tear
from lmoc.structure.linear.coefficients import Kinds, is_constant
from lmoc.structure.linear.explicit import as_formula, jointly_linear, pivot, solution, solve_pair
from lmoc.structure.linear.substitution import partition
from lmoc.support.distinct import distinct
from lmoc.support.records import dataclass

# what is still written as a formula: equations of the block, nodes of the formulas
FORMULA_EQUATIONS, FORMULA_NODES = 24, 400
# a coefficient that many times smaller than another one of its equation is the rounding of a sine of pi, say
NOTHING = 1e-9


@dataclass(frozen=True, eq=False)
class AlikeBlocks:
    """Blocks that differ in their registers only.

    Attributes
    ----------
    equations : (instances, size)
    residuals : one for each equation, over columns of `registers`
    kinds : kind of each column
    internal : columns that the block computes
    registers : (instances, columns)
    level, needed : of all of them
    """

    equations: np.ndarray
    residuals: tuple[Expr, ...]
    kinds: Kinds
    internal: tuple[int, ...]
    registers: np.ndarray
    level: int
    needed: bool

    def apply(self, expr: Expr, out: np.ndarray) -> Apply:
        """A step that puts an expression over the columns into `out`, for all instances."""
        formula, leaves = as_formula(expr)
        return Apply(formula, self.registers[:, [leaf.value[0] for leaf in leaves]], out)


def alike_blocks(system: SquareSystem, members: np.ndarray, needed: np.ndarray) -> Iterator[AlikeBlocks]:
    """Sort blocks of more than one equation into classes.

    Parameters
    ----------
    members : the equations of these blocks, none of them a long sum
    needed : (equations,) mask; blocks are needed as a whole or not at all
    """
    blocks = system.blocks
    batch_of = np.repeat(np.arange(len(system.rows)), [r.count for r in system.rows])
    block = blocks.block[members]
    size = blocks.size[block]
    for n in distinct(size).tolist():
        mine = members[size == n]
        mine = mine[np.lexsort((mine, batch_of[mine], blocks.block[mine]))].reshape(-1, n)
        for batches, rows in partition(batch_of[mine]):
            equations = mine if rows is None else mine[rows]
            yield from _alike(system, equations, batches, needed)


def _alike(
    system: SquareSystem, equations: np.ndarray, batches: tuple[int, ...], needed: np.ndarray
) -> Iterator[AlikeBlocks]:
    parts = [system.rows[b] for b in batches]
    tables = [p.registers[equations[:, i] - p.first] for i, p in enumerate(parts)]
    table = np.concatenate(tables, axis=1)
    twin = first_occurrence(table)
    block = system.blocks.block[equations[:, 0]]
    owner = system.owner[table]
    inside = (owner >= 0) & (system.blocks.block[owner] == block[:, None])
    marks = np.stack([system.blocks.level[block], needed[equations[:, 0]]], axis=1)
    for key, rows in partition(np.concatenate([twin * 2 + inside, marks], axis=1)):
        *columns, level, wanted = key
        place, residuals, kinds = 0, [], []
        for p in parts:
            names = {leaf: slot(columns[place + i] // 2) for i, leaf in enumerate(p.leaves)}
            residuals.append(substitute(p.batch.shape, names))
            kinds += [p.batch.kinds[leaf.value[0]] for leaf in p.leaves]
            place += len(p.leaves)
        yield AlikeBlocks(
            equations if rows is None else equations[rows],
            tuple(residuals),
            tuple(kinds),
            tuple(sorted({c // 2 for c in columns if c % 2})),
            table if rows is None else table[rows],
            level,
            bool(wanted),
        )


def first_occurrence(table: np.ndarray) -> np.ndarray:
    """For each entry the position in its row where the same number first stands."""
    order = np.argsort(table, axis=1, kind="stable")
    ordered = np.take_along_axis(table, order, axis=1)
    position = np.broadcast_to(np.arange(table.shape[1]), table.shape)
    begin = np.zeros(table.shape, np.int64)
    begin[:, 1:] = np.where(ordered[:, 1:] != ordered[:, :-1], position[:, 1:], 0)
    first = np.take_along_axis(order, np.maximum.accumulate(begin, axis=1), axis=1)
    result = np.empty(table.shape, np.int64)
    np.put_along_axis(result, order, first, axis=1)
    return result


@dataclass(frozen=True, eq=False)
class Surroundings:
    """The data that blocks exchange with the rest of the system.

    Attributes
    ----------
    favourite : (registers,) mask of the derivatives of states: torn first
    values : (registers,) numbers of the parameters, generic ones where there are none
    new_registers : gives that many fresh registers
    tests : for each kind of blocks, what is assumed of the parameters and a function of `values`: in which of the
        blocks that fails
    """

    favourite: np.ndarray
    values: np.ndarray
    new_registers: Callable[[int], np.ndarray]
    tests: list[tuple[str, Callable[[np.ndarray], np.ndarray]]]

    def test(self, singular: Callable[[np.ndarray], np.ndarray], equations: np.ndarray) -> None:
        """Put blocks to the test with the present values, and keep the test for others."""
        bad = singular(self.values)
        if bad.any():
            raise SingularBlocks(equations[np.flatnonzero(bad)])
        self.tests.append(("the linear equations between massless parts have one solution", singular))

    def divide(self, vanishing: Callable[[np.ndarray], np.ndarray]) -> None:
        """Keep the test that coefficients which are divided by do not vanish; with the present values they do not."""
        self.tests.append(("what an equation is divided by does not vanish beside its other coefficients", vanishing))


class SingularBlocks(Exception):
    """Linear equations with parameter coefficients whose matrix is singular for the present values."""

    def __init__(self, equations: np.ndarray):
        self.equations = equations


def steps_of(blocks: AlikeBlocks, around: Surroundings) -> list[Step]:
    """Steps that compute everything in these blocks.

    Raises
    ------
    SingularBlocks
    """
    unknowns = [frozenset(v for v in blocks.internal if slot(v) in set(as_formula(r)[1])) for r in blocks.residuals]
    safe = [
        frozenset(v for v in found if not _vanishing(blocks, r, v, found, around.values).any())
        for found, r in zip(unknowns, blocks.residuals, strict=True)
    ]
    favourites = frozenset(v for v in blocks.internal if around.favourite[blocks.registers[0, v]])
    order = tear(unknowns, safe, favourites)
    for e, v in order.steps:
        around.divide(partial(_has_vanished, blocks, blocks.residuals[e], v, unknowns[e]))
    inner = [(v, solution(blocks.residuals[e], slot(v))) for e, v in order.steps]
    leaves = tuple(slot(v) for v in blocks.internal)
    linear = [row for r in blocks.residuals if (row := jointly_linear(r, leaves)) is not None]
    is_linear = len(linear) == len(blocks.residuals)
    constant = is_linear and all(is_constant(c, blocks.kinds) for row in linear for _, c in row)
    if constant:
        around.test(partial(_singular, blocks, linear), blocks.equations)
    if not order.torn:  # what made it a block vanishes in derivatives
        return [blocks.apply(f, blocks.registers[:, v]) for v, f in inner]
    explicit = _formulas(blocks, order, inner, constant, favourites) if is_linear else None
    if explicit is not None:
        torn: list[Step] = [blocks.apply(f, blocks.registers[:, v]) for v, f in zip(order.torn, explicit, strict=True)]
        return [*torn, *(blocks.apply(f, blocks.registers[:, v]) for v, f in inner)]
    residuals = around.new_registers(len(blocks.equations) * len(order.residuals)).reshape(len(blocks.equations), -1)
    steps = [blocks.apply(f, blocks.registers[:, v]) for v, f in inner]
    steps += [blocks.apply(blocks.residuals[e], residuals[:, i]) for i, e in enumerate(order.residuals)]
    return [Solve(tuple(steps), blocks.registers[:, list(order.torn)], residuals, is_linear, constant)]


def _vanishing(
    blocks: AlikeBlocks, residual: Expr, unknown: int, unknowns: frozenset[int], values: np.ndarray
) -> np.ndarray:
    """(instances, or instances, runs) whether a coefficient is no number, or nothing beside those of the others."""
    shape = len(blocks.equations), *values.shape[1:]
    found = [pivot(residual, blocks.kinds, slot(v)) for v in (unknown, *unknowns)]
    if found[0] is None:
        return np.ones(shape, bool)
    sizes = [np.abs(evaluate(c, lambda k, _: values[blocks.registers[:, k]])) for c in found if c is not None]
    size, *others = (np.broadcast_to(s, shape) for s in sizes)
    result: np.ndarray = ~(size > NOTHING * np.max(others, axis=0))
    return result


def _has_vanished(
    blocks: AlikeBlocks, residual: Expr, unknown: int, unknowns: frozenset[int], values: np.ndarray
) -> np.ndarray:
    """Whether a coefficient that was divided by vanishes with other values of the parameters, as of `_vanishing`.

    Parameters without a value may have any.
    """
    found = [pivot(residual, blocks.kinds, slot(v)) for v in (unknown, *unknowns)]
    columns = sorted({leaf.value[0] for c in found if c is not None for leaf in slots(c)})
    missing = np.isnan(values[blocks.registers[:, columns]]).any(axis=1)
    result: np.ndarray = _vanishing(blocks, residual, unknown, unknowns, values) & ~missing
    return result


def _singular(blocks: AlikeBlocks, linear: list[tuple[tuple[Expr, Expr], ...]], values: np.ndarray) -> np.ndarray:
    """Whether the smallest singular value is nothing beside the largest, in rows and columns of one size."""
    place = {slot(v): i for i, v in enumerate(blocks.internal)}
    matrix = np.zeros((len(blocks.equations), *values.shape[1:], len(linear), len(place)))
    for e, row in enumerate(linear):
        for leaf, c in row:
            matrix[..., e, place[leaf]] = evaluate(c, lambda k, _: values[blocks.registers[:, k]])
    known: np.ndarray = np.asarray(np.isfinite(matrix).all(axis=(0, -2, -1)))
    matrix = np.where(known[..., None, None], matrix, 0.0)
    for axis in (-1, -2):
        largest = np.abs(matrix).max(axis=axis, keepdims=True)
        matrix /= np.where(largest > 0, largest, 1)
    found = np.linalg.svd(matrix, compute_uv=False)
    result: np.ndarray = (found[..., -1] <= 1e-13 * found[..., 0]) & known
    return result


def _formulas(
    blocks: AlikeBlocks, order: Tearing, inner: list[tuple[int, Expr]], constant: bool, favourites: frozenset[int]
) -> tuple[Expr, ...] | None:
    """The torn unknowns by Cramer's rule, where that is short and the determinant is no matter of the state.

    The matrix of one or two accelerations is a mass matrix, which is positive.
    """
    if len(order.torn) > 2 or len(blocks.residuals) > FORMULA_EQUATIONS:
        return None
    if len(order.torn) == 2 and not constant and not favourites.issuperset(order.torn):
        return None
    known: dict[Expr, Expr] = {}
    for v, formula in inner:
        known[slot(v)] = substitute(formula, known)
    residuals = tuple(substitute(blocks.residuals[e], known) for e in order.residuals)
    result = solve_pair(residuals, tuple(slot(v) for v in order.torn))
    if result is None or sum(1 for f in result for _ in postorder(f)) > FORMULA_NODES:
        return None
    return result
