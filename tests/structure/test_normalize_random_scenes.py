"""Random scenes, loops and missing masses among them, against the matrix of their flat equations.

All parts used are linear, so that the flat equations are a matrix M(p) in p = d/dt. Its null space at a random p is
the oracle: empty where the scene determines everything; in the forces alone where it has loops that repeat
constraints, and then its support is what must be reported as undetermined.
"""

from __future__ import annotations

import random

import numpy as np
import pytest
from structure.test_normalize_scenes import check

from lmoc.expression.evaluate import evaluate
from lmoc.ir.flat import FlatDAE
from lmoc.messages.diagnostics import ModelError, Report
from lmoc.messages.source import Source
from lmoc.semantics.flatten import flatten
from lmoc.sources.library import load
from lmoc.structure.normalize import normalize
from lmoc.structure.reduce import reduce
from lmoc.syntax.parse import parse


class Scene:
    """Parts tied to nodes: places on a line, and shafts with a speed each, so that most loops agree."""

    def __init__(self, seed: int):
        self.rnd = random.Random(seed)
        self.place = [self.rnd.randint(-3, 3) for _ in range(self.rnd.randint(2, 6))]
        self.speed = [self.rnd.choice([1, 2, -1, 0.5, 3]) for _ in range(self.rnd.randint(1, 5))]
        self.flanges: list[list[str]] = [[] for _ in self.place]
        self.shafts: list[list[str]] = [[] for _ in self.speed]
        self.parts: list[str] = []
        self.bodies()
        self.joined()

    def add(self, part: str, modification: str, **ends: list[str]) -> None:
        name = f"p{len(self.parts)}"
        self.parts.append(f"{part} {name}({modification});")
        for port, node in ends.items():
            node.append(f"{name}.{port}")

    def bodies(self) -> None:
        chance, choice = self.rnd.random, self.rnd.choice
        for x, node in zip(self.place, self.flanges, strict=True):
            if chance() < 0.6:
                self.add("Mass", f"m = {choice([1, 2, 0.5, 0])}, g = {choice([0, 9.81])}", flange=node)
            if chance() < 0.15:
                self.add("Fixed", f"q0 = {x}", flange=node)
            if chance() < 0.1:
                self.add("Force", "f = sin(time)", flange=node)
        for node in self.shafts:
            if chance() < 0.7:
                self.add("Inertia", f"J = {choice([1, 2, 0.5, 0])}", shaft=node)
            if chance() < 0.1:
                self.add("FixedShaft", "", shaft=node)

    def joined(self) -> None:
        choice = self.rnd.choice
        for _ in range(self.rnd.randint(1, 9)):
            i, j = (self.rnd.randrange(len(self.place)) for _ in "ij")
            a, b = self.flanges[i], self.flanges[j]
            middle = [k for k, x in enumerate(self.place) if 2 * x == self.place[i] + self.place[j] and k not in (i, j)]
            if i == j:
                continue
            kind = choice(["Spring", "Damper", "Rod", "Rod", "Pulley"])
            if kind == "Rod":
                self.add(kind, f"L = {self.place[j] - self.place[i]}", a=a, b=b)
            elif kind == "Pulley" and middle:
                self.add(kind, "", a=a, b=b, axle=self.flanges[choice(middle)])
            elif kind in ("Spring", "Damper"):
                self.add(kind, f"{'k' if kind == 'Spring' else 'c'} = {choice([1, 3, 0])}", a=a, b=b)
        for _ in range(self.rnd.randint(0, 6)):
            i, j = (self.rnd.randrange(len(self.speed)) for _ in "ij")
            kind = choice(["Gear", "Gear", "GearPair", "TorsionSpring"])
            value = {
                "Gear": f"N = {self.speed[i] / self.speed[j]!r}",
                "GearPair": f"r1 = {self.speed[j]}, r2 = {-self.speed[i]}",
                "TorsionSpring": "k = 2",
            }[kind]
            if i != j:
                self.add(kind, value, a=self.shafts[i], b=self.shafts[j])
        if self.rnd.random() < 0.5:
            self.add("Drum", f"r = {choice([1, 0.5, -2])}", shaft=choice(self.shafts), flange=choice(self.flanges))

    @property
    def text(self) -> str:
        nodes = [*self.flanges, *self.shafts]
        connects = [f"connect({node[0]}, {other});" for node in nodes for other in node[1:]]
        return "\n".join(["model R", *self.parts, "equation", *connects, "end R;"])


def flat_text(text: str) -> FlatDAE:
    report = Report()
    file = parse(Source("r.lmo", text), report)
    report.check()
    return flatten([file], load(), None, {}, Report())


def undetermined_by_the_matrix(flat: FlatDAE, values: np.ndarray, p: float = 1.3717) -> set[str]:
    """Names of the variables in the null space of M(p)."""
    unknown = np.flatnonzero(flat.kind == 3)
    position = {v: i for i, v in enumerate(unknown.tolist())}
    rows = []
    for g in flat.groups:
        for slots in g.slots.tolist():
            rows.append(_row(g.residual, slots, position, values, p))
    sums = flat.sums
    for r in range(sums.rows):
        part = slice(sums.start[r], sums.start[r + 1])
        rows.append(np.bincount([position[v] for v in sums.index[part]], sums.sign[part], len(unknown)))
    _, singular, right = np.linalg.svd(np.array(rows))
    null = right[(singular > 1e-9 * singular[0]).sum() :]
    return {flat.variable_name(int(v)) for v in unknown[(np.abs(null) > 1e-7).any(axis=0)]}


def _row(shape, slots, position, values, p) -> np.ndarray:
    """Coefficients of one equation; odd parts only, which leaves out the energies."""
    row = np.zeros(len(position))
    for v in set(slots) & set(position):
        ends = []
        for sign in (1.0, -1.0):

            def column(k, order, v=v, sign=sign):
                if slots[k] == v:
                    return sign * p**order
                return 0.0 if np.isnan(values[slots[k]]) else values[slots[k]]

            ends.append(evaluate(shape, column, 0.0))
        row[position[v]] = (ends[0] - ends[1]) / 2
    return row


@pytest.mark.parametrize("seed", range(20))
def test_random_scene(seed):
    flat = flat_text(Scene(seed).text)
    values = flat.parameter_values()
    expected = undetermined_by_the_matrix(flat, values)
    if any(name.endswith((".q", ".theta")) for name in expected):  # a position that nothing fixes
        with pytest.raises(ModelError) as error:
            reduce(flat, values)
        assert {d.code for d in error.value.diagnostics if d.severity == "error"} <= {"E0402", "E0411", "E0416"}
        return
    n = normalize(flat, values, None, Report())
    check(n)
    assert {flat.variable_name(int(v)) for v in n.undetermined} == expected
    assert bool(n.notes) == bool(expected)
