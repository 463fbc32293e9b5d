"""Every function and operator, given anything: it is understood or refused with a place, never with a traceback."""

import random

import pytest
from oracles.flattening import codes, flat

from lmoc.messages.diagnostics import ModelError
from lmoc.semantics.values.builtins import BUILTIN_FUNCTIONS

ANYTHING = [
    "1", "2.5", "-1", "x", "time", '"s"', "true", "x > 1", "n", "on", "side", "Side.left", "Side", "v", "w", "v[2:3]",
    "{1, 2}", "{x, v[1]}", "zeros(0)", "zeros(0, 3)", "{{1, 2}, {3, 4}}", "[1, 2]", "1:3", 'fill("a", 2)', "part",
    "part.x", "parts", "parts.x", "nothing",
]  # fmt: skip
OPERATORS = ["+", "-", "*", "/", "^", ".*", "./", ".^", ".+", "==", "<", "and", "or"]


def program(*expressions: str) -> str:
    """A model with an equation for each expression, each in a line of its own behind the seventh."""
    return "".join([
        "model A\n  type Side = enumeration(left, right);\n  model Part Real x = 1; end Part;\n",
        "  parameter Integer n = 2; parameter Boolean on = true; parameter Side side = Side.right;\n",
        "  Part part; Part parts[2];\n",
        "  Real x = time; Real v[3] = {1, 2, time}; Real w[2, 2] = {{1, 2}, {3, time}};\n",
        "  // what is tried\n",
        *(f"  Real y{k} = {expression};\n" for k, expression in enumerate(expressions)),
        "end A;",
    ])  # fmt: skip


def expressions() -> list[str]:
    chosen = random.Random(7)

    def anything() -> str:
        return chosen.choice(ANYTHING)

    found = [f"{name}({argument})" for name in BUILTIN_FUNCTIONS for argument in ["", "x = 1", *ANYTHING]]
    found += [f"{name}({anything()}, {anything()})" for name in BUILTIN_FUNCTIONS for _ in range(5)]
    found += [f"{name}({anything()}, {anything()}, {anything()})" for name in BUILTIN_FUNCTIONS for _ in range(2)]
    found += [f"({anything()}) {op} ({anything()})" for op in OPERATORS for _ in range(8)]
    for form in ("if {} then {} else {}", "v[{}] + w[{}, {}]", "{{{}, {}, {}}}", "sum({} for i in {})", "[{}, {}; {}]"):
        found += [form.format(anything(), anything(), anything()) for _ in range(15)]
    return found


def refused(tried: list[str]) -> set[int]:
    """The expressions in which there are mistakes when they stand in one model."""
    try:
        flat(program(*tried), library=False)
    except ModelError as error:
        spans = [d.span for d in error.diagnostics if d.severity == "error"]
        assert all(span is not None and 7 < span.line <= 7 + len(tried) for span in spans), tried
        return {span.line - 8 for span in spans}
    return set()


def test_nothing_ends_in_a_traceback() -> None:
    """Many at a time; those in which nothing is refused are flattened to the end without the others."""
    left, understood = expressions(), 0
    while left:
        tried, left = left[:40], left[40:]
        while wrong := refused(tried):
            tried = [expression for k, expression in enumerate(tried) if k not in wrong]
        understood += len(tried)
    assert understood > 50


@pytest.mark.parametrize(
    ("expression", "code"),
    [
        ("String()", "E0217"),
        ("cat(1, x)", "E0302"),
        ("sum(cat(1, v, w))", "E0302"),
        ("sum(outerProduct(x, v))", "E0302"),
        ("semiLinear(x, \"s\", 1)", "E0301"),
        ("semiLinear(v, 1, 2)", "E0302"),
        ("Integer(2.5)", "E0301"),
        ("Integer(\"s\")", "E0301"),
        ("linspace(\"a\", 2, 3)", "E0301"),
    ],
)  # fmt: skip
def test_what_is_refused(expression: str, code: str) -> None:
    assert codes(program(expression)) == [code]
