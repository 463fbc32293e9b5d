"""The syntax tree: what a parsed text says, with the place of every node.

The nodes follow the concrete syntax of the Modelica Language Specification 3.6, appendix A, restricted.
Nothing is looked up or evaluated here.
"""

from __future__ import annotations

from dataclasses import dataclass

from lmoc.source import Span

# ---------------------------------------------------------------- expressions


@dataclass(frozen=True, slots=True)
class Number:
    value: float
    integer: bool
    span: Span


@dataclass(frozen=True, slots=True)
class String:
    value: str
    span: Span


@dataclass(frozen=True, slots=True)
class Boolean:
    value: bool
    span: Span


@dataclass(frozen=True, slots=True)
class RefPart:
    name: str
    subscripts: tuple[Expression, ...]
    span: Span


@dataclass(frozen=True, slots=True)
class Ref:
    """``a.b[2].c``; `absolute` where it starts with a dot."""

    parts: tuple[RefPart, ...]
    absolute: bool
    span: Span

    def __str__(self) -> str:
        return self.span.text.strip()


@dataclass(frozen=True, slots=True)
class Unary:
    op: str  # "-", "+", "not"
    operand: Expression
    span: Span


@dataclass(frozen=True, slots=True)
class Binary:
    op: str  # + - * / ^ .+ .- .* ./ .^ < <= > >= == <> and or
    left: Expression
    right: Expression
    span: Span


@dataclass(frozen=True, slots=True)
class If:
    branches: tuple[tuple[Expression, Expression], ...]  # (condition, value), if and elseif
    otherwise: Expression
    span: Span


@dataclass(frozen=True, slots=True)
class Call:
    function: Ref  # der, sin, initial, pre, ... are ordinary references
    arguments: tuple[Expression, ...]
    named: tuple[tuple[str, Expression], ...]
    span: Span


@dataclass(frozen=True, slots=True)
class ForIndex:
    name: str
    range: Expression | None
    span: Span


@dataclass(frozen=True, slots=True)
class Comprehension:
    """``{e for i in r}``, ``sum(e for i in r)`` (then the argument of a Call)."""

    element: Expression
    indices: tuple[ForIndex, ...]
    span: Span


@dataclass(frozen=True, slots=True)
class Range:
    start: Expression
    step: Expression | None
    stop: Expression
    span: Span


@dataclass(frozen=True, slots=True)
class Array:
    """``{a, b, c}``."""

    items: tuple[Expression, ...]
    span: Span


@dataclass(frozen=True, slots=True)
class Matrix:
    """``[a, b; c, d]``."""

    rows: tuple[tuple[Expression, ...], ...]
    span: Span


@dataclass(frozen=True, slots=True)
class Colon:
    """A subscript ``:``."""

    span: Span


@dataclass(frozen=True, slots=True)
class End:
    """``end`` in a subscript."""

    span: Span


@dataclass(frozen=True, slots=True)
class Tuple:
    """``(a, , b)``: the left side of a call with several results; None where left out."""

    items: tuple[Expression | None, ...]
    span: Span


Expression = (
    Number | String | Boolean | Ref | Unary | Binary | If | Call | Comprehension | Range | Array | Matrix
    | Colon | End | Tuple
)  # fmt: skip

# -------------------------------------------------------------- modifications


@dataclass(frozen=True, slots=True)
class Modification:
    """``(a = 1, b(start = 2)) = value``; either half may be absent."""

    arguments: tuple[Argument, ...]
    value: Expression | None
    span: Span


@dataclass(frozen=True, slots=True)
class ElementModification:
    """``each final m = 2`` or ``spring(k = 3)``."""

    name: tuple[str, ...]
    modification: Modification | None
    each: bool
    final: bool
    description: str
    span: Span


@dataclass(frozen=True, slots=True)
class Redeclaration:
    """``redeclare Spring s(k = 3)`` or ``replaceable ...`` in a modification."""

    element: Component | Class
    each: bool
    final: bool
    span: Span


Argument = ElementModification | Redeclaration

# ----------------------------------------------------------- equations


@dataclass(frozen=True, slots=True)
class Equality:
    left: Expression
    right: Expression
    description: str
    span: Span
    annotation: Modification | None = None


@dataclass(frozen=True, slots=True)
class Connect:
    left: Ref
    right: Ref
    description: str
    span: Span
    annotation: Modification | None = None


@dataclass(frozen=True, slots=True)
class For:
    indices: tuple[ForIndex, ...]
    body: tuple[Equation, ...]
    span: Span
    description: str = ""
    annotation: Modification | None = None


@dataclass(frozen=True, slots=True)
class IfEquation:
    branches: tuple[tuple[Expression, tuple[Equation, ...]], ...]
    otherwise: tuple[Equation, ...]
    span: Span
    description: str = ""
    annotation: Modification | None = None


@dataclass(frozen=True, slots=True)
class When:
    branches: tuple[tuple[Expression, tuple[Equation, ...]], ...]
    span: Span
    description: str = ""
    annotation: Modification | None = None


@dataclass(frozen=True, slots=True)
class CallEquation:
    """``assert(...)``, ``terminate(...)``, ``reinit(...)``."""

    call: Call
    description: str
    span: Span
    annotation: Modification | None = None


Equation = Equality | Connect | For | IfEquation | When | CallEquation

# ------------------------------------------------------------ statements


@dataclass(frozen=True, slots=True)
class Assignment:
    """``x := e`` or ``(a, b) := f(x)``."""

    target: Ref | Tuple
    value: Expression
    span: Span
    description: str = ""
    annotation: Modification | None = None


@dataclass(frozen=True, slots=True)
class IfStatement:
    branches: tuple[tuple[Expression, tuple[Statement, ...]], ...]
    otherwise: tuple[Statement, ...]
    span: Span
    description: str = ""
    annotation: Modification | None = None


@dataclass(frozen=True, slots=True)
class ForStatement:
    indices: tuple[ForIndex, ...]
    body: tuple[Statement, ...]
    span: Span
    description: str = ""
    annotation: Modification | None = None


@dataclass(frozen=True, slots=True)
class WhileStatement:
    condition: Expression
    body: tuple[Statement, ...]
    span: Span
    description: str = ""
    annotation: Modification | None = None


@dataclass(frozen=True, slots=True)
class WhenStatement:
    branches: tuple[tuple[Expression, tuple[Statement, ...]], ...]
    span: Span
    description: str = ""
    annotation: Modification | None = None


@dataclass(frozen=True, slots=True)
class CallStatement:
    call: Call
    span: Span
    description: str = ""
    annotation: Modification | None = None


@dataclass(frozen=True, slots=True)
class Return:
    span: Span
    description: str = ""
    annotation: Modification | None = None


@dataclass(frozen=True, slots=True)
class Break:
    span: Span
    description: str = ""
    annotation: Modification | None = None


Statement = Assignment | IfStatement | ForStatement | WhileStatement | WhenStatement | CallStatement | Return | Break

# ------------------------------------------------------------ declarations


@dataclass(frozen=True, slots=True)
class Component:
    """One declared name (``Real x, y;`` gives two)."""

    name: str
    type: Ref
    dimensions: tuple[Expression, ...]  # those of the type and of the name: Real[2] x[3] gives (3, 2)
    modification: Modification | None
    condition: Expression | None
    description: str
    annotation: Modification | None
    flow: bool
    variability: str  # "", "parameter", "constant", "discrete"
    causality: str  # "", "input", "output"
    inner: bool
    outer: bool
    final: bool
    replaceable: bool
    redeclare: bool
    protected: bool
    constrained_by: Ref | None
    span: Span  # the whole declaration
    name_span: Span
    constraint: Modification | None = None  # the modifiers of `constrained_by`


@dataclass(frozen=True, slots=True)
class Extends:
    base: Ref
    modification: Modification | None
    protected: bool
    span: Span
    description: str = ""
    annotation: Modification | None = None


@dataclass(frozen=True, slots=True)
class Import:
    """``import A.B;`` (alias "", wildcard False), ``import C = A.B;``, ``import A.*;``, ``import A.{b, c};``."""

    path: tuple[str, ...]
    alias: str
    wildcard: bool
    names: tuple[str, ...]
    span: Span
    description: str = ""
    annotation: Modification | None = None


@dataclass(frozen=True, slots=True)
class Class:
    """A class definition; a short one (``type Mass = Real(unit="kg")``) has `short` and no elements."""

    kind: str  # model block connector type record package function class ("operator" ones are not taken)
    name: str
    partial: bool
    encapsulated: bool
    description: str
    elements: tuple[Element, ...]
    equations: tuple[Equation, ...]
    initial_equations: tuple[Equation, ...]
    statements: tuple[Statement, ...]
    initial_statements: tuple[Statement, ...]
    annotation: Modification | None
    short: ShortClass | None
    literals: tuple[str, ...] | None  # of an enumeration
    final: bool
    inner: bool
    outer: bool
    replaceable: bool
    redeclare: bool
    protected: bool
    span: Span
    name_span: Span
    literal_descriptions: tuple[str, ...] = ()
    constrained_by: Ref | None = None
    constraint: Modification | None = None


@dataclass(frozen=True, slots=True)
class ShortClass:
    base: Ref
    dimensions: tuple[Expression, ...]
    modification: Modification | None
    causality: str  # connector RealInput = input Real
    span: Span


Element = Component | Extends | Import | Class


@dataclass(frozen=True, slots=True)
class File:
    """A parsed text: ``within`` and the classes it defines."""

    within: tuple[str, ...]
    classes: tuple[Class, ...]
    span: Span
