"""Check a flat model."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lmoc.expression.dag import slots
from lmoc.ir.check.findings import Findings
from lmoc.ir.flat import Assignments, FlatDAE, Group, Kind, Sums
from lmoc.ir.law import Laws


def check_flat(flat: FlatDAE) -> None:
    """Check that indices are in range, columns of one kind, shapes no wider than tables, and bindings in order.

    Raises
    ------
    CorruptStructureError
    """
    findings = Findings()
    if _blocks(flat, findings):
        _parts(flat, findings)
        for name in ("groups", "initial_groups"):
            for number, group in enumerate(getattr(flat, name)):
                _group(flat, group, f"{name}[{number}]", findings)
        _sums(flat, flat.sums, findings)
        for name in ("bindings", "starts", "fixed", "nominals"):
            for number, assignments in enumerate(getattr(flat, name)):
                check_assignments(assignments, flat.count, flat.count, f"{name}[{number}]", findings)
        for number, check in enumerate(flat.checks):
            where = f"checks[{number}]"
            findings.indices(check.slots, 0, flat.count, where, (None, None))
            findings.arity([check.condition], check.slots.shape[1], where)
        for number, decision in enumerate(flat.decisions):
            where = f"decisions[{number}]"
            findings.indices(decision.slots, 0, flat.count, where, (len(decision.held), None))
            findings.arity([decision.condition], decision.slots.shape[1], where)
            findings.require(bool((flat.kind[decision.slots] <= Kind.PARAMETER).all()), where, "it is not known")
        for number, laws in enumerate(flat.laws):
            _laws(flat, laws, f"laws[{number}]", findings)
    if not findings.found:
        _bindings_in_order(flat, findings)
    findings.close(flat)


def _blocks(flat: FlatDAE, findings: Findings) -> bool:
    offset, fits = 0, True
    for number, block in enumerate(flat.blocks):
        where = f"blocks[{number}] ({block.pattern})"
        fits &= findings.require(block.offset == offset, where, f"begins at {block.offset} instead of {offset}")
        size = int(np.prod(block.dims, dtype=np.int64))
        fits &= findings.require(block.size == size, where, f"{block.size} variables, its indices say {size}")
        fits &= findings.require(0 <= block.part < len(flat.parts), where, f"there is no part {block.part}")
        offset += block.size
    return fits


def _parts(flat: FlatDAE, findings: Findings) -> None:
    blocks = len(flat.blocks)
    for number, part in enumerate(flat.parts):
        where = f"parts[{number}] ({part.pattern})"
        findings.require(part.parent < max(number, 1), where, "its parent comes after it")
        ports = [block for port in part.ports for block in port]
        findings.require(all(0 <= b < blocks for b in ports), where, "a port that is no block")


def _group(flat: FlatDAE, group: Group, where: str, findings: Findings) -> None:
    if not findings.indices(group.slots, 0, flat.count, where, (None, None)):
        return
    shapes = (group.left, group.right)
    if not findings.arity(shapes, group.slots.shape[1], where):
        return
    findings.require(0 <= group.part < len(flat.parts), where, f"there is no part {group.part}")
    kinds = findings.one_kind(flat.kind, group.slots, where)
    for leaf in (leaf for shape in shapes for leaf in slots(shape) if kinds and leaf.value[1]):
        changing = kinds[leaf.value[0]] in (Kind.UNKNOWN, Kind.INPUT)
        findings.require(changing, where, f"a derivative of what does not change continuously, column {leaf.value[0]}")


def _sums(flat: FlatDAE, sums: Sums, findings: Findings) -> None:
    findings.indices(sums.index, 0, flat.count, "sums", (None,))
    findings.require(len(sums.sign) == len(sums.index), "sums", "as many signs as terms are needed")
    findings.pointers(sums.start, len(sums.start) - 1, len(sums.index), "sums")
    findings.none(~np.isin(sums.sign, (-1.0, 1.0)), "sums", "a sign that is neither 1 nor -1")
    if len(sums.span_of):
        findings.indices(sums.span_of, -1, len(sums.spans), "sums, span_of", (sums.rows,))


def check_assignments(a: Assignments, targets: int, count: int, where: str, findings: Findings, first: int = 0) -> bool:
    """Check one row of assignments to the variables `first` … `targets` - 1 from those below `count`."""
    if not findings.indices(a.target, first, targets, f"{where}, target", (None,)):
        return False
    rows = len(a.target)
    if a.numbers is not None:
        return findings.require(len(a.numbers) == rows, where, f"{len(a.numbers)} numbers for {rows} variables")
    fits = findings.indices(a.slots, 0, count, where, (rows, None))
    return fits and findings.arity([a.shape], a.slots.shape[1], where)


def _laws(flat: FlatDAE, laws: Laws, where: str, findings: Findings) -> None:
    allowed: dict[str, Sequence[Kind]] = {
        "force": (Kind.UNKNOWN,),
        "restitution": (Kind.CONSTANT, Kind.PARAMETER),
        "friction": (Kind.CONSTANT, Kind.PARAMETER),
        "direction": (Kind.DISCRETE,),
    }
    for name, column in laws.columns().items():
        if findings.indices(column, 0, flat.count, f"{where}.{name}", (laws.rows,)) and name in allowed:
            findings.none(~np.isin(flat.kind[column], allowed[name]), f"{where}.{name}", "variables of the wrong kind")
    findings.require(0 <= laws.part < len(flat.parts), where, f"there is no part {laws.part}")


def _bindings_in_order(flat: FlatDAE, findings: Findings) -> None:
    """Each binding uses only parameters that have been bound before it."""
    bound_at = np.full(flat.count, -1)
    for number, a in enumerate(flat.bindings):
        bound_at[a.target] = number
    for number, a in enumerate(flat.bindings):
        if a.numbers is None:
            late = (bound_at[a.slots] >= number).any(axis=1)
            findings.none(late, f"bindings[{number}]", "uses what is bound later")
