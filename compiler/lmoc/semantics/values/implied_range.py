"""``for i loop x[i] = 0; end for``: a range that is not written follows from the arrays (specification, 11.2.2.1)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from lmoc.messages.diagnostics import Label
from lmoc.semantics.mistakes.wrong import Wrong
from lmoc.semantics.nodes.instance import InstanceNode
from lmoc.semantics.values.context import Context
from lmoc.semantics.values.reference import find_start, reference, step
from lmoc.syntax import node, tree


def implied_length(context: Context, index: tree.ForIndex, body: object) -> int:
    """The length of the arrays that have the index alone as a subscript in the body; it counts from 1.

    Raises
    ------
    Wrong
        E0211 no array has it as a subscript, E0302 arrays of different lengths have.
    """
    found: list[tuple[int, tree.RefPart]] = []
    for ref, k, axis in _uses(index.name, body):
        dims = _dims(context, ref, k)
        if axis < len(dims):  # else there are too many subscripts, as will be said
            found.append((dims[axis], ref.parts[k]))
    if not found:
        raise Wrong("E0211", f"nothing determines the range of '{index.name}'", index.span,
                    hint=f"write 'for {index.name} in 1:n', or use it as the subscript of an array")  # fmt: skip
    length, first = found[0]
    for other, part in found:
        if other != length:
            labels = (Label(first.span, f"{length} elements"), Label(part.span, f"{other} elements"))
            raise Wrong("E0302", f"'{index.name}' is the subscript of arrays of different lengths", index.span,
                        labels=labels, hint=f"write its range: 'for {index.name} in 1:n'")  # fmt: skip
    return length


def _uses(name: str, body: object) -> Iterator[tuple[tree.Ref, int, int]]:
    """References in which the name alone is a subscript, with the number of the part and of the subscript."""
    pending = [body]
    while pending:
        item = pending.pop()
        if isinstance(item, tuple):
            pending += reversed(item)
        elif isinstance(item, node.Node) and all(i.name != name for i in getattr(item, "indices", ())):
            pending += [getattr(item, field) for field in reversed(item.__slots__)]
        if isinstance(item, tree.Ref):
            for k, part in enumerate(item.parts):
                for axis, subscript in enumerate(part.subscripts):
                    if isinstance(subscript, tree.Ref) and str(subscript) == name:
                        yield item, k, axis


def _dims(context: Context, ref: tree.Ref, k: int) -> tuple[int, ...]:
    """The dimensions of what the first parts of a reference, up to number k, stand for."""
    start = find_start(context, ref) if ref.absolute or ref.parts[0].name not in context.names else None
    if not isinstance(start, InstanceNode):
        whole = replace(ref, parts=(*ref.parts[:k], replace(ref.parts[k], subscripts=())))
        return reference(context, whole).dims
    for part in ref.parts[1 : k + 1]:
        start = step(context, start, part)
    return start.dims
