"""Values that a caller gives, as exact SymPy expressions. Nothing here evaluates text as Python."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from numbers import Real
from typing import TYPE_CHECKING

from lmoc.expression.to_sympy import exact, lower
from lmoc.ir.flat import FlatDAE
from lmoc.messages.diagnostics import Diagnostic, ModelError, Report
from lmoc.numerics.signals.signal_text import formula_from_text

if TYPE_CHECKING:
    import sympy


def exactly(value: object) -> sympy.Expr:
    """Return a number as the fraction that a person meant, an expression as it is.

    Raises
    ------
    ModelError
        E0621 for anything else; a text is not evaluated.
    """
    import sympy as sp

    if isinstance(value, sp.Expr):
        return value
    if isinstance(value, Real):
        return exact(float(value))
    found = f"{type(value).__name__} {value!r:.60}"
    raise ModelError([Diagnostic("E0621", "a value does not fit", expected="a number or an expression", found=found)])


def read_values(given: Mapping[str, object], flat: FlatDAE) -> dict[str, sympy.Expr]:
    """Return given values as exact expressions; a text is a formula of the language in numbers and parameters.

    Raises
    ------
    ModelError
        E0521 for a text that is no such formula, E0621 for what is neither text nor number nor expression.
    """
    return {name: _formula(name, v, flat) if isinstance(v, str) else _one(name, v) for name, v in given.items()}


def _one(name: str, value: object) -> sympy.Expr:
    try:
        return exactly(value)
    except ModelError:
        found = f"{type(value).__name__} {value!r:.60}"
        expected = "a number or an expression"
        raise ModelError(
            [Diagnostic("E0621", f"the value of '{name}' does not fit", expected=expected, found=found)]
        ) from None


def _formula(name: str, text: str, flat: FlatDAE) -> sympy.Expr:
    import sympy as sp

    report = Report()
    found = formula_from_text(text, flat, name, report)
    report.check()
    shape, variables = found
    value = lower(shape, lambda k, _: sp.Symbol(flat.variable_name(variables[k])))
    if value.has(sp.Symbol("time")):
        message = f"the value of '{name}' changes in time: {text}"
        raise ModelError([Diagnostic("E0521", message, expected="a constant", found=f"'{text}'")])
    return value


class NoValueError(ModelError):
    """A parameter, or an input on which something depends, has no value (E0662)."""


def no_value(missing: Sequence[str], inputs: bool = False) -> NoValueError:
    """Return the error for parameters without a value, or for inputs on which an equilibrium depends, E0662."""
    how = "give it in the model or with `--set name=value`, or use the symbolic form"
    if inputs:
        how = f"give the inputs values: equilibria(inputs={{'{missing[0]}': 0}}), or `--input {missing[0]}=0`"
    hint = f"{how}; what is not a number (0/0) is no value"
    return NoValueError([Diagnostic("E0662", f"no value for {', '.join(missing)}", hint=hint)])
