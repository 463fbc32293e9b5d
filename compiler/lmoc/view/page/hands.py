"""The hand that pulls in a page: a spring at each node that moves, of stiffness zero until it is taken.

It is part of the flat model, so that laws, constraints and the ledger of energy know of it: at a node with potential p
the force k·(target − p) acts on the scene, and its power k·(target − p)·der(p) counts as supplied.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from lmoc.expression.dag import ZERO, Expr, function, slot
from lmoc.ir.flat import Block, FlatDAE, Group, Kind, Sums
from lmoc.ir.paths import element_name
from lmoc.messages.diagnostics import ModelError, SimulationError
from lmoc.report.result import Result
from lmoc.support.indices import INDEX
from lmoc.support.records import dataclass

MOST_HANDS = 120
MOST_STEPS = 20_000  # of a run that is made again with hands
MOST_STATES = 400  # of a scene that is also pulled where nothing has inertia: a hand is a term of its linear systems
KINDS = {("m",): "line", ("rad",): "shaft", ("m", "m"): "point", ("m", "m", "rad"): "frame"}
SAME = 1e-9  # of the largest value of a state: nearer starts are the same
SIGNALS = {"line": 2, "shaft": 2, "point": 3, "frame": 5}  # stiffness, target, and where on a frame


@dataclass(frozen=True)
class Hand:
    """Where a scene can be pulled: a node, by the port at it that was named first.

    Attributes
    ----------
    name : of the port
    kind : of `KINDS`
    potentials, flows : variables of the port
    inert : the part that has the port has inertia
    signals : inputs of the hand: k, the target or the targets, and the place on a frame
    """

    name: str
    kind: str
    potentials: tuple[int, ...]
    flows: tuple[int, ...]
    inert: bool
    signals: tuple[int, ...] = ()


def with_hands(flat: FlatDAE, hands: Sequence[Hand]) -> tuple[FlatDAE, list[Hand], dict[str, float]]:
    """Return a flat model with hands, these with their signals, and signals with which none of them pulls."""
    work = _Work(flat)
    pulling = [work.pull(hand) for hand in hands]
    return work.flat(), pulling, {b.name(0): 0.0 for b in work.blocks if b.kind == Kind.INPUT}


def hands_at(flat: FlatDAE, names: Iterable[str]) -> tuple[list[Hand], dict[str, int]]:
    """Return a hand for each node that one of the named variables is a potential of, and which of them each moves."""
    row_of, ledger = _rows(flat.sums), flat.find("ledger.supplied")
    if ledger is None or int(ledger[0]) not in row_of:
        return [], {}
    flow_of = {p: (f, part) for part in flat.parts for p, f in part.ports}
    hands: list[Hand] = []
    place: dict[tuple[int, ...], int] = {}
    found: dict[str, int] = {}
    for name in names:
        hand = _hand(flat, flow_of, name)
        nodes = () if hand is None else tuple(row_of.get(f, -1) for f in hand.flows)
        if hand is None or -1 in nodes or (nodes not in place and len(hands) == MOST_HANDS):
            continue
        if nodes not in place:
            place[nodes] = len(hands)
            hands.append(hand)
        found[name] = place[nodes]
    return hands, found


def _hand(flat: FlatDAE, flow_of: dict, name: str) -> Hand | None:
    """Return the hand at the port that a variable is a potential of; None where it is none, or of no known kind."""
    numbers = flat.find(name)
    if numbers is None or len(numbers) != 1:
        return None
    block = int(flat.block_of[numbers[0]])
    if block not in flow_of:
        return None
    element, part = int(numbers[0]) - flat.blocks[block].offset, flow_of[block][1]
    port = flat.blocks[block].path[:-1]
    own = [(flat.blocks[p], flat.blocks[f]) for p, f in part.ports if flat.blocks[p].path[:-1] == port]
    kind = KINDS.get(tuple(p.unit for p, _ in own))
    if kind is None or len({p.size for p, _ in own}) > 1:
        return None
    inertia = "J" if kind == "shaft" else "m"
    inert = any(b.part == flat.blocks[block].part and b.path[-1][0] == inertia for b in flat.blocks)
    potentials, flows = (tuple(pair[k].offset + element for pair in own) for k in (0, 1))
    return Hand(element_name(port, element), kind, potentials, flows, inert)


def _rows(sums: Sums) -> dict[int, int]:
    """Return the row of the connection set of each flow."""
    return {int(v): int(r) for r, v in zip(np.repeat(np.arange(sums.rows), np.diff(sums.start)), sums.index)}


def run_with_hands(run: Result, names: Sequence[str]) -> tuple[Result, list[Hand], dict[str, int]] | None:
    """Return the run again with hands at the nodes of named variables, and which hand each is moved by.

    Where a scene does not run with all of them, or is large, only parts with inertia are pulled. None where there is
    nothing to be pulled, or where the run is too long.
    """
    flat = run.reduced.lawful or run.flat
    if run.extended is None or not run.complete or float(run.stats.get("steps", MOST_STEPS)) >= MOST_STEPS:
        return None
    every, places = hands_at(flat, names)
    inert = [h for h in every if h.inert]
    for kept in (every, inert) if len(run.states) <= MOST_STATES else (inert,):
        extended, hands, nothing = with_hands(flat, kept)
        try:
            held = run.extended(extended, nothing) if kept else None
            if held is not None and (begun := elsewhere(run, held)):
                held = run.extended(extended, nothing, begun)
        except (ModelError, SimulationError):
            continue
        if held is not None and held.reduced.has_states_of(run.reduced):
            new = {id(hand): k for k, hand in enumerate(kept)}
            own = {name: new[id(every[k])] for name, k in places.items() if id(every[k]) in new}
            return held, hands, own
    return None


def elsewhere(run: Result, held: Result) -> dict[str, float]:
    """Return the states of a run at its start, where one with hands begins elsewhere: what is open is guessed."""
    if not held.reduced.has_states_of(run.reduced) or not len(run.time):
        return {}
    own, other = _sampled_states(run), _sampled_states(held)
    near = np.abs(other[0] - own[0]) <= SAME * np.abs(own).max(axis=0)
    return {} if near.all() else dict(zip(run.states, own[0].tolist(), strict=True))


def _sampled_states(run: Result) -> np.ndarray:
    """Return the states at some of the times, the first among them, as long as they are the coordinates."""
    own = (p for p in run.trajectory.segments if list(p.coordinates) == run.states)
    return np.concatenate([p.samples[1][:, ~p.observer.plan.ledger] for p in own])


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
        self.row_of = _rows(sums)
        self.sign_of = dict(zip(sums.index.tolist(), sums.sign.tolist(), strict=True))
        self.more: dict[int, list[tuple[int, float]]] = {}  # (variable, sign) by row of the sums
        ledger = flat.find("ledger.supplied")
        assert ledger is not None, "a scene without a ledger has no hands"
        self.supplied = self.row_of[int(ledger[0])]

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


def hands_data(hands: Sequence[Hand], registers: np.ndarray) -> list[dict[str, Any]]:
    """Return what the page reads of hands: name, kind, registers of the signals and of the potentials."""
    return [
        {
            "name": hand.name,
            "kind": hand.kind,
            "signals": registers[list(hand.signals)].tolist(),
            "potentials": registers[list(hand.potentials)].tolist(),
        }
        for hand in hands
    ]
