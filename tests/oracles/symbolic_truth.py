"""Reference expressions of the lecture notes as SymPy objects, and systems built from them without the compiler."""

import json
from pathlib import Path
from random import Random

import mpmath
import sympy as sp

from lmoc.symbolic.system import SymbolicSystem, jet_symbol

ROOT = Path(__file__).parents[2]
NOTES = json.loads((ROOT / "tests/data/notes.json").read_text())
TRUTH = json.loads((ROOT / "tests/data/notes_symbolic.json").read_text())


# Models whose coordinates follow from each other by iteration only: there are no symbols for them.
IMPLICIT = {"h01_cartesian_pendulum", "h03_four_bar", "h04_slider_crank", "h26_andrews"}


def names_of(name: str) -> dict[str, sp.Symbol]:
    """Symbols behind the names of one system: parameters, states, inputs and ``du`` for an input's derivative."""
    truth = TRUTH[name]
    names = {n: sp.Symbol(n) for n in (*truth["parameters"], *truth["states"], *truth["inputs"], "s", "p")}
    return names | {"d" + u: jet_symbol(u, 1) for u in truth["inputs"]}


def read(name: str, text: str, more: dict | None = None) -> sp.Expr:
    return sp.sympify(text, locals=names_of(name) | (more or {}))


def matrix(name: str, rows: list[list[str]]) -> sp.Matrix:
    return sp.Matrix(len(rows), len(rows[0]) if rows else 0, [read(name, e) for row in rows for e in row])


def by_hand(name: str) -> SymbolicSystem:
    """The symbolic system that the reference equations describe."""
    truth = TRUTH[name]
    symbols = names_of(name)
    states = tuple(symbols[x] for x in truth["states"])
    inputs = tuple(symbols[u] for u in truth["inputs"])
    jets = {u: (u, jet_symbol(u.name, 1)) for u in inputs}
    outputs = {}
    if "linear" in truth:
        linear, x = {k: matrix(name, v) for k, v in truth["linear"].items()}, sp.Matrix(states)
        y = linear["C"] * x
        if inputs:
            y += linear["D"] * sp.Matrix(inputs) + linear["Dd"] * sp.Matrix([jets[u][1] for u in inputs])
        outputs = dict(zip(truth["outputs"], y, strict=True))
    return SymbolicSystem(
        name=name,
        states=states,
        derivatives=tuple(read(name, truth["eom"][f"der({x})"]) for x in truth["states"]),
        inputs=inputs,
        input_jets=jets,
        outputs=outputs,
        values={symbols[p]: v for p, v in NOTES[name]["parameters"].items()},
    )


def at_random_points(*expressions) -> list[list]:
    """Values at three places, of 60 digits: expressions that differ do so at almost every place (Schwartz, Zippel)."""
    own = [sp.sympify(e) for e in expressions]
    symbols = sorted(set().union(*(e.free_symbols for e in own)), key=str)
    random, found = Random(1), []
    with mpmath.workdps(60):
        compute = sp.lambdify(symbols, own, "mpmath")
        for _ in range(3):
            found.append(compute(*(mpmath.mpf(random.randint(2, 2000)) / 999 for _ in symbols)))
    return found


def equal(a, b) -> bool:
    """Whether two expressions, or matrices of them, are the same function of their symbols."""
    if isinstance(a, sp.MatrixBase):
        return a.shape == b.shape and all(equal(*pair) for pair in zip(a, b, strict=True))
    within = 1e-13 if sp.Tuple(a, b).has(sp.Float) else 1e-30
    return a == b or all(abs(x - y) <= within * (1 + abs(x)) for x, y in at_random_points(a, b))


def proportional(a, b) -> bool:
    """Whether two expressions are the same but for a number that is not zero."""
    ratios = [x / y for x, y in at_random_points(a, b)]
    return ratios[0] != 0 and all(abs(r - ratios[0]) <= 1e-30 * abs(ratios[0]) for r in ratios)
