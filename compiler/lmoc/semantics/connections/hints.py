"""What may have been meant where the end of a connection is no connector."""

from __future__ import annotations

from lmoc.semantics.mistakes.wrong import NoElement, Wrong
from lmoc.semantics.nodes.instance import Instance, InstanceNode, Variable
from lmoc.semantics.values.context import Context
from lmoc.syntax import tree


def unguessed_port(ref: tree.Ref, wrong: NoElement) -> bool:
    """Return whether it is the name of a port that is unknown, no name in a subscript, and none is like it."""
    return any(part.span == wrong.diagnostic.span for part in ref.parts[1:]) and not wrong.guessed


def no_such_port(context: Context, ref: tree.Ref, node: InstanceNode, wrong: NoElement) -> Wrong:
    """Return what was said, with the ports that there are."""
    for part in ref.parts[1:]:
        if not isinstance(node, Instance) or part.span == wrong.diagnostic.span:
            break
        node = context.model.child(node, part.name)
    found = wrong.diagnostic
    return Wrong(found.code, found.message, found.span, hint=connectors_hint(node) or found.hint)


def connectors_hint(node: InstanceNode) -> str:
    """Return a hint at the connectors of a part."""
    names = _connectors(node)
    return f"its connectors are {', '.join(names)}" if names else ""


def connector_of_hint(variable: InstanceNode | Variable, ref: tree.Ref) -> str:
    """Return a hint at the connectors of the part that a variable belongs to, or at the one it stands in."""
    around, whole = variable.parent, str(ref).rpartition(".")[0]
    if not isinstance(around, Instance) or not whole:
        return ""
    if around.connector:
        return f"connect '{whole}' itself"
    names = _connectors(around)
    return f"the connectors of '{whole}' are {', '.join(names)}" if names else ""


def _connectors(node: InstanceNode) -> list[str]:
    children = node.children.items() if isinstance(node, Instance) else ()
    return [name for name, child in children if isinstance(child, Instance) and child.connector]
