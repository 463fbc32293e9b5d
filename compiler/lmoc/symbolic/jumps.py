"""What jumps: it has other equations on its other side, and no derivative where it jumps."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from typing import TYPE_CHECKING

import numpy as np

from lmoc.expression.dag import postorder
from lmoc.ir.program import Apply, Program, Solve
from lmoc.messages.diagnostics import Diagnostic, ModelError

if TYPE_CHECKING:
    import sympy

SWITCHES = frozenset("if sign floor ceil integer mod rem div_integer xor gt ge lt le eq ne".split())
_NEAR = 1e-9  # of the size of a coordinate, and of 1: what changes on a way so short, and on a shorter one, jumps
_SHORTER = 1e-2
_JUMP = 1e-9  # of the size of the rates, which rounding does not reach


def switches(program: Program, moving: np.ndarray) -> bool:
    """Return whether a program has formulas by cases that change with the registers of a mask."""
    for step in program:
        if isinstance(step, Solve) and switches(step.inner, moving):
            return True
        if isinstance(step, Apply) and any(node.op in SWITCHES for node in postorder(step.shape)):
            if moving[step.slots].any():
                return True
    return False


def jumps_at(rates: Callable[[np.ndarray], np.ndarray], point: np.ndarray) -> int | None:
    """Return the coordinate along which a function jumps at a point, None where there is none."""
    size = np.abs(rates(point)).max(initial=1.0)
    for k in range(len(point)):
        far, near = (_across(rates, point, k, _NEAR * share) for share in (1.0, _SHORTER))
        if np.any((near > 0.5 * far) & (near > _JUMP * size)):
            return k
    return None


def _across(rates: Callable[[np.ndarray], np.ndarray], point: np.ndarray, k: int, share: float) -> np.ndarray:
    step = np.zeros(len(point))
    step[k] = share * max(1.0, abs(point[k]))
    return np.abs(rates(point + step) - rates(point - step))


def has_cases(value: sympy.Expr, moving: Collection[sympy.Symbol]) -> bool:
    """Return whether an expression has other formulas elsewhere, as the moving symbols change."""
    import sympy as sp

    kinds = (sp.sign, sp.floor, sp.ceiling, sp.Mod, sp.Piecewise, sp.Heaviside)
    return value.has(*kinds) and any(e.free_symbols & set(moving) for e in value.atoms(*kinds))


def check_no_jump(values: Collection[sympy.Expr], point: Mapping[sympy.Symbol, sympy.Expr]) -> None:
    """Raise E0663 where one of the expressions jumps at a point."""
    import sympy as sp

    for value in values:
        for e in value.atoms(sp.sign):
            if e.args[0].xreplace(point) == 0 and e.args[0].free_symbols & point.keys():
                raise no_derivative(str(e))
        for e in value.atoms(sp.Piecewise):
            if _between_cases(e, point):
                raise no_derivative(str(e))


def _between_cases(e: sympy.Piecewise, point: Mapping[sympy.Symbol, sympy.Expr]) -> bool:
    """Return whether a point lies on a boundary of cases with different values."""
    import sympy as sp

    boundaries = (r for _, condition in e.args for r in condition.atoms(sp.core.relational.Relational))
    if not any((r.lhs - r.rhs).xreplace(point) == 0 for r in boundaries if r.free_symbols & point.keys()):
        return False
    found = {branch.xreplace(point) for branch, _ in e.args}
    return len(found) > 1


class NoDerivativeError(ModelError):
    """Something has no derivative at a point (E0663)."""


def no_derivative(what: str) -> NoDerivativeError:
    """Return the error for a point at which something jumps."""
    message = f"there is no linear model at this point: {what} jumps there"
    return NoDerivativeError([Diagnostic("E0663", message, hint="choose another point, as `--at name=value`")])


def refuse_remembered(names: list[str], what: str) -> ModelError:
    """Return the error for a derivation that would hold what changes at events."""
    listed = ", ".join(f"'{n}'" for n in names[:4])
    many = len(names) > 1
    verbs = ("depend", "switch") if many else ("depends", "switches")
    message = f"{listed} {verbs[0]} on the past and {verbs[1]} the equations"
    hint = f"{what}: `lmoc linearize --at TIME` takes the equations at a time of the run"
    return ModelError([Diagnostic("E0660", message, hint=hint)])
