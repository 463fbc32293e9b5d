"""The structure of a text: its classes and declarations, and what can be folded."""

from __future__ import annotations

import re
from collections.abc import Iterator

from lmoc.editor.analysis import Analysis
from lmoc.messages.source import Span
from lmoc.support.records import dataclass
from lmoc.syntax import tree
from lmoc.syntax.node import walk

_COMMENT = re.compile(r"/\*.*?\*/|(?:^[ \t]*//[^\n]*\n?){2,}", re.S | re.M)
_STRING = re.compile(r'"(?:[^"\\]|\\.)*"')
_FOLDED = (tree.For, tree.IfEquation, tree.When, tree.ForStatement, tree.IfStatement, tree.WhenStatement,
           tree.WhileStatement)  # fmt: skip


@dataclass(frozen=True)
class Symbol:
    """A class or a declared name.

    Attributes
    ----------
    kind : of a class as it is written; "parameter", "constant", "port" or "component" of a name
    """

    name: str
    kind: str
    detail: str
    span: Span
    name_span: Span
    inside: tuple[Symbol, ...] = ()


def symbols(analysis: Analysis) -> list[Symbol]:
    """Return the classes of a text with what is declared in them."""
    return [_symbol(c) for c in analysis.file.classes]


def _symbol(definition: tree.Class) -> Symbol:
    inside = []
    for e in definition.elements:
        if isinstance(e, tree.Class):
            inside.append(_symbol(e))
        elif isinstance(e, tree.Component):
            kind = e.variability or "component"
            inside.append(Symbol(e.name, kind, str(e.type), e.span, e.name_span))
    return Symbol(definition.name, definition.kind, definition.description, definition.span, definition.name_span,
                  tuple(inside))  # fmt: skip


def folds(analysis: Analysis) -> Iterator[tuple[Span, bool]]:
    """Yield what can be folded, and whether it is a comment."""
    for definition in analysis.classes():
        yield definition.span, False
    for node in walk(analysis.file.classes):
        if isinstance(node, _FOLDED):
            yield node.span, False
    text = analysis.source.text
    hidden = [m.span() for m in _STRING.finditer(text)]
    for m in _COMMENT.finditer(text):
        if not any(a <= m.start() < b for a, b in hidden) and "\n" in m[0].strip():
            yield Span(analysis.source, m.start(), m.start() + len(m[0].rstrip())), True
