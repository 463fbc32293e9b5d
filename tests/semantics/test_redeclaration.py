"""Redeclarations and what constrains them (Modelica specification, 6.4, 7.3)."""

import pytest
from oracles.flattening import codes, equations, flat, mistakes, value

CLASSES = """
    model E1 parameter Real k = 1; Real y = k; end E1;
    model E2 extends E1; end E2;
    model E3 = E1(k = 7);
    model Other Real y = 0; end Other;
"""
FUNCTIONS = """
    partial function f0 input Real u; output Real y; end f0;
    function f1 extends f0; algorithm y := 2*u; end f1;
    function f2 extends f0; algorithm y := 3*u; end f2;
    function g input Real u; input Real k = 1; output Real y; algorithm y := k*u; end g;
    function h input Real a; input Real b; output Real y; algorithm y := a + b; end h;
"""


@pytest.mark.parametrize(
    ("inside", "use", "k"),
    [
        ("replaceable E1 e constrainedby E1(k = 5);", "S s;", 5),
        ("replaceable E1 e constrainedby E1(k = 5);", "S s(redeclare E2 e);", 5),
        ("replaceable E1 e constrainedby E1(k = 5);", "S s(redeclare E3 e);", 5),
        ("replaceable E1 e constrainedby E1(k = 5);", "S s(redeclare E2 e(k = 6));", 6),
        ("replaceable E1 e(k = 4) constrainedby E1(k = 5);", "S s;", 4),
        ("replaceable E1 e(k = 4) constrainedby E1(k = 5);", "S s(redeclare E2 e);", 5),
        ("replaceable E1 e(k = 4);", "S s(redeclare E2 e);", 4),
        ("replaceable E1 e(k = 4);", "S s(redeclare E2 e, e.k = 8);", 8),
        ("replaceable model E = E1(k = 5); E e;", "S s(redeclare model E = E2);", 5),
        ("replaceable model E = E1(k = 5); E e;", "S s(redeclare model E = E3);", 5),
        ("replaceable model E = E1(k = 5); E e;", "S s(redeclare model E = E2(k = 6));", 6),
        ("replaceable model E = E1(k = 4) constrainedby E1(k = 5); E e;", "S s;", 4),
        ("replaceable model E = E1(k = 4) constrainedby E1(k = 5); E e;", "S s(redeclare model E = E2);", 5),
        ("replaceable model E extends E1(k = 9); end E; E e;", "S s(redeclare model E = E2);", 1),
        ("replaceable model E = E1(k = 5); E e(k = 2);", "S s(redeclare model E = E2);", 2),
    ],
)
def test_modifiers_of_the_constraining_class_hold_after_a_redeclaration(inside: str, use: str, k: float) -> None:
    assert value(flat(f"{CLASSES} model S {inside} end S; model A {use} end A;", "A"), "s.e.k") == k


@pytest.mark.parametrize(
    ("base", "derived", "k"),
    [
        ("replaceable E1 e(k = 4);", "extends S; redeclare E2 e;", 4),
        ("replaceable E1 e(k = 4);", "redeclare E2 e; extends S;", 4),
        ("replaceable E1 e(k = 4);", "extends S; redeclare E2 e(k = 6);", 6),
        ("replaceable E1 e(k = 4);", "extends S(e(k = 3)); redeclare E2 e;", 3),
        ("replaceable E1 e(k = 4) constrainedby E1(k = 5);", "extends S; redeclare E2 e;", 5),
        ("replaceable E1 e(k = 4);", "extends S(redeclare E2 e);", 4),
        ("replaceable model E = E1(k = 4); E e;", "extends S; redeclare model E = E2;", 4),
        ("replaceable model E = E1(k = 4); E e;", "extends S; redeclare model E extends E2(k = 6); end E;", 4),
        ("replaceable model E = E1(k = 4); E e;", "extends S(redeclare model E = E3);", 4),
    ],
)
def test_elements_are_redeclared_in_a_derived_class(base: str, derived: str, k: float) -> None:
    text = f"{CLASSES} model S {base} end S; model N {derived} end N; model A N n; N many[2]; end A;"
    dae = flat(text, "A")
    assert value(dae, "n.e.k") == k
    assert value(dae, "many.e.k") == [k, k]


def test_a_redeclared_class_is_meant_wherever_the_instance_names_it() -> None:
    dae = flat(f"""{CLASSES}
        model S
          replaceable model E = E1;
          model Two E a; E b; end Two;
          E e; E many[2]; Two two;
        end S;
        model T extends S; end T;
        model A S plain; S s(redeclare model E = E2(k = 3)); T t[2](redeclare model E = E3); end A;""", "A")
    assert [value(dae, f"plain.{n}.k") for n in ("e", "two.a")] == [1, 1]
    assert [value(dae, f"s.{n}.k") for n in ("e", "two.a", "two.b")] == [3, 3, 3]
    assert value(dae, "s.many.k") == [3, 3]
    assert value(dae, "t.two.b.k") == [7, 7]


def test_a_redeclaration_uses_names_of_where_it_is_written() -> None:
    dae = flat(f"""{CLASSES}
        model S replaceable model E = E1; E e[2]; end S;
        model A parameter Real p = 6; parameter Integer n = 2;
          S s[n](redeclare model E = E1(k = p)); end A;""", "A")
    assert value(dae, "s.e.k") == [6, 6, 6, 6]


@pytest.mark.parametrize(
    ("inside", "use", "factor"),
    [
        ("replaceable function f = f1;", "E e(redeclare function f = f2);", 3),
        ("replaceable function f = f1;", "E e;", 2),
        ("replaceable function f = f1;", "E e(redeclare function f = g(k = 5));", 5),
        ("replaceable function f = f1;", "E e(redeclare function f = g(k = p));", 7),
        ("replaceable function f = g(k = 5);", "E e;", 5),
        ("replaceable function f = g(k = 5) constrainedby f0;", "E e(redeclare function f = g);", 1),
        ("replaceable function f extends f0; algorithm y := 4*u; end f;", "E e(redeclare function f = f2);", 3),
        ("replaceable function f extends f0; algorithm y := 4*u; end f;", "E e;", 4),
        ("replaceable function f extends f0; algorithm y := 4*u; end f;", "D e;", 3),
        ("replaceable function f = f1;", "D e;", 3),
        ("replaceable function f = f1;", "F e;", 3),
        ("replaceable partial function f = f0;", "E e(redeclare function f = f2);", 3),
    ],
)
def test_redeclared_functions(inside: str, use: str, factor: float) -> None:
    dae = flat(f"""{FUNCTIONS}
        model E {inside} Real x; Real y = f(x); equation x = time; end E;
        model D extends E(redeclare function f = f2); end D;
        model F extends E; redeclare function f = f2; end F;
        model A parameter Real p = 7; {use} end A;""", "A")
    (found,) = (text for text in equations(dae, "binding") if text.startswith("e.y"))
    if "= p" in use:
        assert found == "e.y = p*e.x"
    else:
        assert found == ("e.y = e.x" if factor == 1 else f"e.y = {factor}*e.x")


def test_a_function_of_a_redeclared_package_calls_those_of_that_package() -> None:
    text = """
        partial package Medium
          constant Real c = 1;
          replaceable partial function density input Real p; output Real d; end density;
          function twice input Real p; output Real d; algorithm d := 2*density(p) + c; end twice;
        end Medium;
        package Water extends Medium(c = 10);
          redeclare function density = other;
          function other input Real p; output Real d; algorithm d := 3*p; end other;
        end Water;
        package Oil extends Medium;
          redeclare function density input Real p; output Real d; algorithm d := 5*p; end density;
        end Oil;
        model Pipe replaceable package M = Water constrainedby Medium;
          Real x = time; Real y = M.twice(x); Real z = M.c*x; end Pipe;
        model A Pipe a; Pipe b(redeclare package M = Oil); Pipe c(redeclare package M = Oil(c = 20)); end A;"""
    dae = flat(text, "A")
    found = equations(dae, "binding")
    assert "a.y = 2*(3*a.x) + 10" in found and "a.z = 10*a.x" in found
    assert "b.y = 2*(5*b.x) + 1" in found and "b.z = b.x" in found
    assert "c.y = 2*(5*c.x) + 20" in found


def test_a_package_under_another_name() -> None:
    text = """package P constant Real a = 2; function f input Real x; output Real y; algorithm y := a*x; end f;
                model Q parameter Real k = a; end Q; end P;
              model M package W = P; package V = P(a = 5); parameter Real z = W.a; parameter Real v = V.a;
                parameter Real fz = W.f(1); parameter Real fv = V.f(1); W.Q w; V.Q q;  end M;"""
    dae = flat(text)
    assert [value(dae, n) for n in ("z", "v", "fz", "fv", "w.k", "q.k")] == [2, 5, 2, 5, 2, 5]


@pytest.mark.parametrize(
    ("text", "code"),
    [
        ("model A S s(redeclare Other e); end A;", "E0243"),
        ("model A S s(redeclare model M = Other); end A;", "E0243"),
        ("model N extends S; redeclare Other e; end N; model A N n; end A;", "E0243"),
        ("model N extends S; redeclare model M = Other; end N; model A N n; end A;", "E0243"),
        ("model A S s(redeclare function f = h); end A;", "E0243"),
        ("model A S s(redeclare function f = E1); end A;", "E0243"),
        ("model A S s(redeclare Integer x); end A;", "E0243"),
        ("model A S s(M(k = 3)); end A;", "E0205"),
        ("model A S s(redeclare E2 fixed_); end A;", "E0206"),
        ("model N extends S; redeclare E2 fixed_; end N; model A N n; end A;", "E0206"),
        ("model N extends S; redeclare E2 nothing; end N; model A N n; end A;", "E0205"),
        ("model N extends S; redeclare model Nothing = E2; end N; model A N n; end A;", "E0205"),
        ("model N extends S; E1 e; end N; model A N n; end A;", "E0204"),
        ("model N extends S; model M = E1; end N; model A N n; end A;", "E0204"),
    ],
)
def test_redeclarations_that_mean_nothing(text: str, code: str) -> None:
    assert codes(f"""{CLASSES}{FUNCTIONS}
        model S replaceable E1 e; E1 fixed_; replaceable model M = E1; replaceable function f = f1;
          replaceable parameter Real x = 1; M m; Real y = f(time); end S;
        {text}""", "A") == [code]


def test_the_reason_of_a_refused_redeclaration_names_what_is_missing() -> None:
    (mistake,) = mistakes(f"{CLASSES} model S replaceable E1 e; end S; model A S s(redeclare Other e); end A;", "A")
    assert "'k'" in mistake.message and mistake.span.text == "Other"
    assert [label.span.text for label in mistake.labels] == ["k"]


def test_a_redeclared_component_keeps_the_prefixes_and_the_dimensions() -> None:
    dae = flat("""type Length = Real(unit = "m");
        model S replaceable parameter Real x[2] = {1, 2}; end S;
        model A S s(redeclare Length x); end A;""", "A")
    assert value(dae, "s.x") == [1, 2]
    assert dae.block_at(dae.find("s.x")[0]).unit == "m"


def test_classes_that_extend_each_other_are_refused() -> None:
    assert "E0208" in codes("model B extends C; end B; model C extends B; end C; model A B b; end A;", "A")
    text = "package P extends P.Q; package Q extends P; end Q; model A end A; end P; model M P.A a; end M;"
    assert "E0208" in codes(text, "M")


def test_a_package_can_extend_a_class_inside_of_it() -> None:
    dae = flat("""package P extends P.Icons.Base;
        package Icons package Base constant Real a = 4; end Base; end Icons;
        model Q parameter Real k = a; end Q; end P;
        model A P.Q q; parameter Real b = P.a; end A;""", "A")
    assert [value(dae, n) for n in ("q.k", "b")] == [4, 4]
