"""Loops over the same copies as one loop: the same numbers as one after the other, and as by numpy."""

from __future__ import annotations

import numpy as np
import pytest
from oracles.copies import PAIRS, PENDULUMS, plan_of

from lmoc.engine.kernel import Kernel
from lmoc.expression.dag import Expr, function, slot
from lmoc.ir.program import Apply, Program, Total
from lmoc.lower import writer
from lmoc.lower.blocks import derivatives_tape, values_tape
from lmoc.lower.chain_rule import ChainRule
from lmoc.numerics.solve.interpreter import Interpreter


def loops(tape) -> int:
    return sum(name == "rows" for _, name, _ in tape.instructions())


@pytest.mark.parametrize("text", [PENDULUMS, PAIRS], ids=["pendulums", "pairs"])
@pytest.mark.parametrize("n", [70, 262])
def test_a_scene_of_copies_is_one_loop_with_the_numbers_of_numpy(text, n):
    plan, base, _ = plan_of(text, n)
    tape = values_tape(plan.program, plan.count)
    tape.check()
    assert loops(tape) == 1 and not any(name in ("linear", "products") for _, name, _ in tape.instructions())
    kernel, w = Kernel(tape), base.copy()
    w[plan.states] = np.random.default_rng(n).uniform(0.3, 1.2, len(plan.states))
    unknowns = kernel.unknowns
    w[unknowns] = 0.5 * np.repeat(w[plan.states[:1]], len(unknowns))
    kernel.w[: plan.count] = w
    kernel.forget()
    kernel(0.0)
    Interpreter(plan.program, plan.count).run(w, 0.0)
    size = 1 + np.abs(w[plan.derivatives]).max()
    assert np.isfinite(w[plan.derivatives]).all()
    assert np.abs(kernel.w[plan.derivatives] - w[plan.derivatives]).max() <= 1e-12 * size


def test_a_copy_without_a_solution_takes_none_from_the_others():
    plan, base, states = plan_of(PAIRS, 70)
    kernel, found = Kernel(values_tape(plan.program, plan.count)), []
    for value in (np.nan, 1.0):
        kernel.w[: plan.count] = base
        kernel.w[plan.states], kernel.w[kernel.unknowns] = 1.0, 0.45
        kernel.w[plan.states[states.index("mass[18].q")]] = value
        status = kernel(0.0)
        found.append((status & 1, kernel.w[kernel.unknowns].copy(), kernel.determinants()))
    (failed, mine, mine_det), (fails, theirs, theirs_det) = found
    assert failed and not fails
    good = np.isfinite(mine)
    assert (~good).sum() == 2 and np.isfinite(theirs).all()  # the two unknowns of this copy
    assert (mine[good] == theirs[good]).all() and (mine_det == theirs_det).sum() == 69


def columns(random: np.random.Generator, rows: int, count: int) -> list[np.ndarray]:
    """Registers of copies: one after the other, with a stride, in any order, backwards."""
    found = []
    for k in range(count):
        kind, first = random.integers(4), 3 * rows * k
        own = np.arange(rows) if kind == 0 else 3 * np.arange(rows) if kind == 1 else np.arange(rows)[::-1]
        found.append(first + (random.permutation(3 * rows)[:rows] if kind == 2 else own))
    return found


def shape(random: np.random.Generator, depth: int = 0) -> Expr:
    if depth == 3 or random.random() < 0.2:
        return slot(int(random.integers(3)))
    name = str(random.choice(["add", "sub", "mul", "sin", "neg"]))
    args = [shape(random, depth + 1) for _ in range(1 if name in ("sin", "neg") else 2)]
    return function("sin", args[0]) if name == "sin" else -args[0] if name == "neg" else (
        args[0] + args[1] if name == "add" else args[0] - args[1] if name == "sub" else args[0] * args[1]
    )  # fmt: skip


def random_program(random: np.random.Generator, rows: int) -> tuple[Program, int]:
    """Steps on copies, some of which read a neighbour, one number for all, or sum up."""
    every, steps = columns(random, rows, 14), []
    for k in range(4, 14):
        out = every[k]
        if random.random() < 0.25:
            terms = np.column_stack([every[int(random.integers(k))] for _ in range(int(random.integers(1, 4)))])
            start, factor = terms.shape[1] * np.arange(rows + 1), random.choice([1.0, -2.0], terms.size)
            steps.append(Total(start, terms.ravel(), np.tile(factor[: terms.shape[1]], rows), out))
            continue
        slots = [every[int(random.integers(k))] for _ in range(3)]
        if random.random() < 0.3:
            slots[0] = np.roll(slots[0], 1)  # of another copy
        if random.random() < 0.3:
            slots[1] = np.full(rows, slots[1][0])
        steps.append(Apply(shape(random), np.column_stack(slots), out))
    return tuple(steps), 3 * rows * 14


@pytest.mark.parametrize("seed", range(12))
def test_joined_loops_have_the_numbers_of_single_ones(seed, monkeypatch):
    random = np.random.default_rng(seed)
    program, count = random_program(random, 9 if seed % 3 else 261)
    rule = ChainRule(program, np.arange(3 * len(program[0].out)), program[-1].out, count)
    given, found = random.normal(size=count), []
    for together in (True, False):
        if not together:
            monkeypatch.setattr(writer, "joined", lambda own, results: own.code)
        tapes = values_tape(program, count), derivatives_tape(program, rule, count, values=True)
        kernels = [Kernel(tape) for tape in tapes]
        for tape, kernel in zip(tapes, kernels, strict=True):
            tape.check()
            kernel.w[:count] = given
            kernel(0.7)
        found.append([loops(tapes[0]), kernels[0].w[:count], kernels[1].w[:count], kernels[1].results()])
    assert found[0][0] <= found[1][0]
    for mine, theirs in zip(found[0][1:], found[1][1:], strict=True):
        assert np.array_equal(mine, theirs)
