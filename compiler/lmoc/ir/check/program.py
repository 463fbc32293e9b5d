"""Check a program: every register is written once, and before it is read."""

from __future__ import annotations

import numpy as np

from lmoc.expression.dag import slots
from lmoc.ir.check.findings import Findings
from lmoc.ir.program import Apply, Program, Solve, Step, Total


def check_program(program: Program, filled: np.ndarray, where: str, findings: Findings) -> np.ndarray:
    """Check a program.

    Parameters
    ----------
    filled : (registers,) mask of what is there before the first step

    Returns
    -------
    (registers,) the mask after the last step
    """
    filled = filled.copy()
    for number, step in enumerate(program):
        _step(step, filled, f"{where}[{number}]", findings)
    return filled


def _step(step: Step, filled: np.ndarray, where: str, findings: Findings) -> None:
    if isinstance(step, Solve):
        _solve(step, filled, where, findings)
        return
    if not findings.indices(step.out, 0, len(filled), f"{where}.out", (None,)):
        return
    good = _apply(step, filled, where, findings) if isinstance(step, Apply) else _total(step, filled, where, findings)
    if not good:
        return
    findings.none(filled[step.out], where, "a register that has been written before")
    findings.require(_distinct(step.out), where, "a register that is written twice")
    filled[step.out] = True


def _apply(step: Apply, filled: np.ndarray, where: str, findings: Findings) -> bool:
    if not findings.indices(step.slots, 0, len(filled), where, (len(step.out), None)):
        return False
    leaves = slots(step.shape)
    findings.require(all(leaf.value[1] == 0 for leaf in leaves), where, "a derivative instead of its register")
    if not findings.arity([step.shape], step.slots.shape[1], where):
        return False
    for k in sorted({leaf.value[0] for leaf in leaves}):
        findings.none(~filled[step.slots[:, k]], f"{where}, column {k}", "a register that is read before it is written")
    return True


def _total(step: Total, filled: np.ndarray, where: str, findings: Findings) -> bool:
    if not findings.indices(step.index, 0, len(filled), where, (None,)):
        return False
    findings.require(len(step.coefficient) == len(step.index), where, "a coefficient for every term is needed")
    findings.none(~filled[step.index], where, "a register that is read before it is written")
    return findings.pointers(step.start, len(step.out), len(step.index), where)


def _solve(step: Solve, filled: np.ndarray, where: str, findings: Findings) -> None:
    count = len(filled)
    fits = findings.indices(step.unknowns, 0, count, f"{where}.unknowns", (None, None))
    fits &= findings.indices(step.residuals, 0, count, f"{where}.residuals", step.unknowns.shape)
    if step.guess is not None:
        fits &= findings.indices(step.guess, -1, count, f"{where}.guess", step.unknowns.shape)
    findings.require(step.linear or not step.constant, where, "constant, but not linear")
    if not fits:
        return
    unknowns = step.unknowns.ravel()
    findings.none(filled[unknowns], f"{where}.unknowns", "a register that has been written before")
    findings.require(_distinct(unknowns), f"{where}.unknowns", "a register that is written twice")
    if step.guess is not None:
        given = step.guess[step.guess >= 0]
        findings.none(~filled[given], f"{where}.guess", "a register that is read before it is written")
    before = filled.copy()
    filled[unknowns] = True
    for number, inner in enumerate(step.inner):
        _step(inner, filled, f"{where}.inner[{number}]", findings)
    own = filled & ~before
    own[unknowns] = False
    findings.none(~own[step.residuals.ravel()], f"{where}.residuals", "a residual that the block does not compute")


def _distinct(registers: np.ndarray) -> bool:
    return len(np.unique(registers)) == registers.size
