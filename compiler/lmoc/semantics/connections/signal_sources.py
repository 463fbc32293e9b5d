"""A connection of signals has one source (Modelica specification, 9.3)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from lmoc.messages.diagnostics import Label, Report
from lmoc.semantics.connections.components import components
from lmoc.semantics.drafts.draft import ConnectDraft
from lmoc.semantics.nodes.instance import Variable


class SignalEdge(NamedTuple):
    """Pairs of signals that one connect joins.

    Attributes
    ----------
    ends : the two variables
    index : the indices of their connected elements in the flat model
    gives : whether a signal comes from either of them, as seen from the class with the connect
    """

    connect: ConnectDraft
    ends: tuple[Variable, Variable]
    index: tuple[np.ndarray, np.ndarray]
    gives: tuple[bool, bool]


def check_sources(edges: Sequence[SignalEdge], report: Report) -> None:
    """Report each class in which two signals are connected to each other, be it through a third."""
    by_class: dict[int, list[SignalEdge]] = {}
    for edge in edges:
        by_class.setdefault(id(edge.connect.node), []).append(edge)
    for own in by_class.values():
        clash = _clash(own)
        if clash is not None:
            (first, one), (second, other) = clash
            report.error(
                "E0315",
                f"'{one.label}' and '{other.label}' are both sources of the same connection",
                second.connect.span,
                expected="one output, or one input of the class itself, and else inputs",
                labels=(Label(first.connect.span, f"'{one.label}' is connected here"),) if first is not second else (),
            )


def _clash(edges: Sequence[SignalEdge]) -> tuple[tuple[SignalEdge, Variable], tuple[SignalEdge, Variable]] | None:
    """Two different sources in one set, each with the connect that mentions it."""
    left, right = (np.concatenate([e.index[side] for e in edges]) for side in (0, 1))
    if not len(left):
        return None
    nodes, label, _, _ = components(left, right)
    known: dict[int, tuple[int, SignalEdge, Variable]] = {}  # by set: its source
    for edge in edges:
        for variable, index, gives in zip(edge.ends, edge.index, edge.gives):
            if not gives:
                continue
            for element, number in zip(index.tolist(), label[np.searchsorted(nodes, index)].tolist()):
                source, place, by = known.setdefault(number, (element, edge, variable))
                if source != element:
                    return (place, by), (edge, variable)
    return None
