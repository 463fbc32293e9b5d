"""The properties that a redeclaration keeps of the declaration it replaces (Modelica specification, 7.3)."""

from __future__ import annotations

from dataclasses import replace

from lmoc.syntax import tree


def constraint_of(element: tree.Component | tree.Class) -> tuple[tree.Ref | None, tree.Modification | None]:
    """Return the constraining class of a replaceable element and its modifiers, which hold after a redeclaration too.

    Without ``constrainedby`` they are those of the declaration itself (7.3.2); a class that is written out constrains
    by itself, and gives None.
    """
    if element.constrained_by is not None:
        return element.constrained_by, element.constraint
    if isinstance(element, tree.Component):
        return element.type, element.modification
    if element.short is not None:
        return element.short.base, element.short.modification
    return None, None


def merged_component(old: tree.Component, new: tree.Component) -> tree.Component:
    """Return the new declaration with the prefixes and dimensions of the old one where it has none of its own."""
    return replace(
        new,
        flow=old.flow or new.flow,
        variability=new.variability or old.variability,
        causality=new.causality or old.causality,
        inner=old.inner or new.inner,
        outer=old.outer or new.outer,
        protected=old.protected,
        dimensions=new.dimensions or old.dimensions,
        condition=new.condition or old.condition,
        description=new.description or old.description,
        annotation=new.annotation or old.annotation,
    )
