"""The operators and elementary functions of the language: one table that every reader of the DAG looks in.

An entry says all there is to know of a function, so that a new one is one entry: its value, its derivatives, how numpy,
casadi, C and SymPy write it, which units it takes and gives, where it is defined and how it is spelled. What a library
calls a function is a name in its module, or a callable whose first argument is the module, so that none of them is
imported before it is used.

Functions of what is no number are no number in all of them, whatever `fmin` of C or a simplification would make of it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from enum import Enum
from typing import Any

from lmoc.support.records import dataclass

Lowering = str | Callable[..., Any]


class UnitRule(Enum):
    """The rule for the units of the arguments and of the result."""

    KEPT = "the unit of its argument"
    COMMON = "the arguments have one unit, which is that of the result"
    COMPARED = "the arguments have one unit, the result has none"
    NUMBER = "the argument has no unit, nor has the result"
    NONE = "the result has no unit"
    PRODUCT = "the product of the units"
    QUOTIENT = "the quotient of the units"
    POWER = "the unit to the exponent, which has none"
    ROOT = "the root of the unit"
    CHOICE = "the two values have one unit, which is that of the result"
    UNKNOWN = "nothing is known of it"


class Kind(Enum):
    """The treatment of a function that is called in a model."""

    OPERATOR = "written between or before its arguments"
    SMOOTH = "differentiable where it is defined"
    KINKED = "with a kink or a jump"
    LOGICAL = "true or false"


@dataclass(frozen=True)
class Function:
    """All there is to know of one function.

    Attributes
    ----------
    name : str
        The `op` of its nodes in the DAG.
    arity : int
    value : callable or None
        Of numbers; raises, or is not finite, where it is not defined. None: folded by its constructor in `dag`.
    derivatives : tuple of callables, or None
        One for each argument, ``(of, f, *args) -> expression``: the partial derivative, where f is the node itself and
        ``of(name, *args)`` applies a function. An empty tuple: piecewise constant. None: has a rule in `calculus`.
    numpy, casadi, sympy : str or callable
        A name in the module, or ``(module, *args) -> value``.
    c : str
        The C expression, with ``{0}``, ``{1}`` … for the arguments.
    unit : UnitRule
    kind : Kind
    domain : callable or None
        ``(*args) -> bool``, where it is defined; None: for all finite arguments.
    divides : bool
        It is undefined where its second argument is zero and nowhere else.
    overflows : bool
        It grows so fast that moderate arguments give no finite value.
    spelling : str
        How it is called in a model, where that is not its name.
    """

    name: str
    arity: int
    value: Callable[..., float] | None
    derivatives: tuple[Callable[..., Any], ...] | None
    numpy: Lowering
    casadi: Lowering
    c: str
    sympy: Lowering
    unit: UnitRule = UnitRule.NUMBER
    kind: Kind = Kind.SMOOTH
    domain: Callable[..., bool] | None = None
    divides: bool = False
    overflows: bool = False
    spelling: str = ""

    @property
    def text(self) -> str:
        """Return its name in a model."""
        return self.spelling or self.name

    @property
    def may_give_nan(self) -> bool:
        """Return whether finite arguments of moderate size may give no finite value."""
        return self.domain is not None or self.divides or self.overflows


def resolve(lowering: Lowering, module: Any) -> Callable[..., Any]:
    """The function that a column of the table names, in the imported module."""
    if isinstance(lowering, str):
        found: Callable[..., Any] = getattr(module, lowering)
        return found
    return lambda *args: lowering(module, *args)


def _entry(
    name: str,
    value: Callable[..., float] | None,
    derivative: Callable[..., Any] | tuple[Callable[..., Any], ...] | None,
    *,
    numpy: Lowering = "",
    casadi: Lowering = "",
    c: str = "",
    sympy: Lowering = "",
    **more: Any,
) -> Function:
    """A function of one argument that most libraries call by the same name."""
    derivatives = derivative if derivative is None or isinstance(derivative, tuple) else (derivative,)
    return Function(
        name, 1, value, derivatives, numpy or name, casadi or name, c or f"{name}({{0}})", sympy or name, **more
    )


def _infix(
    name: str, sign: str, unit: UnitRule, derivatives: tuple[Callable[..., Any], ...] | None, **more: Any
) -> Function:
    """Arithmetic, which all libraries write alike."""

    def apply(module: Any, a: Any, b: Any) -> Any:
        return _ARITHMETIC[sign](a, b)

    lowered: dict[str, Any] = {"numpy": apply, "casadi": apply, "sympy": apply, "c": f"{{0}} {sign} {{1}}"} | more
    return Function(name, 2, None, derivatives, unit=unit, kind=Kind.OPERATOR, **lowered)


def _sympy_power(sp: Any, base: Any, exponent: Any) -> Any:
    """A power, exact as far as it can be written down: sympy would work out 2^(10^400) digit by digit."""
    if exponent.is_Rational and abs(exponent) > _LARGEST_EXPONENT:
        exponent = sp.Float(exponent)
    return base**exponent


def _relation(name: str, sign: str, numpy: str, sympy: str, value: Callable[..., Any]) -> Function:
    def apply(module: Any, a: Any, b: Any) -> Any:
        return value(a, b)

    return Function(
        name, 2, value, (), numpy, apply, f"{{0}} {sign} {{1}}", sympy, UnitRule.COMPARED, Kind.LOGICAL
    )  # fmt: skip


_LARGEST_EXPONENT = 1000  # of a power in symbols that stays exact; a double holds 2 to this power, or a little more
_ARITHMETIC: dict[str, Callable[[Any, Any], Any]] = {
    "+": lambda a, b: a + b,
    "-": lambda a, b: a - b,
    "*": lambda a, b: a * b,
    "/": lambda a, b: a / b,
    "^": lambda a, b: a**b,
}


# ------------------------------------------------------- values that a library does not have as they are needed here


def _sign(x: float) -> float:
    return x if math.isnan(x) else float((x > 0) - (x < 0))


def _smaller(x: float, y: float) -> float:
    return math.nan if math.isnan(x) or math.isnan(y) else min(x, y)


def _larger(x: float, y: float) -> float:
    return math.nan if math.isnan(x) or math.isnan(y) else max(x, y)


def _modulo(x: float, y: float) -> float:
    return x - math.floor(x / y) * y


def _quotient(x: float, y: float) -> float:
    return float(math.trunc(x / y))


def _remainder(x: float, y: float) -> float:
    return x - _quotient(x, y) * y


def _word(x: float) -> int:
    return int(math.floor(x)) & 0xFFFFFFFF


def _exclusive_or(x: float, y: float) -> float:
    return float(_word(x) ^ _word(y)) if math.isfinite(x) and math.isfinite(y) else math.nan


def _numpy_exclusive_or(np: Any, x: Any, y: Any) -> Any:
    finite = np.isfinite(x) & np.isfinite(y)
    words = [np.mod(np.floor(np.where(finite, z, 0.0)), 2.0**32).astype(np.uint64) for z in (x, y)]
    return np.where(finite, (words[0] ^ words[1]).astype(float), np.nan)


def _bits_apart(floor: Callable[[Any], Any], x: Any, y: Any) -> Any:
    """The exclusive or where there is none of words: from bit to bit."""
    found = 0 * (x + y)  # no number where one of them is none
    for k in range(32):
        bits = [floor(z / 2.0**k) - 2 * floor(z / 2.0 ** (k + 1)) for z in (x, y)]
        found = found + 2**k * (bits[0] + bits[1] - 2 * bits[0] * bits[1])
    return found


def _numpy_quotient(np: Any, x: Any, y: Any) -> Any:
    return np.trunc(np.divide(x, y))  # two plain numbers too: x / 0 is infinite, not an exception


def _casadi_quotient(ca: Any, a: Any, b: Any) -> Any:
    return ca.sign(a / b) * ca.floor(ca.fabs(a / b))


def _casadi_smaller(ca: Any, a: Any, b: Any) -> Any:
    return ca.if_else(a < b, a, ca.if_else(a >= b, b, ca.SX.nan()))  # fmin of C would drop what is no number


def _casadi_larger(ca: Any, a: Any, b: Any) -> Any:
    return ca.if_else(a > b, a, ca.if_else(a <= b, b, ca.SX.nan()))


def _casadi_divisor(ca: Any, b: Any, value: Any) -> Any:
    """A value that is none where b is zero; casadi would make b·floor(a/b) zero for the number 0."""
    return ca.if_else(b == 0, ca.SX.nan(), value)


def _sympy_quotient(sp: Any, a: Any, b: Any) -> Any:
    return sp.sign(a / b) * sp.floor(sp.Abs(a / b))


def _condition(sp: Any, value: Any) -> Any:
    """A logical value as SymPy's; numbers stand for Boolean parameters."""
    return (sp.true if value != 0 else sp.false) if value.is_Number else value


def _sympy_choice(sp: Any, condition: Any, a: Any, b: Any) -> Any:
    return sp.Piecewise((a, _condition(sp, condition)), (b, True))


def _power_by_base(of: Any, f: Any, base: Any, exponent: Any) -> Any:
    return exponent * base ** (exponent - 1)


def _power_by_exponent(of: Any, f: Any, base: Any, exponent: Any) -> Any:
    return f * of("log", base + of("eq", f, 0 * f))  # 0^n is 0 for all n > 0


def _nothing(*_: Any) -> float:
    return 0.0


def _inside_unit(x: float) -> bool:
    return abs(x) <= 1


# --------------------------------------------------------------------------------------------------------- the table

_ENTRIES = (
    # arithmetic
    _infix("add", "+", UnitRule.COMMON, None, numpy="add"),
    _infix("sub", "-", UnitRule.COMMON, None, numpy="subtract"),
    _infix("mul", "*", UnitRule.PRODUCT, None, numpy="multiply"),
    _infix("div", "/", UnitRule.QUOTIENT, None, numpy="divide", divides=True),
    _infix("pow", "^", UnitRule.POWER, (_power_by_base, _power_by_exponent), numpy="power", c="pow({0}, {1})",
           sympy=_sympy_power, domain=lambda x, y: x > 0 or (y >= 0 if x == 0 else y == int(y))),
    Function("neg", 1, None, None, "negative", lambda ca, x: -x, "-{0}", lambda sp, x: -x,
             UnitRule.KEPT, Kind.OPERATOR),
    Function("if", 3, None, None, "where", "if_else", "{0} ? {1} : {2}", _sympy_choice,
             UnitRule.CHOICE, Kind.OPERATOR),
    # the value of its argument; what jumps in it does so at events (Modelica 3.6, 8.5)
    Function("event", 1, lambda x: x, (lambda of, f, x: 1,), lambda np, x: x, lambda ca, x: x, "{0}",
             lambda sp, x: x, UnitRule.KEPT, Kind.OPERATOR),
    # the value of its first argument; its derivative by time is the second, of which the third is the time: what the
    # annotation `derivative(noDerivative = …)` of a function says (Modelica 3.6, 12.7.1)
    Function("given", 3, None, (lambda of, f, x, rate, t: 1, _nothing, _nothing),
             lambda np, x, rate, t: x, lambda ca, x, rate, t: x, "{0}", lambda sp, x, rate, t: x,
             UnitRule.KEPT, Kind.OPERATOR),
    # Modelica 3.6, 3.7.3: elementary functions
    _entry("sqrt", math.sqrt, lambda of, f, x: 0.5 / f, unit=UnitRule.ROOT, domain=lambda x: x >= 0),
    _entry("sin", math.sin, lambda of, f, x: of("cos", x)),
    _entry("cos", math.cos, lambda of, f, x: -of("sin", x)),
    _entry("tan", math.tan, lambda of, f, x: 1 + f**2, overflows=True),
    _entry("asin", math.asin, lambda of, f, x: 1 / of("sqrt", 1 - x**2), numpy="arcsin", domain=_inside_unit),
    _entry("acos", math.acos, lambda of, f, x: -(1 / of("sqrt", 1 - x**2)), numpy="arccos", domain=_inside_unit),
    _entry("atan", math.atan, lambda of, f, x: 1 / (1 + x**2), numpy="arctan"),
    _entry("sinh", math.sinh, lambda of, f, x: of("cosh", x), overflows=True),
    _entry("cosh", math.cosh, lambda of, f, x: of("sinh", x), overflows=True),
    _entry("tanh", math.tanh, lambda of, f, x: 1 - f**2),
    _entry("asinh", math.asinh, lambda of, f, x: 1 / of("sqrt", x**2 + 1), numpy="arcsinh"),
    _entry("acosh", math.acosh, lambda of, f, x: 1 / (of("sqrt", x - 1) * of("sqrt", x + 1)), numpy="arccosh",
           domain=lambda x: x >= 1),
    _entry("atanh", math.atanh, lambda of, f, x: 1 / (1 - x**2), numpy="arctanh", domain=lambda x: abs(x) < 1),
    _entry("exp", math.exp, lambda of, f, x: f, overflows=True),
    _entry("log", math.log, lambda of, f, x: 1 / x, domain=lambda x: x > 0),
    _entry("log10", math.log10, lambda of, f, x: 1 / math.log(10) / x, domain=lambda x: x > 0,
           sympy=lambda sp, x: sp.log(x, 10)),
    Function("atan2", 2, math.atan2, (lambda of, f, y, x: x / (x**2 + y**2), lambda of, f, y, x: -(y / (x**2 + y**2))),
             "arctan2", "atan2", "atan2({0}, {1})", "atan2", UnitRule.COMPARED),
    # with kinks or jumps
    _entry("abs", abs, lambda of, f, x: of("sign", x), casadi="fabs", c="fabs({0})", sympy="Abs", unit=UnitRule.KEPT,
           kind=Kind.KINKED),
    _entry("sign", _sign, (), c="lmoc_sign({0})", unit=UnitRule.NONE, kind=Kind.KINKED),
    _entry("floor", math.floor, (), unit=UnitRule.KEPT, kind=Kind.KINKED),
    _entry("ceil", math.ceil, (), sympy="ceiling", unit=UnitRule.KEPT, kind=Kind.KINKED),
    _entry("integer", math.floor, (), numpy="floor", casadi="floor", c="floor({0})", sympy="floor",
           unit=UnitRule.KEPT, kind=Kind.KINKED),
    Function("min", 2, _smaller, None, "minimum", _casadi_smaller, "lmoc_min({0}, {1})", "Min", UnitRule.COMMON,
             Kind.KINKED),
    Function("max", 2, _larger, None, "maximum", _casadi_larger, "lmoc_max({0}, {1})", "Max", UnitRule.COMMON,
             Kind.KINKED),
    # x - n·y with n piecewise constant
    Function("mod", 2, _modulo, (lambda of, f, x, y: 1, lambda of, f, x, y: -((x - f) / y)),
             lambda np, x, y: x - np.floor(np.divide(x, y)) * y,
             lambda ca, a, b: _casadi_divisor(ca, b, a - b * ca.floor(a / b)), "lmoc_mod({0}, {1})",
             lambda sp, a, b: a - b * sp.floor(a / b), UnitRule.COMMON, Kind.KINKED, divides=True),
    Function("rem", 2, _remainder, (lambda of, f, x, y: 1, lambda of, f, x, y: -((x - f) / y)),
             lambda np, x, y: x - _numpy_quotient(np, x, y) * y,
             lambda ca, a, b: _casadi_divisor(ca, b, a - b * _casadi_quotient(ca, a, b)), "lmoc_rem({0}, {1})",
             lambda sp, a, b: a - b * _sympy_quotient(sp, a, b), UnitRule.COMMON, Kind.KINKED, divides=True),
    Function("div_integer", 2, _quotient, (), _numpy_quotient, _casadi_quotient, "lmoc_quotient({0}, {1})",
             _sympy_quotient, UnitRule.UNKNOWN, Kind.KINKED, divides=True, spelling="div"),
    # bit by bit of what is whole in them, modulo 2^32: generators of random numbers are made of it
    Function("xor", 2, _exclusive_or, (), _numpy_exclusive_or, lambda ca, x, y: _bits_apart(ca.floor, x, y),
             "lmoc_xor({0}, {1})", lambda sp, x, y: _bits_apart(sp.floor, x, y), UnitRule.NONE, Kind.OPERATOR,
             spelling="__lmoc_xor"),
    # relations and logic
    _relation("lt", "<", "less", "Lt", lambda x, y: x < y),
    _relation("le", "<=", "less_equal", "Le", lambda x, y: x <= y),
    _relation("gt", ">", "greater", "Gt", lambda x, y: x > y),
    _relation("ge", ">=", "greater_equal", "Ge", lambda x, y: x >= y),
    _relation("eq", "==", "equal", "Eq", lambda x, y: x == y),
    _relation("ne", "!=", "not_equal", "Ne", lambda x, y: x != y),
    Function("and", 2, lambda x, y: x != 0 and y != 0, (), "logical_and", "logic_and", "{0} && {1}",
             lambda sp, a, b: sp.And(_condition(sp, a), _condition(sp, b)), UnitRule.NONE, Kind.LOGICAL),
    Function("or", 2, lambda x, y: x != 0 or y != 0, (), "logical_or", "logic_or", "{0} || {1}",
             lambda sp, a, b: sp.Or(_condition(sp, a), _condition(sp, b)), UnitRule.NONE, Kind.LOGICAL),
    Function("not", 1, lambda x: x == 0, (), "logical_not", "logic_not", "!{0}",
             lambda sp, a: sp.Not(_condition(sp, a)), UnitRule.NONE, Kind.LOGICAL),
)  # fmt: skip

FUNCTIONS: dict[str, Function] = {entry.name: entry for entry in _ENTRIES}

UNARY = frozenset(f.name for f in _ENTRIES if f.arity == 1)
BINARY = frozenset(f.name for f in _ENTRIES if f.arity == 2)
RELATIONS = frozenset("lt le gt ge eq ne".split())
LOGICAL = frozenset(f.name for f in _ENTRIES if f.kind is Kind.LOGICAL)
SMOOTH = tuple(f.name for f in _ENTRIES if f.kind is Kind.SMOOTH and f.arity == 1)
# what a model can call by name
CALLABLE = {f.text: f for f in _ENTRIES if f.kind in (Kind.SMOOTH, Kind.KINKED)}
