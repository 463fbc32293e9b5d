"""Flat models from short texts, and what the tests of the semantics look at."""

import numpy as np

from lmoc.ir.flat import FlatDAE
from lmoc.messages.diagnostics import Diagnostic, ModelError, Report
from lmoc.messages.source import Source
from lmoc.semantics.flatten import flatten
from lmoc.sources.library import load
from lmoc.syntax.parse import parse


def flat(text: str, model: str | None = None, library: bool = True, **parameters) -> FlatDAE:
    """The flat model of a text; names of parameters with `__` for dots."""
    given = {name.replace("__", "."): value for name, value in parameters.items()}
    return flatten_text(text, model, given, library)


def flatten_text(text: str, model: str | None, parameters: dict, library: bool = True) -> FlatDAE:
    report = Report()
    file = parse(Source("test.lmo", text), report)
    report.check()
    return flatten([file], load() if library else (), model, parameters, report)


def equations(dae: FlatDAE, *origins: str) -> list[str]:
    """All equations in the user's names (of these origins; by default without the ledger)."""
    wanted = origins or ("equation", "binding", "connection", "unconnected")
    return [dae.row_text(g, i) for g in dae.groups if g.origin in wanted for i in range(g.rows)]


def sums(dae: FlatDAE) -> list[str]:
    """The balances of flows, without the ledger."""
    return [t for t in (dae.sum_text(i) for i in range(dae.sums.rows)) if "ledger" not in t]


def value(dae: FlatDAE, name: str) -> float | list[float]:
    """The value of a parameter or constant."""
    index = dae.find(name)
    assert index is not None, f"no variable '{name}'"
    values = dae.parameter_values()[index]
    return float(values[0]) if len(values) == 1 else values.tolist()


def attribute(dae: FlatDAE, assignments, name: str) -> float:
    """What start, fixed or nominal rows say about one variable."""
    known = dae.parameter_values()
    (index,) = dae.find(name)
    found = [a.values(known)[np.flatnonzero(a.target == index)[0]] for a in assignments if index in a.target]
    assert len(found) == 1
    return float(found[0])


def mistakes(text: str, model: str | None = None, **parameters) -> list[Diagnostic]:
    """The errors of a text, which must have some."""
    try:
        flat(text, model, **parameters)
    except ModelError as error:
        return [d for d in error.diagnostics if d.severity == "error"]
    raise AssertionError("no error was found")


def codes(text: str, model: str | None = None, **parameters) -> list[str]:
    return [d.code for d in mistakes(text, model, **parameters)]
