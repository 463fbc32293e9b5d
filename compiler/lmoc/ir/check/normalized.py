"""Check what linear elimination hands on."""

from __future__ import annotations

import numpy as np

from lmoc.expression.dag import slots
from lmoc.ir.check.findings import Findings
from lmoc.ir.check.flat import check_assignments
from lmoc.ir.flat import Kind
from lmoc.ir.normalized import JetGroup, Normalized


def check_normalized(n: Normalized) -> None:
    """Check the way back to every variable, and that only roots are left in the equations.

    Raises
    ------
    CorruptStructureError
    """
    findings = Findings()
    _derived(n, findings)
    if not findings.found and _way_back(n, findings):
        kind = np.full(n.extended_count, int(Kind.PARAMETER))
        kind[: n.flat.count] = np.where(n.flat.kind == Kind.CONSTANT, Kind.PARAMETER, n.flat.kind)
        for number, group in enumerate(n.groups):
            _group(n, group, kind, f"groups[{number}]", findings)
        _sums(n, findings)
        findings.indices(n.undetermined, 0, n.flat.count, "undetermined", (None,))
    findings.close(n)


def _derived(n: Normalized, findings: Findings) -> None:
    at = n.flat.count
    findings.require(n.values.shape == (at,), "values", f"{n.values.shape} instead of one for each variable")
    for number, a in enumerate(n.derived):
        where = f"derived[{number}]"
        expected = np.arange(at, at + len(a.target))
        findings.require(np.array_equal(a.target, expected), where, "targets are not the next indices")
        check_assignments(a, n.extended_count, at, where, findings, n.flat.count)  # only what has been made before
        at += len(a.target)
    findings.require(at == n.extended_count, "derived_values", f"{n.extended_count} values for {at} extended variables")


def _way_back(n: Normalized, findings: Findings) -> bool:
    count, extended = n.flat.count, n.extended_count
    fits = findings.indices(n.root, 0, extended, "root", (count,))
    fits &= findings.indices(n.order, 0, 64, "order", (count,))
    fits &= findings.indices(n.factor, -2, extended, "factor", (count,))
    fits &= findings.indices(n.offset, -1, extended, "offset", (count,))
    if not fits:
        return False
    unknown = np.zeros(extended, bool)
    unknown[:count] = n.flat.kind == Kind.UNKNOWN
    own = np.append(n.root, np.arange(count, extended))
    findings.none(unknown[n.root] & (own[n.root] != n.root), "root", "a root that has been eliminated itself")
    plain = (n.order == 0) & (n.factor == -1) & (n.offset == -1)
    findings.none((n.root == np.arange(count)) & ~plain, "root", "a variable that differs from itself")
    known = np.ones(extended, bool)
    known[:count] = n.flat.kind <= Kind.PARAMETER
    for name, column in (("factor", n.factor), ("offset", n.offset)):
        findings.none((column >= 0) & ~known[np.maximum(column, 0)], name, "no parameter")
    return not findings.found


def _group(n: Normalized, group: JetGroup, kind: np.ndarray, where: str, findings: Findings) -> None:
    if not findings.indices(group.slots, 0, n.extended_count, where, (None, None)):
        return
    findings.indices(group.source, 0, n.flat.equation_count, f"{where}.source", (group.rows,))
    if not findings.arity([group.residual], group.slots.shape[1], where):
        return
    for k, kind_of_column in enumerate(findings.one_kind(kind, group.slots, where)):
        if kind_of_column == Kind.UNKNOWN:
            column = group.slots[:, k]
            findings.none(n.root[column] != column, f"{where}, column {k}", "a variable that has been eliminated")
        elif kind_of_column != Kind.INPUT:
            still = all(leaf.value[1] == 0 for leaf in slots(group.residual) if leaf.value[0] == k)
            findings.require(still, f"{where}, column {k}", "the derivative of a parameter")


def _sums(n: Normalized, findings: Findings) -> None:
    s = n.sums
    findings.pointers(s.start, s.rows, len(s.index), "sums")
    findings.indices(s.source, 0, n.flat.equation_count, "sums.source", (s.rows,))
    fits = len(s.order) == len(s.coefficient) == len(s.index)
    findings.require(fits, "sums", "orders and coefficients for every term are needed")
    if findings.indices(s.index, 0, n.flat.count, "sums", (None,)):
        findings.none(n.root[s.index] != s.index, "sums", "a variable that has been eliminated")
    findings.none(~np.isfinite(s.coefficient), "sums", "a coefficient that is not finite")
