"""The order of the rooms: each imports only those before it, and no files import each other in a circle.

Imports inside functions and those for types count as well.
"""

import ast
import re
from collections.abc import Collection
from functools import cache
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[1] / "compiler" / "lmoc"
ORDER = (
    "support",
    "messages",
    "expression",
    "ir",
    "syntax",
    "sources",
    "semantics",
    "structure",
    "lower",
    "engine",
    "numerics",
    "symbolic",
    "parameters",
    "pipeline",
    "session",
    "report",
    "model",
    "view",
    "run",
    "live",
    "simulation",
    "places",
    "dae",
    "studies",
    "export",
    "interface",
    "compilation",
    "editor",
    "cli",
)
# The order of folders and files inside a room; those that stand in no list may be imported by none of the listed.
INSIDE = {
    "structure": (
        "messages", "linear", "index", "discrete", "loops", "registers", "blocks", "coordinates", "unreduced",
        "diagnosis", "normalize", "reduce", "laws",
    ),
    "semantics": (
        "mistakes", "classes", "nodes", "values", "drafts", "connections", "assembly", "instances", "events",
        "equations", "algorithms", "topology", "flatten",
    ),
    "numerics": (
        "limits", "options", "solve", "signals", "plan", "problem", "dop853", "sundials", "evaluate", "observe",
        "monitors", "laws", "steps", "coordinates", "failures", "formulations", "events", "task", "start",
        "run", "lanes",
    ),
    "view": ("javascript", "scene", "page", "bodies", "drawing"),
}  # fmt: skip
# Circles that are still to be opened.
KNOWN: set[frozenset[str]] = set()
FILES = {".".join(("lmoc", *p.relative_to(PACKAGE).with_suffix("").parts)): p for p in sorted(PACKAGE.rglob("*.py"))}


def imports_of(name: str) -> set[str]:
    """The files of the package that a file imports, wherever it does."""
    found = set()
    for node in ast.walk(ast.parse(FILES[name].read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            found |= {node.module or "", *(f"{node.module}.{alias.name}" for alias in node.names)}
    return {f for f in found if f in FILES}


@cache
def graph() -> dict[str, set[str]]:
    """The imports of all files: read where a test asks, not in each process that collects the tests."""
    return {name: imports_of(name) for name in FILES}


def room(name: str) -> str:
    return name.split(".")[1]


def circles(graph: dict[str, set[str]]) -> list[list[str]]:
    """Strongly connected components of more than one file (Tarjan, SIAM J. Comput. 1, 1972)."""
    index: dict[str, int] = {}
    low: dict[str, int] = {}
    stack: list[str] = []
    found = []

    def visit(v: str) -> None:
        index[v] = low[v] = len(index)
        stack.append(v)
        for w in sorted(graph[v]):
            if w not in index:
                visit(w)
            if w in stack:
                low[v] = min(low[v], low[w])
        if low[v] == index[v]:
            k = stack.index(v)
            if len(stack) - k > 1:
                found.append(sorted(stack[k:]))
            del stack[k:]

    for v in graph:
        if v not in index:
            visit(v)
    return found


@pytest.mark.parametrize("place", ORDER)
def test_imports_come_from_before(place):
    here = [name for name in FILES if room(name + ".") == place]
    allowed = set(ORDER[: ORDER.index(place) + 1])
    later = {name: {i for i in graph()[name] if room(i) not in allowed} for name in here}
    assert here and not {name: found for name, found in later.items() if found}


def folder(name: str) -> str:
    return name.split(".")[2]


@pytest.mark.parametrize("place", INSIDE)
def test_folders_of_a_room_import_those_before(place):
    inside = [n for n in FILES if room(n + ".") == place and n.count(".") > 1 and not n.endswith("__init__")]
    order = [*INSIDE[place], *sorted({folder(n) for n in inside} - set(INSIDE[place]))]
    later = {
        n: up
        for n in inside
        if (up := {i for i in graph()[n] if i in inside and order.index(folder(i)) > order.index(folder(n))})
    }
    assert inside and not later


def test_every_room_has_its_place_in_the_order():
    data = {"stdlib", "grammar"}  # which a wheel has inside the package
    top = {p.stem for p in PACKAGE.iterdir() if p.suffix == ".py" or (p / "__init__.py").exists()} - data
    assert top - {"__init__", "__main__"} == set(ORDER)


def test_no_files_import_each_other_in_a_circle():
    assert [c for c in circles(graph()) if frozenset(c) not in KNOWN] == []
    assert {frozenset(c) for c in circles(graph())} >= KNOWN, "a circle is gone: take it from the list"


CODE = re.compile(r"[EWN]\d{2,4}")


def codes_that_decide(name: str) -> list[int]:
    """Lines in which codes of diagnostics are compared, or looked at by their beginning."""
    text = FILES[name].read_text()
    if not CODE.search(text):
        return []
    tree = ast.parse(text)

    def holds_code(node: ast.AST, named: Collection[str] = ()) -> bool:
        inside = list(ast.walk(node))
        literals = [n.value for n in inside if isinstance(n, ast.Constant) and isinstance(n.value, str)]
        return any(map(CODE.fullmatch, literals)) or any(isinstance(n, ast.Name) and n.id in named for n in inside)

    constants = [n for n in tree.body if isinstance(n, ast.Assign) and holds_code(n.value)]
    named = {target.id for n in constants for target in n.targets if isinstance(target, ast.Name)}
    found = []
    for node in ast.walk(tree):
        begins = isinstance(node, ast.Call) and getattr(node.func, "attr", "") in ("startswith", "endswith")
        if (begins or isinstance(node, ast.Compare)) and holds_code(node, named):
            found.append(node.lineno)
    return found


def test_no_code_of_a_diagnostic_decides_anything():
    """Kinds of errors, `Diagnostic.subject` and `area` do: codes are for people, and the command's exit code."""
    files = [name for name in FILES if room(name + ".") not in ("messages", "cli")]
    assert {name: lines for name in files if (lines := codes_that_decide(name))} == {}
    assert codes_that_decide("lmoc.cli.equivalent")  # the rule finds what is there


def test_dataclasses_come_from_the_room_of_support():
    """Those of the standard library take 0.4 ms each to define, in every run."""
    written = {name: path.read_text() for name, path in FILES.items() if name != "lmoc.support.records"}
    wrong = [
        name for name, text in written.items() if re.search(r"^from dataclasses import .*\bdataclass\b", text, re.M)
    ]
    assert wrong == [], "they import dataclass from dataclasses instead of lmoc.support.records"


# The readers of programs beside the engine: casadi for `dae.functions`, its own integrators, and modes of large scenes.
CASADI = {
    "lmoc.numerics.evaluate.casadi_stepper",
    "lmoc.numerics.evaluate.casadi_system",
    "lmoc.numerics.evaluate.functions",
    "lmoc.numerics.steps.casadi_run",
    "lmoc.numerics.laws.free_dynamics",
    "lmoc.numerics.laws.delassus_update",
}
KERNELS = {  # who makes kernels of tapes; everybody else asks these
    "lmoc.engine.instant",
    "lmoc.engine.kernel",
    "lmoc.numerics.coordinates.entries",
    "lmoc.numerics.coordinates.judge",
    "lmoc.numerics.evaluate.at_points",
    "lmoc.numerics.evaluate.engine_system",
    "lmoc.numerics.evaluate.function",
    "lmoc.numerics.evaluate.observed",
    "lmoc.numerics.evaluate.taylor_system",
    "lmoc.numerics.formulations.landing",
}


def test_there_is_one_way_to_values_of_a_program():
    texts = {name: path.read_text() for name, path in FILES.items()}
    casadi = {name for name, text in texts.items() if re.search(r"^\s*import casadi\b", text, re.M)}
    kernels = {name for name, text in texts.items() if re.search(r"\bKernel\(", text)}
    assert casadi <= CASADI and kernels <= KERNELS
    assert {name for name in FILES if "lmoc.engine.compiler" in graph()[name]} == {"lmoc.engine.accelerator"}


def test_pages_carry_the_engine_of_these_sources():
    found = spec_from_file_location("wasm", PACKAGE.parent / "building" / "wasm.py")
    wasm = module_from_spec(found)
    found.loader.exec_module(wasm)
    assert wasm.DIGEST.read_text().split() == [wasm.digest()], "C that pages run has changed: make wasm"
    assert wasm.BUILT.stat().st_size < 250_000
