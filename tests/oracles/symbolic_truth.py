"""Reference expressions of the lecture notes as SymPy objects, and systems built from them without the compiler."""

import json
from pathlib import Path

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


def equal(a, b) -> bool:
    return sp.simplify(sp.sympify(a) - sp.sympify(b)) == 0
