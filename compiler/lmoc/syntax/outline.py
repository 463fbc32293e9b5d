"""Syntax trees as text."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import fields, is_dataclass

from lmoc.messages.source import Span
from lmoc.syntax.tree import File


def tree_text(files: Iterable[File]) -> str:
    """Return the syntax trees of some files."""
    return "\n".join(line for file in files for line in outline(file))


def outline(root: object) -> Iterator[str]:
    """Yield the lines of a node: its plain attributes on its line, its children below; what is empty is left out."""
    pending: list[tuple[object, str]] = [(root, "")]
    while pending:  # no recursion: a sum of a thousand terms is a thousand deep
        node, lead = pending.pop()
        if isinstance(node, str):
            yield lead + node
            continue
        plain, children = _attributes(node)
        yield f"{lead}{type(node).__name__} {' '.join(map(str, plain))}".rstrip()
        below = [item for name, values in children for item in ((name, "  "), *((v, "    ") for v in values))]
        pending += [(item, lead + indent) for item, indent in reversed(below)]


def _attributes(node: object) -> tuple[list[str], list[tuple[str, list]]]:
    """Return the text of a node's own line, and its children with their headings."""
    plain, children = [], []
    for f in fields(node):
        value = getattr(node, f.name)
        if value is None or value is False or value == () or value == "" or isinstance(value, Span):
            continue
        if is_dataclass(value):
            children.append((f"{f.name}:", [value]))
        elif isinstance(value, tuple) and any(is_dataclass(v) for v in value):
            children.append((f"{f.name}:", [v for v in value if is_dataclass(v)]))
        else:
            plain.append(value if f.name == "name" and isinstance(value, str) else f"{f.name}={value!r}")
    return plain, children
