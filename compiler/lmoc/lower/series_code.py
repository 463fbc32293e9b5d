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
of_time out x g              as chain, where x grows evenly with time: no sum
late out a x                 what a product of a and an unknown x lacks: a at order zero times x
============================ ============================================================
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence

RECURRENCES = tuple(
    "end copy neg add sub scale ratio convolve square quotient power chain chain_more scale_more total open "
    "solve late of_time".split()
)
NUMBER = {name: k for k, name in enumerate(RECURRENCES)}
PRODUCTS = {"convolve", "square", "quotient", "power", "chain", "chain_more"}

Instruction = tuple[int, ...]
_OF_TWO = {"add", "sub", "convolve", "quotient"}
_ADDS = {"chain_more", "scale_more", "late"}  # to what stands in their series


def simplified(code: Sequence[Instruction]) -> list[Instruction]:
    """Return instructions with the same bits that read no copies and no negatives where those that they are of will do.

    Only what is filled once is looked through: with blocks, what depends on their unknowns is filled before and after.
    """
    fills = Counter(own[1] for own in code if RECURRENCES[own[0]] not in ("open", "solve"))
    of: dict[int, tuple[bool, int]] = {}  # of the same value at all orders but zero; whether it is the negative

    def seen(series: int) -> tuple[bool, int]:
        return of.get(series, (False, series))

    found: list[Instruction] = []
    for own in code:
        op, out, a, b, *terms = own
        name = RECURRENCES[op]
        if name in ("copy", "neg"):
            negative, source = seen(a)
            negative ^= name == "neg"
            own = NUMBER["neg" if negative else "copy"], out, source, b
            if fills[out] == 1:
                of[out] = negative, source
        elif name in ("add", "sub"):
            own = _sum(own, seen(a), seen(b))
        elif name in ("scale", "ratio") and not seen(a)[0]:
            own = op, out, seen(a)[1], b
        elif name == "total":
            pairs = [(x if seen(x)[0] else seen(x)[1], c) for x, c in zip(terms[::2], terms[1::2], strict=True)]
            own = op, out, a, b, *[k for pair in pairs for k in pair]
        found.append(own)
    return found


def _sum(own: Instruction, one: tuple[bool, int], two: tuple[bool, int]) -> Instruction:
    """Return a sum or difference without the negatives among what it is of."""
    (first, a), (second, b) = one, two
    second ^= RECURRENCES[own[0]] == "sub"
    if first and second:  # the same as before but for copies
        return own
    if first:
        return NUMBER["sub"], own[1], b, a
    return NUMBER["sub" if second else "add"], own[1], a, b


def of_one_order(code: Sequence[Instruction], kept: set[int]) -> set[int]:
    """Return the series of which no coefficient is read when the next order is under way.

    Parameters
    ----------
    kept : what is read by others than instructions
    """
    filled = {own[1] for own in code if RECURRENCES[own[0]] not in ("open", "solve")}
    return filled - kept - {k for own in code for k in _of_lower_orders(own)}


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
    return [a, b] if name in ("convolve", "chain", "chain_more", "of_time") else []


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
