"""From a source text to its syntax tree."""

from __future__ import annotations

from lmoc.diagnostics import Report
from lmoc.source import Source, Span
from lmoc.syntax import tree
from lmoc.syntax.automaton import Automaton
from lmoc.syntax.declarations import Actions
from lmoc.syntax.lexer import scan
from lmoc.syntax.tables import load


def parse(source: Source, report: Report) -> tree.File:
    """The syntax tree of a text.

    Parameters
    ----------
    source : Source
    report : Report
        Takes the syntax errors.

    Returns
    -------
    tree.File
        What could be understood; complete where `report` has no new errors.
    """
    tables = load()
    tokens, wrong = scan(source.text, tables)
    for offset in wrong:
        report.error("E0106", f"'{source.text[offset]}' means nothing here", Span(source, offset, offset + 1))
    automaton = Automaton(tables, tokens, Actions(source, report))
    if automaton.run():
        return automaton.values[-1]
    place = Span(source, tokens.starts[automaton.at], tokens.ends[automaton.at])
    report.error("E0101", f"'{place.text}' is not expected here", place)
    return tree.File((), (), Span(source, 0, len(source.text)))
