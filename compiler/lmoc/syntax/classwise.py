"""Mistakes of a text, class by class: one that the grammar refuses harms nothing but itself."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from lmoc.messages.diagnostics import Diagnostic, Report
from lmoc.messages.source import Source
from lmoc.syntax import tree
from lmoc.syntax.parse import parse


def parse_classwise(source: Source, report: Report) -> tree.File:
    """Return the syntax tree of a text in which each class holds the mistakes in its own text.

    A mistake belongs to the innermost class around it. `report` takes those that stand in no class.
    """
    found = Report()
    file = parse(source, found)
    if not found.errors:
        report.diagnostics += found.diagnostics
        return file
    inside, rest = with_mistakes(file, found.diagnostics)
    report.diagnostics += rest
    return inside


def with_mistakes(file: tree.File, mistakes: Sequence[Diagnostic]) -> tuple[tree.File, list[Diagnostic]]:
    """Return a tree in which each class holds the mistakes in its own text, and those that stand in no class."""
    inside, rest = _divided(file.classes, mistakes)
    return replace(file, classes=inside), rest


def _divided(
    classes: Sequence[tree.Class], mistakes: Sequence[Diagnostic]
) -> tuple[tuple[tree.Class, ...], list[Diagnostic]]:
    """The classes with the mistakes in them, and those that are in none of them."""
    result, rest = [], list(mistakes)
    for definition in classes:
        own = [d for d in rest if d.span is not None and _holds(definition, d)]
        rest = [d for d in rest if d not in own]
        result.append(_with_mistakes(definition, own) if own else definition)
    return tuple(result), rest


def _holds(definition: tree.Class, mistake: Diagnostic) -> bool:
    return definition.span.start <= mistake.span.start and mistake.span.end <= definition.span.end


def _with_mistakes(definition: tree.Class, mistakes: list[Diagnostic]) -> tree.Class:
    inner = [e for e in definition.elements if isinstance(e, tree.Class)]
    changed, own = _divided(inner, mistakes)
    new = dict(zip(map(id, inner), changed))
    elements = tuple(new.get(id(e), e) for e in definition.elements)
    return replace(definition, elements=elements, mistakes=tuple(own))
