"""Instructions of Taylor series: what they read, which of them a block has to repeat, and which nobody needs.

An instruction is four int32: the number of its operation, the series that it fills, and two operands, which are series
or, where so named, places of numbers:

============================ ============================================================
copy, neg out a              the same of a
add, sub, convolve out a b   sum, difference, product
scale, ratio out a number    product and quotient with a number
square out a
quotient out a b             a is -1 where it is a number
power out a number           with a constant exponent
chain out x g                of a function with the slope g; ``…_more`` adds to what stands there
total out n, then n pairs    of a series and the place of a coefficient
open k, solve k              the unknowns of a block: as if they were zero, then as they are
late out a x                 what a product of a and an unknown x lacks: a at order zero times x
============================ ============================================================
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

RECURRENCES = tuple(
    "end copy neg add sub scale ratio convolve square quotient power chain chain_more scale_more total open "
    "solve late".split()
)
NUMBER = {name: k for k, name in enumerate(RECURRENCES)}
PRODUCTS = {"convolve", "square", "quotient", "power", "chain", "chain_more"}

Instruction = tuple[int, ...]
_OF_TWO = {"add", "sub", "convolve", "quotient"}
_ADDS = {"chain_more", "scale_more", "late"}  # to what stands in their series


def _read(own: Instruction) -> list[int]:
    """Return the series whose coefficient of the same order an instruction reads."""
    op, out, a, b, *terms = own
    name = RECURRENCES[op]
    if name in ("open", "solve"):
        return []
    if name == "total":
        return terms[::2]
    read = [b] if name == "late" else [a, b] if name in _OF_TWO else [a]
    return [out, *read] if name in _ADDS else read


def _of_lower_orders(own: Instruction) -> list[int]:
    """Return the series of which an instruction reads coefficients of lower orders."""
    op, out, a, b, *_ = own
    name = RECURRENCES[op]
    if name == "square":
        return [a]
    if name == "power":
        return [a, out]
    if name == "quotient":
        return [b, out]
    return [a, b] if name in ("convolve", "chain", "chain_more") else []


def dependent(code: Sequence[Instruction], unknowns: set[int]) -> list[Instruction]:
    """Return what has to follow when the unknowns of a block, which were zero, are known; all where blocks are within.

    Of a product with an unknown only one term is missing.
    """
    if any(RECURRENCES[own[0]] in ("open", "solve") for own in code):
        return list(code)
    moved = set(unknowns)
    by_series: dict[int, list[list[Instruction] | None]] = {}
    for own in code:
        if not moved.isdisjoint(_read(own)):
            moved.add(own[1])
            by_series.setdefault(own[1], []).append(_late(own, unknowns, moved))
    found: list[Instruction] = []
    for own in code:
        if own[1] not in moved:
            continue
        late = by_series[own[1]]
        if None in late:
            found.append(own)
        elif not moved.isdisjoint(_read(own)):
            found += _late(own, unknowns, moved) or []
    return found


def _late(own: Instruction, unknowns: set[int], moved: set[int]) -> list[Instruction] | None:
    """Return what is missing of a product; None where it has to be computed once more."""
    op, out, a, b, *_ = own
    name = RECURRENCES[op]
    if name in ("chain", "chain_more"):  # of which the slope has lower orders alone
        factors = [(b, a)]
    elif name == "convolve":
        factors = [(b, a), (a, b)]
    elif name == "square":
        factors = [(a, a), (a, a)]
    else:
        return None
    factors = [(number, x) for number, x in factors if x in moved]
    if any(x not in unknowns for _, x in factors):
        return None
    return [(NUMBER["late"], out, number, x) for number, x in factors]


def needed(
    code: Sequence[Instruction], wanted: Iterable[int], blocks: Mapping[int, tuple[set[int], set[int]]]
) -> list[Instruction]:
    """Return the instructions that series which are wanted follow from.

    Parameters
    ----------
    blocks : the series of the unknowns and of the residuals of each
    """
    kept: list[Instruction] = []
    ahead = set(wanted)  # whose coefficients are read beyond their own order
    while True:
        kept = _live(code, ahead, blocks)
        more = {k for own in kept for k in _of_lower_orders(own)}
        if more <= ahead:
            return kept
        ahead |= more


def _live(
    code: Sequence[Instruction], at_end: set[int], blocks: Mapping[int, tuple[set[int], set[int]]]
) -> list[Instruction]:
    """Return the instructions that some series follow from at their own order."""
    live, kept = set(at_end), []
    for own in reversed(code):
        name = RECURRENCES[own[0]]
        if name in ("open", "solve"):
            unknowns, residuals = blocks[own[2]]
            live -= unknowns
            if name == "solve":
                live |= residuals
        elif own[1] not in live:
            continue
        else:
            if name not in _ADDS:
                live.discard(own[1])
            live.update(_read(own))
        kept.append(own)
    return kept[::-1]
