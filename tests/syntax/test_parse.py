"""The parser: precedence as in Modelica 3.6, every construct, and the places of nodes."""

from dataclasses import is_dataclass
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lmoc.messages.diagnostics import Report, render
from lmoc.messages.source import Source, Span
from lmoc.syntax import text, tree
from lmoc.syntax.parse import parse

PROGRAMS = sorted((Path(__file__).parents[2] / "models" / "notes").glob("*.lmo"))


def read(written: str) -> tree.File:
    report = Report()
    file = parse(Source("test.lmo", written), report)
    assert not report.diagnostics, "\n".join(map(render, report.diagnostics))
    return file


def the_class(body: str) -> tree.Class:
    return read(f"model A {body} end A;").classes[0]


def expression(written: str) -> tree.Expression:
    return the_class(f"equation x = {written};").equations[0].right


def grouped(e: tree.Expression) -> str:
    """An expression with parentheses around every operation."""
    match e:
        case tree.Binary():
            return f"({grouped(e.left)} {e.op} {grouped(e.right)})"
        case tree.Unary():
            return f"({e.op} {grouped(e.operand)})"
        case tree.Range():
            return "(" + " : ".join(grouped(p) for p in (e.start, e.step, e.stop) if p is not None) + ")"
        case tree.If():
            cases = [f"{grouped(c)} ? {grouped(v)}" for c, v in e.branches]
            return f"({' | '.join(cases)} | {grouped(e.otherwise)})"
    return text.expression(e)


@pytest.mark.parametrize(
    ("written", "expected"),
    [
        ("a - b - c", "((a - b) - c)"),
        ("a / b * c", "((a / b) * c)"),
        ("a + b * c", "(a + (b * c))"),
        ("-a * b", "(- (a * b))"),
        ("-a^2", "(- (a ^ 2))"),
        ("-a + b", "((- a) + b)"),
        ("a - b^c * d", "(a - ((b ^ c) * d))"),
        ("(a^b)^c", "((a ^ b) ^ c)"),
        ("a^(-b)", "(a ^ (- b))"),
        ("a .* b ./ c .^ d", "((a .* b) ./ (c .^ d))"),
        ("a .+ b .- c", "((a .+ b) .- c)"),
        ("not a and b or c", "(((not a) and b) or c)"),
        ("a or b and c", "(a or (b and c))"),
        ("not a < b", "(not (a < b))"),
        ("a + 1 <= b * 2", "((a + 1) <= (b * 2))"),
        ("a <> b and c == d", "((a <> b) and (c == d))"),
        ("1 : 2 * n : m - 1", "(1 : (2 * n) : (m - 1))"),
        ("if a then b elseif c then d else e + 1", "(a ? b | c ? d | (e + 1))"),
        ("if a then b else if c then d else e", "(a ? b | (c ? d | e))"),
        ("2.*a", "(2. * a)"),
    ],
)
def test_precedence(written: str, expected: str) -> None:
    assert grouped(expression(written)) == expected


@pytest.mark.parametrize(
    ("written", "value", "integer"),
    [("3", 3, True), ("3.", 3, False), (".5", 0.5, False), ("1e-3", 1e-3, False), ("2.5E+2", 250, False)],
)
def test_numbers(written: str, value: float, integer: bool) -> None:
    number = expression(written)
    assert (number.value, number.integer) == (value, integer)


def test_strings_and_quoted_names() -> None:
    assert expression(r'"a\"b\\c\n\t"').value == 'a"b\\c\n\t'
    assert expression('"two\nlines"').value == "two\nlines"
    assert expression("'x y'.b").parts[0].name == "'x y'"


def test_references() -> None:
    e = expression(".a.b[1, :, end - 1].c")
    assert e.absolute and [p.name for p in e.parts] == ["a", "b", "c"]
    first, colon, last = e.parts[1].subscripts
    assert isinstance(colon, tree.Colon) and isinstance(last.left, tree.EndSubscript) and first.value == 1
    assert str(e) == ".a.b[1, :, end - 1].c"


def test_calls_arrays_and_iterators() -> None:
    call = expression("f(1, x, k = 2)")
    assert len(call.arguments) == 2 and [name for name, _ in call.named] == ["k"]
    reduction = expression("sum(i^2 for i in 1:3, j)").arguments[0]
    assert [i.name for i in reduction.indices] == ["i", "j"] and reduction.indices[1].range is None
    assert isinstance(expression("{i for i in 1:3}"), tree.Comprehension)
    assert [len(row) for row in expression("[1, 2; 3, 4]").rows] == [2, 2]
    assert [str(r.function) for r in (expression("der(x)"), expression("initial()"))] == ["der", "initial"]


def test_components() -> None:
    c = the_class(
        "replaceable parameter Real[3] x[2](each start = 1, final unit = \"m\") = y if use \"told\" annotation(a = 1),"
        " z constrainedby Base(k = 2); protected inner flow output Boolean b;"
    )
    x, z, b = c.elements
    assert (x.name, x.variability, x.replaceable, x.description) == ("x", "parameter", True, "told")
    assert [d.value for d in x.dimensions] == [2, 3] and [d.value for d in z.dimensions] == [3]
    assert [(m.name, m.each, m.final) for m in x.modification.arguments] == [
        (("start",), True, False),
        (("unit",), False, True),
    ]
    assert str(x.condition) == "use" and str(x.modification.value) == "y"
    assert str(x.constrained_by) == "Base" and x.constraint.arguments[0].name == ("k",)
    assert x.annotation.arguments[0].name == ("a",) and z.annotation is None
    assert (b.inner, b.flow, b.causality, b.protected, x.protected) == (True, True, "output", True, False)


def test_modifications() -> None:
    c = the_class("A a(b.c(d = 1) = 2, redeclare final Mass m(m = 3), redeclare model M = N(k = 1), replaceable B b);")
    dotted, mass, model, free = c.elements[0].modification.arguments
    assert dotted.name == ("b", "c") and dotted.modification.value.value == 2
    assert mass.final and mass.element.name == "m" and mass.element.redeclare
    assert model.element.kind == "model" and str(model.element.short.base) == "N"
    assert free.element.replaceable and not free.element.redeclare


def test_classes() -> None:
    file = read(
        """within A.B;
        encapsulated partial package P "told"
          import X.Y; import Z = X.Y; import X.*; import X.{a, b};
          type Mass = Real(unit = "kg", min = 0) "mass";
          connector In = input Real[2];
          type Side = enumeration(left "on the left", right);
          extends Base(k = 1);
          annotation(a = 1);
        end P;"""
    )
    assert file.within == ("A", "B")
    (p,) = file.classes
    one, renamed, every, some, mass, signal, side, base = p.elements
    assert (p.encapsulated, p.partial, p.kind, p.description) == (True, True, "package", "told")
    assert (one.path, renamed.alias, every.wildcard, some.names) == (("X", "Y"), "Z", True, ("a", "b"))
    assert str(mass.short.base) == "Real" and mass.description == "mass" and mass.kind == "type"
    assert signal.short.causality == "input" and signal.short.dimensions[0].value == 2
    assert side.literals == ("left", "right") and side.literal_descriptions == ("on the left", "")
    assert str(base.base) == "Base" and p.annotation.arguments[0].name == ("a",)


def test_equations() -> None:
    c = the_class(
        """initial equation x = 0;
        equation
          connect(a.b[1], c) "told";
          (u, , v) = f(x);
          for i in 1:n, j loop x[i] = j; end for;
          if a then x = 1; elseif b then else y = 2; end if;
          when a then reinit(v, 0); elsewhen b then terminate("end"); end when;
          assert(x > 0, "positive");"""
    )
    connect, several, loop, choice, when, check = c.equations
    assert len(c.initial_equations) == 1 and isinstance(c.initial_equations[0], tree.Equality)
    assert str(connect.left) == "a.b[1]" and connect.description == "told"
    assert several.left.items[1] is None
    assert len(loop.indices) == 2 and len(loop.body) == 1
    assert [len(body) for _, body in choice.branches] == [1, 0] and len(choice.otherwise) == 1
    assert len(when.branches) == 2 and isinstance(check, tree.CallEquation)


def test_statements() -> None:
    file = read(
        """function f
          input Real x;
        protected
          Real t;
        initial algorithm
          t := 0;
        algorithm
          (a, , b) := g(x);
          while t < x loop t := t + 1; break; end while;
          for i in 1:3 loop t := i; end for;
          if x > 0 then return; elseif x < 0 then t := 1; else print(t); end if;
          when x > 1 then t := 1; end when;
        end f;"""
    )
    (f,) = file.classes
    kinds = [tree.Assignment, tree.WhileStatement, tree.ForStatement, tree.IfStatement, tree.WhenStatement]
    assert [type(s) for s in f.statements] == kinds
    assert len(f.initial_statements) == 1 and f.elements[1].protected


def nodes(node: object) -> list:
    """A node and all below it."""
    if isinstance(node, tuple):
        return [inner for item in node for inner in nodes(item)]
    if isinstance(node, Span) or not is_dataclass(node):
        return []
    return [node, *(inner for name in node.__slots__ for inner in nodes(getattr(node, name)))]


def test_every_node_covers_its_text() -> None:
    written = "model A\n  parameter Real k(unit = \"N/m\") = 2*(a + b) \"told\";\nequation\n  x = -f(y)[2];\nend A;\n"
    written = written.replace("-f(y)[2]", "-f(y, z = w[2])")
    (a,) = read(written).classes
    k, equation = a.elements[0], a.equations[0]
    assert k.span.text == 'parameter Real k(unit = "N/m") = 2*(a + b) "told"'
    assert k.name_span.text == "k" and k.type.span.text == "Real"
    assert k.modification.span.text == '(unit = "N/m") = 2*(a + b)'
    assert k.modification.value.span.text == "2*(a + b)" and k.modification.value.right.span.text == "a + b"
    assert equation.span.text == "x = -f(y, z = w[2])" and equation.right.operand.function.span.text == "f"
    assert equation.right.operand.named[0][1].parts[0].span.text == "w[2]"
    assert a.span.text == written.rstrip().rstrip(";") and a.name_span.line == 1 and equation.span.line == 4
    for node in nodes(a):
        assert 0 <= node.span.start < node.span.end <= len(written)


def test_an_empty_text_and_one_of_comments() -> None:
    assert read("").classes == () and read("// nothing\n/* at all */").classes == ()


def test_errors_are_in_the_order_of_the_text_and_the_rest_is_understood() -> None:
    report = Report()
    written = "model A\n  Real x\n  Real y;\nequation\n  x := 2 y;\nend B;\nmodel C end C;"
    file = parse(Source("test.lmo", written), report)
    assert [(d.code, d.span.line) for d in report.diagnostics] == [
        ("E0102", 2),
        ("E0107", 5),
        ("E0119", 5),
        ("E0108", 6),
    ]
    assert [c.name for c in file.classes] == ["A", "C"]
    assert [c.name for c in file.classes[0].elements] == ["x", "y"]


NONSENSE = ["model", "{", '"', "end;", "end A;", "model A equation x = (((", "'", "/*", "\\", "x" * 5000]


@pytest.mark.parametrize("written", NONSENSE)
def test_nonsense_is_reported_and_nothing_else(written: str) -> None:
    report = Report()
    parse(Source("test.lmo", written), report)
    assert report.errors and all(d.span is not None and render(d) for d in report.diagnostics)


def test_a_string_over_several_lines_is_no_mistake() -> None:
    assert the_class('Real x "one\ntwo"annotation(a = 1);').elements[0].description == "one\ntwo"


PIECES = list("();{}[]=:+-*/\"'.,#\n\\ 1aθ") + ["end ", "for ", "if ", "/*", "equation ", "model "]

CHANGES = st.tuples(st.integers(0, 10**4), st.integers(0, 8), st.sampled_from(PIECES))  # place, removed, put there


@settings(max_examples=60)
@given(st.sampled_from(PROGRAMS), st.lists(CHANGES, max_size=4))
def test_any_change_of_a_program_is_understood_or_reported(path: Path, changes: list) -> None:
    written = path.read_text(encoding="utf-8")
    for place, removed, piece in changes:
        at = place % (len(written) + 1)
        written = written[:at] + piece + written[at + removed :]
    report = Report()
    file = parse(Source("test.lmo", written), report)
    assert all(d.span is not None and 0 <= d.span.start <= d.span.end <= len(written) for d in report.diagnostics)
    assert all(map(render, report.diagnostics)) and isinstance(file, tree.File)


def test_comments_between_words_that_belong_together() -> None:
    c = the_class("initial /* a */ // b\n equation x[end /* c */] = 1; equation for i in r loop end /* d */ for;")
    assert len(c.initial_equations) == 1
    assert isinstance(c.initial_equations[0].left.parts[0].subscripts[0], tree.EndSubscript)


GOOD = "model Good\n  Real x = 1;\nend Good;\n"


@pytest.mark.parametrize(
    ("wrong", "codes"),
    [
        ("model Bad\n  Real x = 1;\n", ["E0109"]),
        ("model Bad\n  Real x = (1;\nend Bad;\n", ["E0103"]),
        ("model Bad\n  Real x = 1 \"what;\nend Bad;\n", ["E0104"]),
        ("model Bad\n  /* why\nend Bad;\n", ["E0101"]),  # the comment ends where the next one does
        ("model Bad\nequation\n  when x then\nend Bad;\n", ["E0109"]),
    ],
)
def test_a_mistake_stays_in_its_class(wrong, codes):
    report = Report()
    file = parse(Source("test.lmo", GOOD + wrong + "/* behind */\n" + GOOD.replace("Good", "Last")), report)
    assert [c.name for c in file.classes if c.name != "Bad"] == ["Good", "Last"]
    assert [d.code for d in report.diagnostics] == codes
    assert all(len(GOOD) <= d.span.start <= len(GOOD) + len(wrong) for d in report.diagnostics)


def test_lines_that_look_like_classes_and_are_none_divide_nothing():
    hidden = f"model A\n  Real x; /* not yet:\n{GOOD}*/\n/* nor:\n{GOOD}/* */\nmodel Inner\nend Inner;\nend A;\n"
    (whole,) = read(hidden).classes
    assert [e.name for e in whole.elements] == ["x", "Inner"]
    report = Report()
    assert [c.name for c in parse(Source("test.lmo", hidden.replace("x;", "x")), report).classes] == ["A"]
    assert [d.code for d in report.diagnostics] == ["E0102"]
