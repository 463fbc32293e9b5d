"""The energy ledger: what a scene stores, loses and is given, as variables of the flat model.

A part states its `energy`, its `loss` or the `power` it delivers. A part with ports that states none of them is taken
as a source of what comes out of its ports: −Σ flow·der(potential), or what the units of the ports say is a power,
−Σ flow·potential (voltage and current, pressure and volume flow) or −Σ flow (temperature and heat flow); a pair whose
units make no power of it (pressure and mass flow) adds nothing. A connector of that name, a sensor's signal, states
nothing. Where no part of a scene states anything, these cancel in every connection, and the ledger is empty.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np

from lmoc.expression import dag
from lmoc.expression.units import UnitError, parse_unit
from lmoc.ir.flat import Block, Group, Kind, Part, Sums
from lmoc.support.indices import INDEX
from lmoc.support.records import dataclass

TOTALS = (("stored", "J"), ("lost", "W"), ("supplied", "W"), ("work", "J"), ("heat", "J"))
STATED = {"energy": "stored", "loss": "lost", "power": "supplied"}
DESCRIPTION = {
    "stored": "energy stored in all parts",
    "lost": "power dissipated in all parts",
    "supplied": "power that the sources deliver",
    "work": "energy supplied since the start",
    "heat": "energy dissipated since the start",
}


@dataclass(frozen=True, eq=False)
class Ledger:
    """The additions of the energy ledger to a flat model."""

    blocks: list[Block]
    groups: list[Group]
    sums: Sums


def ledger(blocks: list[Block], parts: list[Part], count: int, zero: np.ndarray) -> Ledger:
    """Totals over all parts, and the power of those that state nothing.

    Parameters
    ----------
    count : number of variables so far
    zero : mask over the variables: known to be zero, not worth a term
    """
    stated: dict[int, dict[str, Block]] = {}
    signals: set[int] = set()  # the parts that have a signal of the name of what comes out of their ports
    for block in blocks:
        name = block.path[-1][0]
        if name not in STATED or block.part <= 0 or block.path[:-1] != parts[block.part].path:
            continue
        if not block.connector:
            stated.setdefault(block.part, {})[name] = block
        elif name == "power":
            signals.add(block.part)
    added: list[Block] = []
    groups: list[Group] = []
    terms: dict[str, list[np.ndarray]] = {"stored": [], "lost": [], "supplied": []}
    offset = count
    for number, part in enumerate(parts):
        if number == 0 or not part.leaf or not part.ports:
            continue
        own = stated.get(number)
        if own is None:
            block, group = _port_power(number, part, blocks, offset, "port_power" if number in signals else "power")
            added.append(block)
            groups.append(group)
            terms["supplied"].append(block.offset + np.arange(block.size))
            offset += block.size
            continue
        for name, block in own.items():
            index = block.offset + np.arange(block.size)
            terms[STATED[name]].append(index[~zero[index]])
    if not stated:
        terms["supplied"] = []
    totals = {}
    for name, unit in TOTALS:
        path = (("ledger", ()), (name, ()))
        totals[name] = Block(path, offset, 1, Kind.UNKNOWN, unit, description=DESCRIPTION[name])
        added.append(totals[name])
        offset += 1
    for integral, rate in (("work", "supplied"), ("heat", "lost")):
        slots = np.array([[totals[integral].offset, totals[rate].offset]])
        groups.append(Group(dag.slot(0, 1), dag.slot(1), slots, None, 0, "ledger"))
    return Ledger(added, groups, _sums(terms, totals))


def _sums(terms: dict[str, list[np.ndarray]], totals: dict[str, Block]) -> Sums:
    starts, indices, signs = [0], [], []
    for name, parts in terms.items():
        index = np.concatenate([*parts, [totals[name].offset]]).astype(INDEX)
        indices.append(index)
        signs.append(np.concatenate([np.ones(len(index) - 1), [-1.0]]))
        starts.append(starts[-1] + len(index))
    none = np.full(len(terms), -1)
    return Sums(np.array(starts), np.concatenate(indices), np.concatenate(signs), (), none)


def _port_power(number: int, part: Part, blocks: list[Block], offset: int, name: str) -> tuple[Block, Group]:
    """The power that comes out of the ports of a part, element by element of an array of parts."""
    dims = tuple(n for _, own in part.path for n in own)
    size = int(np.prod(dims, dtype=int))
    block = Block(
        (*part.path, (name, ())), offset, size, Kind.UNKNOWN, "W",
        description="power that comes out of its ports", part=number, span=part.span,
    )  # fmt: skip
    columns = [offset + np.arange(size)]
    power: dag.Expr = dag.ZERO
    for potential, flow in part.ports:
        across, through = blocks[potential], blocks[flow]
        orders = _factors(across.unit, through.unit)
        if orders is None:
            continue
        inner = across.size // size if size else 0
        for k in range(inner):
            out = dag.slot(len(columns))
            columns.append(through.offset + np.arange(size) * inner + k)
            for order in orders:
                out = dag.mul(out, dag.slot(len(columns), order))
                columns.append(across.offset + np.arange(size) * inner + k)
            power = dag.sub(power, out)
    return block, Group(dag.slot(0), power, np.column_stack(columns), part.span, number, "ledger")


@cache
def _factors(potential: str, flow: str) -> tuple[int, ...] | None:
    """The order of the potential's derivative that makes a power of the flow.

    Nothing where the flow is one itself; None where neither the potential nor its derivative makes one of it.
    """
    try:
        across, through = parse_unit(potential), parse_unit(flow)
    except UnitError:
        return (1,)
    watt = parse_unit("W").exponents
    if through is not None and through.exponents == watt:
        return ()
    if across is None or through is None:
        return (1,)
    product = across * through
    if product.exponents == watt:
        return (0,)
    return (1,) if (product / parse_unit("s")).exponents == watt else None


def join_sums(first: Sums, second: Sums) -> Sums:
    """The rows of both."""
    span_of = [s.span_of if len(s.span_of) == s.rows else np.full(s.rows, -1) for s in (first, second)]
    moved = np.where(span_of[1] >= 0, span_of[1] + len(first.spans), -1)
    return replace(
        first,
        start=np.concatenate([first.start, first.start[-1] + second.start[1:]]).astype(int),
        index=np.concatenate([first.index, second.index]).astype(INDEX),
        sign=np.concatenate([first.sign, second.sign]),
        spans=first.spans + second.spans,
        span_of=np.concatenate([span_of[0], moved]).astype(int),
    )
