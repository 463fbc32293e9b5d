"""Checks of the contents of a class by its kind (Modelica specification, 4.6 and 5.4), and of its imports."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from lmoc.messages.diagnostics import Report
from lmoc.semantics.classes.scope import Scope
from lmoc.semantics.mistakes.wrong import Wrong
from lmoc.semantics.nodes.instance import Instance
from lmoc.syntax import tree

_WITHOUT_EQUATIONS = {
    "connector": "write them in the part that has the connector",
    "record": "write them in the model that has the record",
    "package": "write them in a model",
}


def check_classes(instances: Iterable[Instance], report: Report) -> None:
    """Look at the user's classes that stand behind the instances, their bases and the classes around them."""
    seen: set[int] = set()
    for instance in instances:
        for scope in _behind(instance):
            if id(scope.definition) in seen or scope.library:
                continue
            seen.add(id(scope.definition))
            _check_imports(scope, report)
            _check_sections(scope.definition, report)
            _check_outer(scope.definition, report)


def _behind(instance: Instance) -> Iterator[Scope]:
    for scope in instance.cls.lineage():
        while scope is not None and scope.definition is not None:
            yield scope
            scope = scope.parent


def _check_imports(scope: Scope, report: Report) -> None:
    for element in scope.imports:
        try:
            scope.check_import(element)
        except Wrong as wrong:
            wrong.put_into(report)


def _check_sections(definition: tree.Class, report: Report) -> None:
    sections = (definition.equations, definition.initial_equations, definition.statements)
    for section in (*sections, definition.initial_statements):
        if section and definition.kind in _WITHOUT_EQUATIONS:
            message = f"the {definition.kind} '{definition.name}' cannot have equations"
            report.error("E0226", message, section[0].span, hint=_WITHOUT_EQUATIONS[definition.kind])


def _check_outer(definition: tree.Class, report: Report) -> None:
    for element in definition.elements:
        if isinstance(element, tree.Component) and element.outer and not element.inner and element.modification:
            message = f"'{element.name}' is declared elsewhere, as 'inner': here it cannot be given anything"
            report.error("E0226", message, element.modification.span, hint="modify the 'inner' declaration")
