"""Arrays: one group an equation, index expressions, array arithmetic, long arrays as columns."""

import re

import numpy as np
import pytest
from oracles.flattening import codes, equations, flat, sums, value

from lmoc.semantics import equations as equation_module
from lmoc.semantics.values import array_builtins, constructors


@pytest.fixture
def short_is_long(monkeypatch):
    """Every loop and array constructor takes the way of the long ones."""
    for module in (constructors, equation_module, array_builtins):
        monkeypatch.setattr(module, "WRITTEN_OUT", 0)


def of_model(text: str) -> list[str]:
    return equations(flat(f"model A {text} end A;", library=False))


def test_an_equation_of_an_array_of_parts_is_one_group() -> None:
    dae = flat("model B Real x; equation der(x) = -x; end B; model A B b[2, 3]; end A;", library=False)
    (group,) = [g for g in dae.groups if g.origin == "equation"]
    assert group.rows == 6
    assert equations(dae)[4] == "der(b[2,2].x) = -b[2,2].x"


def test_nested_arrays_of_parts() -> None:
    dae = flat(
        """model In Real x; parameter Real k = 2; equation der(x) = -k*x; end In;
        model Row In i[2]; Real s; equation s = i[1].x + i[2].x; end Row;
        model A Row r[3]; Real t = r[2].i[1].x; Real u[3] = r.s; end A;""",
        library=False,
    )
    found = equations(dae)
    assert "r[3].s = r[3].i[1].x + r[3].i[2].x" in found
    assert "der(r[2].i[1].x) = -r[2].i[1].k*r[2].i[1].x" in found
    assert "t = r[2].i[1].x" in found
    assert "u[3] = r[3].s" in found


LOOP = """
    parameter Integer n = 4; Real x[n]; Real y[n, 2];
  equation
    for i in 1:n loop
      x[i] = 2*i + time;
      for j in 1:2 loop
        y[i, j] = x[n + 1 - i] + j;
      end for;
    end for;
"""


def test_a_loop_is_unrolled_where_it_is_short() -> None:
    found = of_model(LOOP)
    assert "x[3] = 6 + time" in found
    assert "y[4,2] = x[1] + 2" in found
    assert len(found) == 12


def test_a_long_loop_is_one_group_a_equation(short_is_long) -> None:
    dae = flat(f"model A {LOOP} end A;", library=False)
    assert [g.rows for g in dae.groups if g.origin == "equation"] == [4, 8]
    found = equations(dae)
    assert "x[3] = 2*3 + time" in found  # the iteration variable is a column of numbers, named after its values
    assert "y[4,2] = x[1] + 2" in found


def test_loop_in_an_array_of_parts(short_is_long) -> None:
    dae = flat(
        """model B Real x[3]; equation for i in 1:2 loop x[i] = i*x[i + 1]; end for; x[3] = 1; end B;
        model A B b[2]; end A;""",
        library=False,
    )
    assert equations(dae) == [
        "b[1].x[1] = 1*b[1].x[2]", "b[1].x[2] = 2*b[1].x[3]", "b[2].x[1] = 1*b[2].x[2]", "b[2].x[2] = 2*b[2].x[3]",
        "b[1].x[3] = 1", "b[2].x[3] = 1",
    ]  # fmt: skip


def test_whole_arrays_and_slices() -> None:
    found = of_model("Real x[4]; Real y[2]; equation der(x) = -x; y = x[{1, 3}] + 2*x[3:end];")
    assert found[:2] == ["der(x[1]) = -x[1]", "der(x[2]) = -x[2]"]
    assert found[4:] == ["y[1] = x[1] + 2*x[3]", "y[2] = x[3] + 2*x[4]"]


def test_a_row_of_a_matrix() -> None:
    found = of_model("Real m[2, 2] = {{1, 2}, {3, time}}; Real r[2] = m[2, :]; Real c[2] = m[:, 1];")
    assert "r[2] = m[2,2]" in found
    assert "c[2] = m[2,1]" in found


def test_products() -> None:
    found = of_model("""
        parameter Real A[2, 2] = {{1, 2}, {3, 4}}; Real x[2]; Real s; Real B[2, 2];
      equation der(x) = A*x; s = x*x; B = A*A;""")
    assert "der(x[2]) = A[2,1]*x[1] + A[2,2]*x[2]" in found
    assert "s = x[1]*x[1] + x[2]*x[2]" in found
    assert "B[1,2] = A[1,1]*A[1,2] + A[1,2]*A[2,2]" in found


@pytest.mark.parametrize(
    ("expression", "expected"),
    [
        ("sum({1, 2, 3})", 6),
        ("sum(i^2 for i in 1:3)", 14),
        ("product({2, 3, 4})", 24),
        ("max({1, 5, 3})", 5),
        ("min(2, -1)", -1),
        ("size(zeros(2, 3), 2)", 3),
        ("ndims(ones(2, 3))", 2),
        ("sum(linspace(0, 1, 5))", 2.5),
        ("sum(fill(2, 3))", 6),
        ("sum(transpose({{1, 2}, {3, 4}})*{1, 0})", 3),
        ("scalar({{7}})", 7),
        ("sum(vector({{1}, {2}}))", 3),
        ("sum({1, 2} .* {3, 4})", 11),
        ("sum(cross({1, 0, 0}, {0, 1, 0})*{0, 0, 5} for i in 1:2)", 10),
        ("sum(identity(3)*{1, 2, 3})", 6),
        ("sum([1, 2; 3, 4]*{1, 1})", 10),
        ("mod(-1, 3)", 2),
        ("rem(-1, 3)", -1),
        ("div(7, 2)", 3),
        ("integer(-2.5)", -3),
        ("abs(-2) + sign(-3) + floor(2.5) + ceil(2.5)", 6),
        ("atan2(1, 1)*4", np.pi),
        ("if 1 < 2 and not false then 1 else 2", 1),
        ("sum({{1, 2}, {3, 4}}^2*{1, 0})", 22),
        ("noEvent(smooth(0, 3))", 3),
        ("sum({j + 10*i for i in 1:2, j in 1:3}[3, :])", 36),
        ("sum(cat(1, {1, 2}, {3}))", 6),
        ("sum(0:0.5:2)", 5),
        ("sum(10:-5:0)", 15),
    ],
)
def test_array_functions(expression: str, expected: float) -> None:
    if "[3, :]" in expression:
        expression = "sum(p[3, :])"
    dae = flat(
        f"""model A parameter Real p[3, 2] = {{j + 10*i for i in 1:2, j in 1:3}};
        parameter Real v = {expression}; end A;""",
        library=False,
    )
    assert value(dae, "v") == pytest.approx(expected)


def test_the_same_values_the_long_way(short_is_long) -> None:
    dae = flat(
        """model A
          parameter Integer n = 5;
          parameter Real a[n] = {1 + 0.1*i for i in 1:n};
          parameter Real b[n] = 2*a;
          parameter Real c[n] = linspace(0, 1, n);
          parameter Real d[2, n] = {{i*j for i in 1:n} for j in 1:2};
          parameter Real s = sum(a);
        end A;""",
        library=False,
    )
    assert value(dae, "a") == pytest.approx([1.1, 1.2, 1.3, 1.4, 1.5])
    assert value(dae, "b") == pytest.approx([2.2, 2.4, 2.6, 2.8, 3.0])
    assert value(dae, "c") == [0, 0.25, 0.5, 0.75, 1]
    assert value(dae, "d[2,3]") == 6
    assert value(dae, "s") == pytest.approx(6.5)


def test_open_sizes_come_from_the_value() -> None:
    dae = flat("model A parameter Real v[:] = {1, 2, 3}; parameter Integer n = size(v, 1); Real x[n] = v; end A;")
    assert value(dae, "n") == 3
    (block,) = [b for b in dae.blocks if b.pattern == "n"]
    assert block.structural


def test_sizes_follow_values_from_outside() -> None:
    text = "model A parameter Integer n = 2; Mass m[n](each m = 1); end A;"
    assert flat(text, n=5).find("m.q").size == 5


def test_an_array_of_no_elements() -> None:
    dae = flat("model A parameter Integer n = 0; Mass m[n](each m = 1); Real x = 1; end A;")
    assert equations(dae) == ["x = 1"]
    part = "model P input Real u; input Real r[2]; Real y = u + r[1]; end P;"
    dae = flat(f"{part} model A parameter Integer n = 0; P p[n](each u = time, each r = {{1, 2}}); Real x = 1; end A;")
    assert equations(dae) == ["x = 1"]  # no input is missing where there is none


def test_connections_in_a_loop_and_of_whole_arrays() -> None:
    dae = flat("""model A
        Mass m[3](each m = 1); Spring s[2](each k = 1); Damper d[2](each c = 1);
      equation
        for i in 1:2 loop connect(m[i].flange, s[i].a); end for;
        connect(s.b, m[2:3].flange);
        connect(d.a, s.a);
        connect(d.b, s.b);
      end A;""")
    assert "m[2].flange.f + s[2].a.f + s[1].b.f + d[2].a.f + d[1].b.f = 0" in sums(dae)
    assert "m[1].flange.f + s[1].a.f + d[1].a.f = 0" in sums(dae)


def test_wrong_subscripts() -> None:
    assert codes("model A Real x[3]; equation x[4] = 1; x[1] = 2; x[2] = 3; end A;") == ["E0215"]
    assert codes("model A Real x[3]; equation x[1, 2] = 1; end A;") == ["E0216"]
    assert codes("model A Real x; equation x[1] = 1; end A;") == ["E0216"]
    assert codes("model A Real x[2]; equation x = {1, 2, 3}; end A;") == ["E0302"]
    assert codes("model A Real x[2] = {1, 2}; equation x + 1 = x; end A;") == ["E0302"]


def test_loops_whose_rounds_differ_are_unrolled(short_is_long) -> None:
    found = of_model("""
        Real x[4]; Real s[4]; parameter Real c[4] = {sum(i*ones(i)) for i in 1:4};
      equation
        for i in 1:4 loop der(x[i]) = i; s[i] = sum(x[1:i]); end for;""")
    assert "s[3] = x[1] + x[2] + x[3]" in found
    assert sorted(found)[:4] == ["der(x[1]) = 1", "der(x[2]) = 2", "der(x[3]) = 3", "der(x[4]) = 4"]


def test_ends_of_a_loop_by_if_expressions(short_is_long) -> None:
    text = """model A
        parameter Integer n = 5; Real x[n];
        parameter Real d[n] = {if i == 1 then 0 else b[i - 1] for i in 1:n}; parameter Real b[n] = {1, 2, 3, 4, 5};
      equation
        for i in 1:n loop
          der(x[i]) = (if i > 1 then x[i - 1] else 0) - 2*x[i] + (if i < n then x[i + 1] else 0);
        end for;
      end A;"""
    dae = flat(text, library=False)
    found = equations(dae)
    assert "der(x[1]) = -2*x[1] + (if 1 < n then x[2] else 0)" in found
    assert "der(x[3]) = x[2] - 2*x[3] + x[4]" in found
    assert "der(x[5]) = x[4] - 2*x[5]" in found
    assert sorted(g.rows for g in dae.groups if g.origin == "equation") == [1, 1, 3]
    assert value(dae, "d") == [0, 1, 2, 3, 4]
    assert codes(text.replace("i > 1", "i > 0")) == ["E0215"]


def test_a_long_sum_is_a_variable_of_its_own() -> None:
    dae = flat("""model A
        parameter Integer n = 200; Mass m[n](each m = 2);
        output Real E(unit = "J") = sum(m.energy);
        output Real T = sum(m[i].m*m[i].v^2/2 for i in 1:n);
        parameter Real total = sum(m.m);
      end A;""")
    found = equations(dae, "binding")
    assert "E = sum(m.energy)" in found
    assert value(dae, "total") == 400
    texts = [t for t in (dae.sum_text(i) for i in range(dae.sums.rows)) if "ledger" not in t]
    assert len(texts) == 2
    assert texts[0].startswith("m[1].energy + m[2].energy + ") and texts[0].endswith("- sum(m.energy) = 0")
    unknowns = sum(b.size for b in dae.blocks if b.kind == 3)
    assert unknowns == dae.equation_count
    assert max(g.slots.shape[1] for g in dae.groups) < 10


def test_an_array_of_parts_means_the_same_as_parts_one_by_one() -> None:
    """The same ladder twice: with arrays, and with every part declared and connected by itself."""
    rungs = 18  # long enough for loops to stay loops
    arrays = f"""model A
        Fixed w; Mass m[{rungs}](m = {{0.5*i for i in 1:{rungs}}}, each g = 2); Ladder l[{rungs}](each s.k = 3);
      equation
        for i in 1:{rungs} loop connect(l[i].b, m[i].flange); end for;
        connect(w.flange, l[1].a);
        for i in 2:{rungs} loop connect(l[i].a, m[i - 1].flange); end for;
      end A;"""
    each = range(1, rungs + 1)
    single = "model A Fixed w;" + "".join(f"Mass m_{i}(m = {0.5 * i}, g = 2);" for i in each)
    single += "".join(f"Ladder l_{i}(s.k = 3);" for i in each) + "equation connect(w.flange, l_1.a);"
    single += "".join(f"connect(l_{i}.b, m_{i}.flange);" for i in each)
    single += "".join(f"connect(l_{i}.a, m_{i - 1}.flange);" for i in each if i > 1) + "end A;"
    ladder = """
        model Ladder Flange a, b; Spring s(k = 1); Damper d[2](c = {4, 5});
        equation
          connect(a, s.a); connect(s.b, b);
          for i in 1:2 loop connect(a, d[i].a); connect(d[i].b, b); end for;
        end Ladder;"""
    texts = []
    for text in (arrays, single):
        dae = flat(text + ladder)
        found = equations(dae, "equation", "binding", "unconnected") + sums(dae) + potentials(dae)
        texts.append(sorted(re.sub(r"\b([ml])\[(\d+)\]", r"\1_\2", t) for t in found))
        assert dae.equation_count == sum(b.size for b in dae.blocks if b.kind == 3)
        assert value(dae, "m.m" if "m[" in text else "m_3.m") == ([0.5 * i for i in each] if "m[" in text else 1.5)
    arrays_texts, single_texts = ([normal(t) for t in found] for found in texts)
    assert sorted(arrays_texts) == sorted(single_texts)


def potentials(dae) -> list[str]:
    """The sets of equal potentials, each as one text."""
    sets: dict[str, set[str]] = {}
    for text in equations(dae, "connection"):
        left, right = text.split(" = ")
        joined = sets.get(left, {left}) | sets.get(right, {right})
        for name in joined:
            sets[name] = joined
    return ["equal: " + " ".join(sorted(s)) for s in {id(s): s for s in sets.values()}.values()]


def normal(text: str) -> str:
    """Terms and members in an order of their own."""
    if text.startswith("equal: "):
        return "equal: " + " ".join(sorted(text.removeprefix("equal: ").split()))
    if text.endswith(" = 0") and "*" not in text:
        return " ".join(sorted(re.findall(r"[+-]? ?[\w\[\].]+", "+ " + text.removesuffix(" = 0"))))
    return text


def test_the_size_of_an_array_of_parts() -> None:
    dae = flat("""model A parameter Integer n = size(m, 1); Mass m[2, 3](each m = 1); Real x = ndims(m);
      Real y[size(m, 2)] = m[end, :].q; end A;""")
    assert value(dae, "n") == 2
    assert "x = 2" in equations(dae)
    assert "y[3] = m[2,3].q" in equations(dae)


def test_a_mistake_in_a_loop_is_said_once() -> None:
    assert codes("model A Real x[3]; equation for i in 1:3 loop x[i + 3] = nothing; end for; end A;") == ["E0215"]
    assert codes("model A Real x[3]; equation for i in 1:3 loop x[i] = nothing*i; end for; end A;") == ["E0201"]


def test_enumerations_and_booleans_count_along_dimensions() -> None:
    dae = flat("""type E = enumeration(lo, hi, mid);
        function pick input Real t[E]; input E e; output Real y; protected Real c[E];
          algorithm for k in E loop c[k] := 10*t[k]; end for; y := c[e]; end pick;
        package P type F = enumeration(a, b); end P;
        model M
          parameter Real y[E] = {1, 2, 3};
          parameter Real z = y[E.mid];
          parameter Real s = sum(y[e] for e in E);
          parameter Real w[P.F, E] = {{1, 2, 3}, {4, 5, 6}};
          parameter Real v = w[P.F.b, E.hi];
          parameter Real b[Boolean] = {7, 8};
          parameter Real t = b[true] - b[false];
          parameter Real p = pick(y, E.hi);
          parameter Real r[E] = {y[e]^2 for e in E};
          Real x[E];
          Mass m[E](m = {1, 2, 3});
        equation
          for e in E loop
            x[e] = y[e]*time;
          end for;
        end M;""", "M")
    assert [value(dae, n) for n in ("z", "s", "v", "t", "p")] == [3, 6, 5, 1, 20]
    assert value(dae, "r") == [1, 4, 9]
    assert value(dae, "m.m") == [1, 2, 3]


def test_matrices_are_built_from_blocks() -> None:
    dae = flat("""model A
        parameter Real a[2] = {1, 2}; parameter Real b[2] = {3, 4}; parameter Real m[2, 2] = [a, b];
        parameter Real v[4, 1] = [a; b]; parameter Real w[2, 3] = [m, a]; parameter Real z[4, 2] = [m; m];
        parameter Real s[1, 3] = [1, 2, 3]; parameter Real mm[2, 3] = [[1, 2; 3, 4], [5; 6]];
        parameter Real c[2, 4] = cat(2, m, m); parameter Real d[2, 2, 2] = cat(3, {{{1}, {2}}, {{3}, {4}}}, {{{5}, {6}},
          {{7}, {8}}}); end A;""")
    assert value(dae, "m") == [1, 3, 2, 4]
    assert value(dae, "v") == [1, 2, 3, 4]
    assert value(dae, "w") == [1, 3, 1, 2, 4, 2]
    assert value(dae, "z") == [1, 3, 2, 4, 1, 3, 2, 4]
    assert value(dae, "mm") == [1, 2, 5, 3, 4, 6]
    assert value(dae, "c") == [1, 3, 1, 3, 2, 4, 2, 4]
    assert value(dae, "d") == [1, 5, 2, 6, 3, 7, 4, 8]
    assert codes("model A Real a[2] = {1, 2}; Real x[2, 3] = [a, [1; 2; 3]]; end A;") == ["E0302"]
