"""The order of the folders: each imports only those before it."""

import ast
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[1] / "compiler"
BASE = ("source", "diagnostics", "excerpt", "cache", "distinct", "alike")
ORDER = (*BASE, "expression", "syntax", "semantics", "structure", "numerics", "symbolic", "report")


def imported(file: Path) -> set[str]:
    """First parts below `lmoc` of all that a file imports, wherever it does."""
    found = set()
    for node in ast.walk(ast.parse(file.read_text())):
        if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] == "lmoc":
            parts = node.module.split(".")[1:]
            found |= {parts[0]} if parts else {alias.name for alias in node.names}
    return found


@pytest.mark.parametrize("place", ORDER)
def test_imports_come_from_before(place):
    rank = len(BASE) - 1 if place in BASE else ORDER.index(place)
    files = [PACKAGE / f"{place}.py"] if place in BASE else sorted((PACKAGE / place).rglob("*.py"))
    later = {str(f.relative_to(PACKAGE)): imported(f) - set(ORDER[: rank + 1]) for f in files}
    assert files and not {name: found for name, found in later.items() if found}
