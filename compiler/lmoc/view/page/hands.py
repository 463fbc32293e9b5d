"""The hand that pulls in a page: a spring at each part that moves, of stiffness zero until it is taken.

It is part of the flat model, so that laws, constraints and the ledger of energy know of it: at a node with potential p
the force k·(target − p) acts on the part, and its power k·(target − p)·der(p) counts as supplied.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from lmoc.expression.dag import ZERO, Expr, function, slot
from lmoc.ir.flat import Block, FlatDAE, Group, Kind, Sums
from lmoc.report.result import Result
from lmoc.support.indices import INDEX
from lmoc.support.records import dataclass

MOST_HANDS = 120
MOST_STEPS = 20_000  # of a run that is made again with hands
KINDS = {("m",): "line", ("rad",): "shaft", ("m", "m"): "point", ("m", "m", "rad"): "frame"}
SIGNALS = {"line": 2, "shaft": 2, "point": 3, "frame": 5}  # stiffness, target, and where on a frame


@dataclass(frozen=True)
class Hand:
    """Where a part can be pulled.

    Attributes
    ----------
    part : its name
    kind : of `KINDS`
    potentials, flows : variables of its port
    signals : inputs of the hand: k, the target or the targets, and the place on a frame
    """

    part: str
    kind: str
    potentials: tuple[int, ...]
    flows: tuple[int, ...]
    signals: tuple[int, ...] = ()


def with_hands(flat: FlatDAE, names: Sequence[str]) -> tuple[FlatDAE, list[Hand], dict[str, float]]:
    """Return a flat model in which parts can be pulled, its hands, and signals with which none of them pulls."""
    work = _Work(flat)
    found = [hand for hand in _ports(flat, names) if work.reaches(hand)][:MOST_HANDS]
    hands = [work.pull(hand) for hand in found]
    return work.flat(), hands, {b.name(0): 0.0 for b in work.blocks if b.kind == Kind.INPUT}


def _ports(flat: FlatDAE, names: Sequence[str]) -> list[Hand]:
    """Return the first port of each of the named parts that have inertia."""
    found = []
    wanted = set(names)
    for part in flat.parts[1:]:
        name = part.pattern
        if name not in wanted or not part.ports or any(dims for _, dims in part.path):
            continue
        first = flat.blocks[part.ports[0][0]].path[:-1]
        own = [(flat.blocks[p], flat.blocks[f]) for p, f in part.ports if flat.blocks[p].path[:-1] == first]
        kind = KINDS.get(tuple(p.unit for p, _ in own))
        inert = flat.find(f"{name}.{'J' if kind == 'shaft' else 'm'}") is not None
        if kind is not None and inert and all(p.size == 1 for p, _ in own):
            found.append(Hand(name, kind, tuple(p.offset for p, _ in own), tuple(f.offset for _, f in own)))
    return found


def run_with_hands(run: Result, names: Sequence[str]) -> tuple[Result, list[Hand]] | None:
    """Return the run again with hands at the named parts; None where there are none, or where it is too long."""
    flat = run.reduced.lawful or run.flat
    if run.extended is None or not run.complete or float(run.stats.get("steps", MOST_STEPS)) >= MOST_STEPS:
        return None
    extended, hands, nothing = with_hands(flat, names)
    if not hands or len(run.coordinates) > 1:
        return None
    held = run.extended(extended, nothing)
    return (held, hands) if held.states == run.states else None


def of_origin(numbers: np.ndarray, run: Result, held: Result) -> np.ndarray:
    """Return an array over the variables of a run with hands as one over those of the run without."""
    first = (run.reduced.lawful or run.flat).count
    added = held.flat.count - run.flat.count
    return np.concatenate([numbers[:first], numbers[first + added :]])


class _Work:
    """A flat model to which hands are added one by one."""

    def __init__(self, flat: FlatDAE) -> None:
        self.origin, self.count = flat, flat.count
        self.blocks: list[Block] = []
        self.groups: list[Group] = []
        sums = flat.sums
        self.row_of = {int(v): int(r) for r, v in zip(np.repeat(np.arange(sums.rows), np.diff(sums.start)), sums.index)}
        self.sign_of = dict(zip(sums.index.tolist(), sums.sign.tolist(), strict=True))
        self.more: dict[int, list[tuple[int, float]]] = {}  # (variable, sign) by row of the sums
        supplied = flat.find("ledger.supplied")
        self.supplied = -1 if supplied is None else self.row_of.get(int(supplied[0]), -1)

    def reaches(self, hand: Hand) -> bool:
        """Return whether the hand has a node to act on."""
        return self.supplied >= 0 and all(f in self.row_of for f in hand.flows)

    def variable(self, name: str, kind: Kind) -> int:
        path = (("'the hand'", ()), (f"{name}{len(self.blocks)}", ()))
        self.blocks.append(Block(path, self.count, 1, kind, protected=True))
        self.count += 1
        return self.count - 1

    def signal(self, name: str) -> int:
        """Return an input: no equation is solved with its value for a coefficient."""
        return self.variable(name, Kind.INPUT)

    def equation(self, left: Expr, right: Expr, columns: Sequence[int], origin: str = "equation") -> None:
        self.groups.append(Group(left, right, np.array([columns], INDEX), None, 0, origin))

    def pull(self, hand: Hand) -> Hand:
        """Add a hand; forces on the part are positive along its potentials."""
        own = tuple(self.signal("p") for _ in range(SIGNALS[hand.kind]))
        forces = [self.variable("f", Kind.UNKNOWN) for _ in hand.flows]
        stiffness, targets = own[0], own[1 : 1 + min(2, len(hand.flows))]
        if hand.kind == "frame":
            x, y, theta = hand.potentials
            rx, ry = own[3:]
            across, up = _turned(slot(4), slot(5), slot(6))
            for force, target, potential, arm in zip(forces, targets, (x, y), (across, up), strict=False):
                columns = [force, stiffness, target, potential, theta, rx, ry]
                self.equation(slot(0), slot(1) * (slot(2) - slot(3) - arm), columns)
            across, up = _turned(slot(1), slot(2), slot(3))
            columns = [forces[2], theta, rx, ry, forces[0], forces[1]]
            self.equation(slot(0), across * slot(5) - up * slot(4), columns)
        else:
            for force, target, potential in zip(forces, targets, hand.potentials, strict=False):
                self.equation(slot(0), slot(1) * (slot(2) - slot(3)), [force, stiffness, target, potential])
        power = self.variable("power", Kind.UNKNOWN)
        total = ZERO
        for k in range(len(forces)):
            total += slot(2 * k + 1) * slot(2 * k + 2, 1)
        columns = [power, *(v for pair in zip(forces, hand.potentials, strict=True) for v in pair)]
        self.equation(slot(0), total, columns, "ledger")
        self.more.setdefault(self.supplied, []).append((power, 1.0))
        for flow, force in zip(hand.flows, forces, strict=True):
            self.more.setdefault(self.row_of[flow], []).append((force, -self.sign_of[flow]))
        return replace(hand, signals=own)

    def flat(self) -> FlatDAE:
        origin = self.origin
        return replace(
            origin,
            blocks=(*origin.blocks, *self.blocks),
            groups=(*origin.groups, *self.groups),
            sums=_extended(origin.sums, self.more),
        )


def _turned(theta: Expr, x: Expr, y: Expr) -> tuple[Expr, Expr]:
    """Return a vector of a frame as the ground sees it."""
    c, s = function("cos", theta), function("sin", theta)
    return c * x - s * y, s * x + c * y


def _extended(sums: Sums, more: dict[int, list[tuple[int, float]]]) -> Sums:
    """Return sums with further terms in some rows."""
    index, sign, start = [], [], [0]
    for row in range(sums.rows):
        here = slice(int(sums.start[row]), int(sums.start[row + 1]))
        added = more.get(row, [])
        index += [*sums.index[here].tolist(), *(v for v, _ in added)]
        sign += [*sums.sign[here].tolist(), *(s for _, s in added)]
        start.append(len(index))
    return replace(sums, start=np.array(start), index=np.array(index, INDEX), sign=np.array(sign, float))


def hands_data(run: Result, hands: Sequence[Hand], registers: np.ndarray) -> list[dict[str, Any]]:
    """Return what the page reads of hands: kind, inertia, registers of the signals and of the potentials."""
    return [
        {
            "part": hand.part,
            "kind": hand.kind,
            "inertia": float(run[f"{hand.part}.{'J' if hand.kind == 'shaft' else 'm'}"][0]),
            "signals": registers[list(hand.signals)].tolist(),
            "potentials": registers[list(hand.potentials)].tolist(),
        }
        for hand in hands
        if (registers[[*hand.signals, *hand.potentials]] >= 0).all()
    ]
