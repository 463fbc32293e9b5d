"""Trees of files of packages without what is for other tools: a third of them is where symbols and lines stand."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from lmoc.syntax import tree

ENTRIES = frozenset(("__lmoc", "Icon", "Slider", "derivative", "experiment"))  # of annotations, that lmoc reads
_BODIES = ("elements", "equations", "initial_equations", "statements", "initial_statements")


def lean(file: tree.File) -> tree.File:
    """Return a file whose annotations hold what is read of them."""
    return replace(file, classes=tuple(map(_lean, file.classes)))


def _lean(item: Any) -> Any:
    """Return an element of a class, or a class with all its elements."""
    changed: dict[str, object] = {}
    annotation = getattr(item, "annotation", None)
    if annotation is not None:
        read = [a for a in annotation.arguments if not isinstance(a, tree.ElementModification) or a.name[0] in ENTRIES]
        if len(read) < len(annotation.arguments):
            changed["annotation"] = replace(annotation, arguments=tuple(read)) if read else None
    if isinstance(item, tree.Class):
        changed |= {name: tuple(map(_lean, body)) for name in _BODIES if (body := getattr(item, name))}
    return replace(item, **changed) if changed else item
