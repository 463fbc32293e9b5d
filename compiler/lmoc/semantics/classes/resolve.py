"""From a type name through short class definitions to the class that has elements (Modelica specification, 4.5.1)."""

from __future__ import annotations

from collections.abc import Iterator

from lmoc.semantics.classes.place import Place, Resolved
from lmoc.semantics.classes.predefined import Builtin
from lmoc.semantics.mistakes.wrong import Wrong
from lmoc.syntax import tree


def resolve(found: Place | Builtin) -> Resolved:
    """Follow ``type A = B(...)``, ``connector RealInput = input Real`` and ``type T extends Real`` to the end."""
    steps: list[tuple[tree.ShortClass, Place]] = []
    name = found.name
    kind = "type" if isinstance(found, Builtin) else found.kind
    seen: set[int] = set()
    while not isinstance(found, Builtin):
        definition = found.definition
        found.require_grammar()
        if id(found) in seen:
            raise Wrong("E0208", f"'{found.full_name}' is defined by itself", definition.name_span)
        seen.add(id(found))
        if definition is not None and definition.literals is not None:
            twice = next((t for k, t in enumerate(definition.literals) if t in definition.literals[:k]), None)
            if twice is not None:
                raise Wrong("E0204", f"the literal '{twice}' occurs in '{name}' twice", definition.name_span)
            return Resolved(Builtin(found.full_name, definition.literals), tuple(steps), name, kind)
        if definition is not None and definition.short is not None:
            steps.append((definition.short, found.parent))
            steps += _constraints(found)
            found = found.parent.find_class(definition.short.base)
            continue
        steps += _constraints(found)
        extended = _extended_builtin(found)
        if extended is None:
            break
        clause, inherited = extended
        steps.append((tree.ShortClass(clause.base, (), clause.modification, "", clause.span), found))
        steps += inherited.steps
        found = inherited.base
    return Resolved(found, tuple(steps), name, kind)


def _constraints(scope: Place) -> Iterator[tuple[tree.ShortClass, Place]]:
    """Return the constraints by ``constrainedby`` on a class, and on the classes that this one replaces."""
    definition = scope.definition
    if definition is not None and definition.constraint is not None:
        base, modification = definition.constrained_by, definition.constraint
        yield tree.ShortClass(base, (), modification, "", modification.span), scope.parent
    yield from scope.constraints


def _extended_builtin(scope: Place) -> tuple[tree.Extends, Resolved] | None:
    if scope.definition is None or scope.kind not in ("type", "connector"):
        return None
    return next(((c, b) for c, b in scope.bases if isinstance(b.base, Builtin)), None)
