"""Sums over long arrays of variables: a variable and a segmented sum instead of one endless expression."""

from __future__ import annotations

from math import prod

import numpy as np

from lmoc.ir.flat import Kind, Sums
from lmoc.messages.source import Span
from lmoc.semantics.classes.predefined import BUILTINS
from lmoc.semantics.drafts.draft import Drafts, equality
from lmoc.semantics.nodes.instance import NOTHING, Variable
from lmoc.semantics.values.context import Context
from lmoc.semantics.values.rows import align, positions
from lmoc.semantics.values.value import Value
from lmoc.support.records import dataclass

LONG = 64  # terms from which a sum gets a variable of its own


@dataclass(frozen=True, eq=False)
class SumDraft:
    """``total[i] = Σ_j part[index[i, j]]`` for every row i."""

    total: Variable
    part: Variable
    index: np.ndarray
    span: Span


class LongSums:
    """The long sums of a model, made while its equations are translated."""

    def __init__(self, drafts: Drafts):
        self.drafts = drafts
        self.sums: list[SumDraft] = []
        self.variables: list[Variable] = []
        self._names: dict[tuple[int, str], int] = {}

    def fits(self, context: Context, array: Value) -> bool:
        """Return whether a sum over this array is long and uniform, in rows that an array of variables can follow."""
        return (
            context.node is not None
            and array.uniform
            and prod(array.dims) >= LONG
            and context.space.whole
            and context.space.shape[: len(context.node.total)] == context.node.total
        )

    def add(self, context: Context, array: Value, span: Span) -> Value:
        """The sum of all elements of an array, as a variable."""
        total = self._variable(context, (), span.text)
        leaf = context.leaves[array.expr.value[0]] if array.expr.op == "slot" else None
        shape = context.space.shape + array.dims
        if leaf is not None and array.expr.value[1] == 0 and leaf.variable is not None:
            part, index = leaf.variable, np.broadcast_to(align(leaf.index, len(shape)), shape)
            total.unit = part.unit
        else:
            part = self._variable(context, array.dims, f"term of {span.text}")
            own = Value(context.leaves.slot(part, positions(part.total)), array.dims)
            self.drafts.groups.extend(equality(context, own, array, span, context.node.owner, "sum"))
            index = positions(part.total)
        rows = prod(context.space.shape)
        self.sums.append(SumDraft(total, part, index.reshape(rows, -1), span))
        at = positions(total.total)
        return Value(context.leaves.slot(total, at if total.total else 0))

    def _variable(self, context: Context, dims: tuple[int, ...], name: str) -> Variable:
        node = context.node
        number = self._names[(id(node), name)] = self._names.get((id(node), name), 0) + 1
        name = name if number == 1 else f"{name} ({number})"
        loops = context.space.shape[len(node.total) :]
        made = Variable(name, node, loops + dims, None, node.scope, True, BUILTINS["Real"], NOTHING)
        made.kind = Kind.UNKNOWN
        self.variables.append(made)
        return made

    def rows(self) -> Sums:
        """The segmented sums, once the variables have their numbers."""
        starts, index, sign, spans, span_of = [np.zeros(1, int)], [], [], [], []
        end = 0
        for draft in self.sums:
            rows, terms = draft.index.shape
            total = (draft.total.offset + np.arange(rows))[:, None]
            index.append(np.hstack([draft.part.offset + draft.index, total]).reshape(-1))
            sign.append(np.tile(np.append(np.ones(terms), -1.0), rows))
            starts.append(end + (terms + 1) * np.arange(1, rows + 1))
            end += (terms + 1) * rows
            span_of.append(np.full(rows, len(spans)))
            spans.append(draft.span)
        if not index:
            return Sums(np.zeros(1, int), np.zeros(0, int), np.zeros(0))
        joined = (np.concatenate(parts) for parts in (starts, index, sign))
        return Sums(*joined, tuple(spans), np.concatenate(span_of))  # type: ignore[call-arg]
