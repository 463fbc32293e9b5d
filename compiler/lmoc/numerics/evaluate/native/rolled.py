"""Repetitions in a program: the same few shapes again and again, each round reading what the one before has made.

In a chain of bodies every angle follows from the last, so that its steps have one row each, however long it is. Written
as a loop over rounds they take as much text as one of them.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from lmoc.ir.program import Apply, Program, Step
from lmoc.support.records import dataclass

_LONGEST = 24  # steps of a round
_LEAST = 6  # rounds that are worth a loop
_ROWS = 4  # of a step that is part of a round


@dataclass(frozen=True, eq=False)
class Rolled:
    """Rounds of steps: row k of each of them belongs to round k.

    Attributes
    ----------
    steps : tuple of Apply
        To be run round by round, unlike the rows of an Apply elsewhere.
    rounds : int
    """

    steps: tuple[Apply, ...]
    rounds: int


def roll(program: Program) -> Iterator[Step | Rolled]:
    """The steps of a program in order, repetitions as one."""
    keys = [_key(step) for step in program]
    k = 0
    while k < len(program):
        period, rounds = _repetition(keys, k)
        if rounds < _LEAST:
            yield program[k]
            k += 1
            continue
        own = [_joined(program[k + j : k + rounds * period : period]) for j in range(period)]
        yield Rolled(tuple(step for joined in own for step in joined), rounds)
        k += rounds * period


def _key(step: Step) -> object:
    """Equal for steps that may stand at the same place of two rounds; of its own for one that may not."""
    few = isinstance(step, Apply) and len(step.out) <= _ROWS
    return (id(step.shape), len(step.out)) if few else object()


def _repetition(keys: list[object], k: int) -> tuple[int, int]:
    """The shortest round that begins at k and comes again, and how often."""
    for period in range(1, _LONGEST + 1):
        rounds = 1
        first = keys[k : k + period]
        while keys[k + rounds * period : k + (rounds + 1) * period] == first:
            rounds += 1
        if rounds >= _LEAST:
            return period, rounds
    return 1, 1


def _joined(steps: Program) -> list[Apply]:
    """The same step of all rounds, one for each of its rows."""
    shape = steps[0].shape
    slots, out = np.stack([s.slots for s in steps]), np.stack([s.out for s in steps])
    return [Apply(shape, slots[:, k], out[:, k]) for k in range(out.shape[1])]
