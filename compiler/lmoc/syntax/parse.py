"""From a source text to its syntax tree."""

from __future__ import annotations

from lmoc.messages.diagnostics import Diagnostic, Report
from lmoc.messages.source import Source, Span
from lmoc.syntax import tree
from lmoc.syntax.automaton import TooDeep, run
from lmoc.syntax.declarations import Actions
from lmoc.syntax.lexer import scan
from lmoc.syntax.tables import load

MOST_ERRORS = 20  # of one text: beyond them it is no program


def parse(source: Source, report: Report) -> tree.File:
    """The syntax tree of a text.

    Parameters
    ----------
    source : Source
    report : Report
        Takes the first `MOST_ERRORS` syntax errors, in the order of their places.

    Returns
    -------
    tree.File
        What could be understood; all of it where `report` has no new errors.
    """
    tables = load()
    tokens, said = scan(source, tables)
    found = Report()
    try:
        file = run(tables, tokens, Actions(source, found))
        if file is None:
            # Only now is it worth to load what explains and repairs.
            from lmoc.syntax.recovery import repair

            tokens, said = scan(source, tables, doubtful=True)
            found = Report()
            changes, acceptable = repair(source, tables, tokens, tuple(said), MOST_ERRORS)
            said += changes
            if acceptable:
                file = run(tables, tokens, Actions(source, found))
            # What an action says about a place that was repaired is about the repair.
            found = Report([d for d in found.diagnostics if not any(_touch(d.span, change.span) for change in changes)])
    except TooDeep as deep:
        place = Span(source, tokens.starts[deep.at], tokens.ends[deep.at])
        report.diagnostics += [*sorted(said, key=lambda d: d.span.start)[: MOST_ERRORS - 1], _too_deep(place)]
        return _nothing(source)
    said += found.diagnostics
    report.diagnostics += sorted(said, key=lambda d: d.span.start)[:MOST_ERRORS]
    return file or _nothing(source)


def _nothing(source: Source) -> tree.File:
    return tree.File((), (), Span(source, 0, len(source.text)))


def _too_deep(place: Span) -> Diagnostic:
    hint = "name a part of the expression as a variable of its own, or put a part of the class into another one"
    return Diagnostic("E0123", "brackets, branches or classes are nested too deeply here", place, hint=hint)


def _touch(a: Span, b: Span) -> bool:
    return a.start <= b.end and b.start <= a.end
