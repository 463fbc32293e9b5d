"""The syntax tree: what a parsed text says, with the place of every node.

The nodes follow the concrete syntax of the Modelica Language Specification 3.6, appendix A, restricted.
Nothing is looked up or evaluated here.
"""

from __future__ import annotations

from itertools import pairwise

from lmoc.messages.diagnostics import Diagnostic
from lmoc.messages.source import Span
from lmoc.syntax.node import Node, node

# ---------------------------------------------------------------- expressions


@node
class Number(Node):
    """``2``, ``1e-3``; `integer` where written as one."""
    value: float
    integer: bool
    span: Span


@node
class String(Node):
    """``"text"``, escapes replaced."""
    value: str
    span: Span


@node
class Boolean(Node):
    """``true``, ``false``."""
    value: bool
    span: Span


@node
class RefPart(Node):
    """One name of a reference, with its subscripts."""
    name: str
    subscripts: tuple[Expression, ...]
    span: Span


@node
class Ref(Node):
    """``a.b[2].c``; `absolute` where it starts with a dot."""
    parts: tuple[RefPart, ...]
    absolute: bool
    span: Span

    def __str__(self) -> str:
        return self.span.text.strip()


@node
class Unary(Node):
    """An operator before its operand."""
    op: str  # "-", "+", "not"
    operand: Expression
    span: Span


@node
class Binary(Node):
    """An operator between two operands."""
    op: str  # + - * / ^ .+ .- .* ./ .^ < <= > >= == <> and or
    left: Expression
    right: Expression
    span: Span

    def __reduce__(self) -> tuple:
        """A sum of many terms is deep to the left: it is pickled as its first term and what follows."""
        first, then = self, []
        while isinstance(first, Binary):
            then.append((first.op, first.right, first.span))
            first = first.left
        return _chain, (first, then[::-1])


def _chain(first: Expression, then: list[tuple[str, Expression, Span]]) -> Expression:
    for op, right, span in then:
        first = Binary(op, first, right, span)
    return first


@node
class If(Node):
    """``if c then a elseif d then b else e``."""
    branches: tuple[tuple[Expression, Expression], ...]  # (condition, value), if and elseif
    otherwise: Expression
    span: Span


@node
class Call(Node):
    """``f(a, b, k = c)``."""
    function: Ref  # der, sin, initial, pre, ... are ordinary references
    arguments: tuple[Expression, ...]
    named: tuple[tuple[str, Expression], ...]
    span: Span


@node
class ForIndex(Node):
    """``i in r``; without range ``i`` alone."""
    name: str
    range: Expression | None
    span: Span


@node
class Comprehension(Node):
    """``{e for i in r}``, ``sum(e for i in r)`` (then the argument of a Call)."""
    element: Expression
    indices: tuple[ForIndex, ...]
    span: Span


@node
class Range(Node):
    """``a:b``, ``a:step:b``."""
    start: Expression
    step: Expression | None
    stop: Expression
    span: Span


@node
class Array(Node):
    """``{a, b, c}``."""
    items: tuple[Expression, ...]
    span: Span


@node
class Matrix(Node):
    """``[a, b; c, d]``."""
    rows: tuple[tuple[Expression, ...], ...]
    span: Span


@node
class Colon(Node):
    """A subscript ``:``."""
    span: Span


@node
class EndSubscript(Node):
    """``end`` in a subscript."""
    span: Span


@node
class Tuple(Node):
    """``(a, , b)``: the left side of a call with several results; None where left out."""
    items: tuple[Expression | None, ...]
    span: Span


@node
class Field(Node):
    """A field of the record that an expression gives: no syntax, but what the value of a record says of a field."""
    record: Expression
    name: str
    span: Span


Expression = (
    Number | String | Boolean | Ref | Unary | Binary | If | Call | Comprehension | Range | Array | Matrix
    | Colon | EndSubscript | Tuple | Field
)  # fmt: skip

# -------------------------------------------------------------- modifications


@node
class Modification(Node):
    """``(a = 1, b(start = 2)) = value``; either half may be absent."""
    arguments: tuple[Argument, ...]
    value: Expression | None
    span: Span


@node
class ElementModification(Node):
    """``each final m = 2`` or ``spring(k = 3)``."""
    name: tuple[str, ...]
    modification: Modification | None
    each: bool
    final: bool
    description: str
    span: Span


@node
class Redeclaration(Node):
    """``redeclare Spring s(k = 3)`` or ``replaceable ...`` in a modification."""
    element: Component | Class
    each: bool
    final: bool
    span: Span


Argument = ElementModification | Redeclaration

# ----------------------------------------------------------- equations


@node
class Equality(Node):
    """``left = right``."""
    left: Expression
    right: Expression
    description: str
    span: Span
    annotation: Modification | None = None


@node
class Connect(Node):
    """``connect(left, right)``."""
    left: Ref
    right: Ref
    description: str
    span: Span
    annotation: Modification | None = None


@node
class For(Node):
    """``for i in r loop ... end for``."""
    indices: tuple[ForIndex, ...]
    body: tuple[Equation, ...]
    span: Span
    description: str = ""
    annotation: Modification | None = None


@node
class IfEquation(Node):
    """``if c then ... elseif d then ... else ... end if``."""
    branches: tuple[tuple[Expression, tuple[Equation, ...]], ...]
    otherwise: tuple[Equation, ...]
    span: Span
    description: str = ""
    annotation: Modification | None = None


@node
class When(Node):
    """``when c then ... elsewhen d then ... end when``."""
    branches: tuple[tuple[Expression, tuple[Equation, ...]], ...]
    span: Span
    description: str = ""
    annotation: Modification | None = None


@node
class CallEquation(Node):
    """``assert(...)``, ``terminate(...)``, ``reinit(...)``."""
    call: Call
    description: str
    span: Span
    annotation: Modification | None = None


Equation = Equality | Connect | For | IfEquation | When | CallEquation

# ------------------------------------------------------------ statements


@node
class Assignment(Node):
    """``x := e`` or ``(a, b) := f(x)``."""
    target: Ref | Tuple
    value: Expression
    span: Span
    description: str = ""
    annotation: Modification | None = None


@node
class IfStatement(Node):
    """``if c then ... elseif d then ... else ... end if``."""
    branches: tuple[tuple[Expression, tuple[Statement, ...]], ...]
    otherwise: tuple[Statement, ...]
    span: Span
    description: str = ""
    annotation: Modification | None = None


@node
class ForStatement(Node):
    """``for i in r loop ... end for``."""
    indices: tuple[ForIndex, ...]
    body: tuple[Statement, ...]
    span: Span
    description: str = ""
    annotation: Modification | None = None


@node
class WhileStatement(Node):
    """``while c loop ... end while``."""
    condition: Expression
    body: tuple[Statement, ...]
    span: Span
    description: str = ""
    annotation: Modification | None = None


@node
class WhenStatement(Node):
    """``when c then ... elsewhen d then ... end when``."""
    branches: tuple[tuple[Expression, tuple[Statement, ...]], ...]
    span: Span
    description: str = ""
    annotation: Modification | None = None


@node
class CallStatement(Node):
    """A function called for its effect: ``assert(...)``."""
    call: Call
    span: Span
    description: str = ""
    annotation: Modification | None = None


@node
class Return(Node):
    """``return``."""
    span: Span
    description: str = ""
    annotation: Modification | None = None


@node
class Break(Node):
    """``break``."""
    span: Span
    description: str = ""
    annotation: Modification | None = None


Statement = Assignment | IfStatement | ForStatement | WhileStatement | WhenStatement | CallStatement | Return | Break

# ------------------------------------------------------------ declarations


@node
class Component(Node):
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


@node
class Extends(Node):
    """``extends Base(k = 1)``."""
    base: Ref
    modification: Modification | None
    protected: bool
    span: Span
    description: str = ""
    annotation: Modification | None = None


@node
class Import(Node):
    """``import A.B;`` (alias "", wildcard False), ``import C = A.B;``, ``import A.*;``, ``import A.{b, c};``."""
    path: tuple[str, ...]
    alias: str
    wildcard: bool
    names: tuple[str, ...]
    span: Span
    description: str = ""
    annotation: Modification | None = None


@node
class Class(Node):
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
    external: External | None = None
    mistakes: tuple[Diagnostic, ...] = ()  # of the grammar, in its text and in no class inside of it
    sections: tuple[int, ...] = ()  # where, among the statements, further algorithm sections begin
    initial_sections: tuple[int, ...] = ()
    pure: bool = False  # a function that is said to be; all are
    expandable: bool = False  # a connector that gets elements from what is connected to it

    def algorithms(self, initial: bool) -> list[tuple[Statement, ...]]:
        """Return its algorithms, section by section: those that hold at the start only, or the others."""
        statements = self.initial_statements if initial else self.statements
        ends = [0, *(self.initial_sections if initial else self.sections), len(statements)]
        return [statements[a:b] for a, b in pairwise(ends) if a < b]


@node
class External(Node):
    """``external "builtin" y = f(x)``: a function that lmo has itself; without a call, that of the same name."""
    target: Ref | None
    call: Call | None
    span: Span


@node
class ShortClass(Node):
    """The right-hand side of a short class definition."""
    base: Ref
    dimensions: tuple[Expression, ...]
    modification: Modification | None
    causality: str  # connector RealInput = input Real
    span: Span


Element = Component | Extends | Import | Class


@node
class File(Node):
    """A parsed text: ``within`` and the classes it defines."""
    within: tuple[str, ...]
    classes: tuple[Class, ...]
    span: Span
