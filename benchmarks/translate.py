"""Translate a casadi function into the expressions of other tools, so that all integrate the same equations.

The instructions of an SX function are a list of scalar operations in order; each becomes one operation elsewhere.
"""

from __future__ import annotations

from collections.abc import Callable


def interpret(function, inputs: list[list], operations: dict[int, Callable], constant: Callable) -> list:
    """Run the instructions of a casadi function ``(t, x) -> rate`` on values of any kind.

    Parameters
    ----------
    function : casadi SX function with one dense output
    inputs : the values at the entries of each input
    operations : {casadi operation: function of one or two values}
    constant : makes a value of a float

    Raises
    ------
    KeyError
        For an operation that is not in the table.
    """
    import casadi as ca

    work: dict[int, object] = {}
    out = [constant(0.0)] * function.nnz_out(0)
    for k in range(function.n_instructions()):
        code, source, target = function.instruction_id(k), function.instruction_input(k), function.instruction_output(k)
        if code == ca.OP_INPUT:
            work[target[0]] = inputs[source[0]][source[1]]
        elif code == ca.OP_OUTPUT:
            out[target[1]] = work[source[0]]
        elif code == ca.OP_CONST:
            work[target[0]] = constant(function.instruction_constant(k))
        else:
            work[target[0]] = operations[code](*(work[i] for i in source))
    return out


def heyoka_system(function) -> list[tuple]:
    """Return the pairs (state, rate) of a casadi function ``(t, x) -> rate`` in heyoka's expressions."""
    import casadi as ca
    import heyoka as hy

    operations = {
        ca.OP_ADD: lambda a, b: a + b, ca.OP_SUB: lambda a, b: a - b, ca.OP_MUL: lambda a, b: a * b,
        ca.OP_DIV: lambda a, b: a / b, ca.OP_NEG: lambda a: -a, ca.OP_SQ: lambda a: a * a, ca.OP_INV: lambda a: 1.0 / a,
        ca.OP_TWICE: lambda a: 2.0 * a, ca.OP_SIN: hy.sin, ca.OP_COS: hy.cos, ca.OP_SQRT: hy.sqrt,
    }  # fmt: skip
    states = [hy.expression(f"x{i}") for i in range(function.nnz_in(1))]
    rates = interpret(function, [[hy.time], states], operations, hy.expression)
    return list(zip(states, rates, strict=True))


def diffsl(function, start) -> str:
    """Return a casadi function ``(t, x) -> rate`` with its start as DiffSL, one line an operation."""
    import casadi as ca

    lines: list[str] = []

    def line(text: str) -> str:
        lines.append(f"w{len(lines)}i {{ {text} }}")
        return f"w{len(lines) - 1}i"

    def binary(sign: str) -> Callable[[str, str], str]:
        return lambda a, b: line(f"{a} {sign} {b}")

    operations = {
        ca.OP_ADD: binary("+"), ca.OP_SUB: binary("-"), ca.OP_MUL: binary("*"), ca.OP_DIV: binary("/"),
        ca.OP_NEG: lambda a: line(f"-{a}"), ca.OP_SQ: lambda a: line(f"{a} * {a}"),
        ca.OP_INV: lambda a: line(f"1.0 / {a}"), ca.OP_TWICE: lambda a: line(f"2.0 * {a}"),
        ca.OP_SIN: lambda a: line(f"sin({a})"), ca.OP_COS: lambda a: line(f"cos({a})"),
        ca.OP_SQRT: lambda a: line(f"sqrt({a})"),
    }  # fmt: skip
    states = [f"x{i}" for i in range(len(start))]
    rates = interpret(function, [["t"], states], operations, lambda c: f"({float(c)!r})")
    state = "u_i {\n" + "\n".join(f"  {x} = {float(s)!r}," for x, s in zip(states, start, strict=True)) + "\n}"
    rate = "F_i {\n" + "\n".join(f"  {r}," for r in rates) + "\n}"
    return "\n".join([state, *lines, rate])
