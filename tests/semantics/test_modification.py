"""Modifications: the outermost wins, `final`, `each`, `extends`, short classes, values from outside."""

import pytest
from oracles.flattening import attribute, codes, equations, flat, flatten_text, mistakes, value

from lmoc.messages.diagnostics import ModelError

NESTED = """
model Inner parameter Real p = 1; parameter Real q = 2*p; end Inner;
model Middle Inner i(p = 2); end Middle;
model Derived extends Middle(i(p = 3)); end Derived;
model Top Derived d%s; end Top;
"""


@pytest.mark.parametrize(("modification", "expected"), [("", 3), ("(i(p = 4))", 4), ("(i.p = 5)", 5)])
def test_the_outermost_wins(modification: str, expected: float) -> None:
    dae = flat(NESTED % modification)
    assert value(dae, "d.i.p") == expected
    assert value(dae, "d.i.q") == 2 * expected


def test_values_from_outside_win_over_all() -> None:
    dae = flat(NESTED % "(i(p = 4))", d__i__p=7)
    assert value(dae, "d.i.p") == 7
    assert value(dae, "d.i.q") == 14
    assert dae.overrides == {"d.i.p": 7}


def test_a_modification_is_evaluated_where_it_is_written() -> None:
    dae = flat("""
        model B parameter Real p = 1; parameter Real x = 10; end B;
        model A parameter Real x = 5; B b(p = x); end A;""")
    assert value(dae, "b.p") == 5


def test_nested_modifications_merge() -> None:
    dae = flat("""
        type Angle = Real(unit = "rad", start = 1);
        model B Angle a(nominal = 4); equation der(a) = 1; end B;
        model A B b(a(start = 2, fixed = true)); end A;""")
    assert attribute(dae, dae.starts, "b.a") == 2
    assert attribute(dae, dae.fixed, "b.a") == 1
    assert attribute(dae, dae.nominals, "b.a") == 4
    assert dae.blocks[0].unit == "rad"


def test_short_classes_carry_modifications_through_extends() -> None:
    dae = flat("""
        model B parameter Real p = 1; parameter Real q = 1; end B;
        model C = B(p = 2, q = 2);
        model D extends C(q = 3); end D;
        model A D d; C c(p = 4); end A;""")
    assert [value(dae, n) for n in ("d.p", "d.q", "c.p", "c.q")] == [2, 3, 4, 2]


def test_final_cannot_be_modified() -> None:
    text = "model B %s; end B; model A B b(p = 2); end A;"
    assert codes(text % "final parameter Real p = 1") == ["E0206"]
    assert codes(
        "model B parameter Real p; end B; model C extends B(final p = 1); end C; model A C c(p = 2); end A;"
    ) == ["E0206"]


def test_each_and_arrays_of_values() -> None:
    dae = flat("model A Mass m[3](each m = 2, g = {1, 2, 3}, q(each start = 5)); end A;")
    assert value(dae, "m.m") == [2, 2, 2]
    assert value(dae, "m.g") == [1, 2, 3]
    assert attribute(dae, dae.starts, "m[2].q") == 5


def test_each_at_the_level_where_it_stands() -> None:
    text = """
        model Inner parameter Real p[2] = {0, 0}; end Inner;
        model Row Inner i[3]; end Row;
        model A parameter Real t[3, 2] = {{1, 2}, {3, 4}, {5, 6}}; Row r[4](%s); end A;"""
    dae = flat(text % "each i(p = t)")
    assert value(dae, "r[4].i[2].p[1]") == 3
    assert value(dae, "r[1].i[3].p") == [5, 6]
    dae = flat(text % "each i(each p = {7, 8})")
    assert value(dae, "r[4].i[2].p") == [7, 8]
    assert codes(text % "i(p = t)") == ["E0302"]


def test_long_arrays_of_values() -> None:
    dae = flat("model A parameter Real s = 2; Mass m[100](m = {s*i for i in 1:100}, each g = s); end A;")
    assert value(dae, "m.m") == [2 * i for i in range(1, 101)]
    assert len([b for b in dae.blocks if b.pattern == "m[1:100].m"]) == 1
    assert value(flat("model A Mass m[50](m = 1:50); end A;"), "m[50].m") == 50


def test_a_value_for_one_element_from_outside() -> None:
    dae = flatten_text(
        "model A Mass m[3](each m = 2, g = {1, 2, 3}); end A;", None, {"m[2].m": 9, "m[1:2].g": 4, "m[3].g": 5}
    )
    assert value(dae, "m.m") == [2, 9, 2]
    assert value(dae, "m.g") == [4, 4, 5]


def test_parameters_are_ordered_by_use() -> None:
    dae = flat("model A parameter Real c = a + b; parameter Real b = 2*a; parameter Real a = 1; end A;")
    assert value(dae, "c") == 3


def test_elements_of_one_array_may_use_each_other() -> None:
    dae = flat("model A parameter Real r[3] = {1, 2*r[1], r[1] + r[2]}; end A;")
    assert value(dae, "r") == [1, 2, 3]


def test_cyclic_bindings_are_named() -> None:
    (error,) = mistakes("model A parameter Real a = b; parameter Real b = c; parameter Real c = a; end A;")
    assert error.code == "E0207"
    assert all(name in error.found for name in "abc")


def test_redeclaration_of_a_replaceable_part() -> None:
    dae = flat("""
        model P1 parameter Real k = 1; end P1;
        model P2 parameter Real k = 2; parameter Real extra = 3; end P2;
        model B replaceable P1 p; end B;
        model A B b(redeclare P2 p(extra = 4)); end A;""")
    assert value(dae, "b.p.k") == 2
    assert value(dae, "b.p.extra") == 4


def test_parameters_without_value_are_kept() -> None:
    dae = flat("model A Mass m; end A;")
    assert value(dae, "m.m") != value(dae, "m.m")  # NaN


def test_unknown_names_from_outside() -> None:
    (error,) = mistakes("model A Mass body(m = 1); end A;", body__n=3)
    assert error.code == "E0622" and "'body.m'" in error.hint
    (error,) = mistakes("model A Mass body(m = 1); end A;", body__q=3)
    assert error.code == "E0622" and "--init body.q=3" in error.hint and error.span.text == "body"


def test_the_value_of_a_variable_is_an_equation() -> None:
    dae = flat("model B Real y; end B; model A Real x[2] = {1, time}; B b[2](y = {3, time}); end A;")
    assert equations(dae, "binding") == ["x[1] = 1", "x[2] = time", "b[1].y = 3", "b[2].y = time"]


def test_redeclaration_of_a_replaceable_class() -> None:
    text = """
        model S1 parameter Real k = 1; end S1;
        model S2 extends S1(k = 2); parameter Real extra = 5; end S2;
        model B replaceable model S = S1; S s[2]; end B;
        model C extends B(redeclare model S = S2(extra = 6)); end C;
        model A B b(redeclare model S = S2); B plain; C c; end A;"""
    dae = flat(text)
    assert value(dae, "b.s.k") == value(dae, "c.s.k") == [2, 2]
    assert value(dae, "plain.s.k") == [1, 1]
    assert value(dae, "c.s.extra") == [6, 6]
    assert codes(text.replace("replaceable ", "")) == ["E0206", "E0206"]


def test_records_as_values() -> None:
    text = """
        record R parameter Real a = 1; parameter Real b = 2*a; end R;
        record V Real x; Real y; end V;
        model B parameter R r; V v; Real z = r.a + v.x; equation v.y = 0; v.x = 3; end B;
        model A parameter R q(a = 5); B b(r = q); B c(r = R(7, b = 8)); V w;
          equation w = b.v; end A;"""
    dae = flat(text)
    assert [value(dae, n) for n in ("b.r.a", "b.r.b", "c.r.a", "c.r.b")] == [5, 10, 7, 8]
    assert "w.y = b.v.y" in equations(dae)


def test_what_is_known_before_the_run() -> None:
    assert codes("model A parameter Real p = time; end A;") == ["E0224"]
    assert codes("model A parameter Real p = x; Real x = 3; end A;") == ["E0224"]
    assert codes("model A Real y(start = x); Real x = 3; equation der(y) = 1; end A;") == ["E0224"]
    assert codes("model A input Real u = x; Real x = 3; end A;") == ["E0224"]


def test_values_of_a_short_class_hold_for_all_elements() -> None:
    dae = flat("""
        model Inner parameter Real p = 0; parameter Real w[2] = {0, 0}; end Inner;
        model Outer Inner i; end Outer;
        model Stiff = Outer(i(p = 5, w = {1, 2}));
        model A Stiff s[3]; Stiff one(i(p = 6)); end A;""")
    assert value(dae, "s.i.p") == [5, 5, 5]
    assert value(dae, "s.i.w") == [1, 2, 1, 2, 1, 2]
    assert value(dae, "one.i.p") == 6


@pytest.mark.parametrize(
    ("name", "given", "code"),
    [("r", "text", "E0301"), ("n", 2.5, "E0301"), ("b", 3, "E0301"), ("r", [1, 2], "E0302"), ("v[7]", 1, "E0215"),
     ("v[1", 1, "E0622"), ("v[1]", "x", "E0301"), ("f", 1, "E0206")],
)  # fmt: skip
def test_values_from_outside_that_do_not_fit(name: str, given, code: str) -> None:
    text = """model A parameter Real r = 1; parameter Integer n = 1; parameter Boolean b = true;
      parameter Real v[2] = {1, 2}; final parameter Real f = 2; end A;"""
    with pytest.raises(ModelError) as error:
        flatten_text(text, None, {name: given})
    assert [d.code for d in error.value.diagnostics] == [code]
    assert value(flatten_text(text, None, {"b": False, "n": 3, "v": [5, 6]}), "v") == [5, 6]


def test_a_record_of_parameters() -> None:
    """`parameter` before a record makes parameters of its fields, nested ones too."""
    text = """record P Real m = 1; Real k = 4; end P; record Q P p; Integer n = 2; end Q;
      model M parameter Q q(p.k = 9); parameter Real s[q.n] = fill(q.p.k*q.p.m, q.n); end M;"""
    assert value(flatten_text(text, "M", {}), "s") == [9, 9]
    assert value(flatten_text(text, "M", {"q.p.m": 3}), "s") == [27, 27]
