"""The structure of a text: its classes and declarations, and what can be folded."""

from __future__ import annotations

import re
from collections.abc import Iterator

from lsprotocol import types as lsp

from lmoc.editor.analysis import Analysis
from lmoc.editor.positions import span_range
from lmoc.messages.source import Span
from lmoc.support.records import dataclass
from lmoc.syntax import tree
from lmoc.syntax.node import walk

_COMMENT = re.compile(
    r'(?P<folds>/\*.*?\*/|(?:^[ \t]*//[^\n]*\n?){2,})|//[^\n]*|"(?:[^"\\]|\\.)*"', re.S | re.M
)  # strings, too: what begins in one is none
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
    range: lsp.Range
    name_range: lsp.Range
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
            inside.append(Symbol(e.name, kind, str(e.type), span_range(e.span), span_range(e.name_span)))
    own = span_range(definition.span), span_range(definition.name_span)
    return Symbol(definition.name, definition.kind, definition.description, *own, tuple(inside))


def folds(analysis: Analysis) -> Iterator[tuple[Span, bool]]:
    """Yield what can be folded, and whether it is a comment."""
    for definition in analysis.classes():
        yield definition.span, False
    for node in walk(analysis.file.classes):
        if isinstance(node, _FOLDED):
            yield node.span, False
    for m in _COMMENT.finditer(analysis.source.text):
        if m["folds"] and "\n" in m[0].strip():
            yield Span(analysis.source, m.start(), m.start() + len(m[0].rstrip())), True
