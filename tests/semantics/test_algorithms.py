"""Algorithm sections in models: statements in their order, as the Modelica specification says (11.1, 11.2)."""

import numpy as np
import pytest

import lmoc
from lmoc.cli.main import main


def run(text: str, stop: float = 1.0, **more) -> lmoc.Run:
    return lmoc.compile_text(text).simulate(stop=stop, rtol=1e-9, **more)


def codes(text: str) -> list[tuple[str, int]]:
    with pytest.raises(lmoc.ModelError) as caught:
        lmoc.compile_text(text)
    return [(d.code, d.span.line) for d in caught.value.diagnostics if d.severity == "error"]


def test_statements_are_carried_out_in_their_order() -> None:
    """A variable that is assigned several times, a loop, and a function with two results."""
    found = run("""model M
      function f input Real a; output Real b; output Real c; algorithm b := 2*a; c := a^2; end f;
      Real x(start = 1, fixed = true), y, z[3], p, q;
    algorithm
      y := x;
      for i in 1:3 loop
        y := y + i;
        z[i] := y;
      end for;
      (p, q) := f(z[2]);
      z[1] := 0;
    equation
      der(x) = -y;
    end M;""")
    x = found["x"]
    assert found["y"] == pytest.approx(x + 6) and found["z"] == pytest.approx(np.stack([0 * x, x + 3, x + 6], axis=1))
    assert found["p"] == pytest.approx(2 * (x + 3)) and found["q"] == pytest.approx((x + 3) ** 2)
    assert x == pytest.approx(7 * np.exp(-found.time) - 6, abs=1e-8)


def test_what_is_not_assigned_has_its_start_value() -> None:
    found = run("""model M
      Real x(start = 0, fixed = true), y(start = 5);
    algorithm
      if x > 0.5 then y := x; end if;
    equation der(x) = 1; end M;""", points=5)
    assert found["y"] == pytest.approx([5, 5, 0.5, 0.75, 1.0])  # at the event, the value behind it
    assert [e.time for e in found.events] == pytest.approx([0.5])


def test_an_if_statement_is_an_event() -> None:
    """The kink is located: a saturation, integrated exactly."""
    found = run("""model M
      Real x(start = 0, fixed = true), s, w(start = 0, fixed = true);
    algorithm
      s := x;
      if s > 1/3 then s := 1/3; elseif s < -1 then s := -1; end if;
    equation der(x) = 1; der(w) = s; end M;""")
    assert found["w"][-1] == pytest.approx(1 / 18 + 2 / 9, abs=1e-12)
    assert [e.time for e in found.events] == pytest.approx([1 / 3], abs=1e-12)


def test_when_statements_count_and_remember() -> None:
    found = run("""model M
      Real x(start = 1, fixed = true), v(start = 0, fixed = true);
      Integer n(start = 0, fixed = true); discrete Real last(start = -1, fixed = true); Boolean late(start = false);
    algorithm
      when x < 0 then
        n := pre(n) + 1;
        last := time;
        reinit(v, -0.5*pre(v));
        if n >= 2 then late := true; end if;
      elsewhen time > 1.15 then
        n := 100;
      end when;
    equation der(x) = v; der(v) = -9.81; end M;""", stop=1.2)
    first = np.sqrt(2 / 9.81)
    bounces = first * (1 + np.cumsum([0, 1, 0.5]))
    assert found["n"][-1] == 100 and found["n"][found.time < 1.15].max() == 3
    assert found["last"][-1] == pytest.approx(bounces[2], rel=1e-9)
    assert [e.time for e in found.events if e.name == "M"] == pytest.approx([*bounces, 1.15], rel=1e-9)
    assert found["late"][found.time < bounces[1]].max() == 0 and found["late"][-1] == 1


def test_assigned_values_and_values_before_the_event_are_two_things() -> None:
    """Within the section a name stands for what has been assigned, pre() for what was before."""
    found = run("""model M
      Integer a(start = 1, fixed = true), b(start = 0, fixed = true), c(start = 0, fixed = true);
    algorithm
      when sample(0.25, 0.25) then
        a := 2*pre(a);
        b := a + pre(a);
        a := a + 1;
        c := if edge(up) then 1 else 2;
      end when;
    public
      Boolean up = time > 0.1;
    end M;""", stop=0.6)
    assert [found["a"][-1], found["b"][-1], found["c"][-1]] == [7, 9, 2]  # 1 → 3 → 7; b = 6 + 3


def test_sections_do_not_see_each_others_progress() -> None:
    """Each section is one block: what another one assigns is its final value."""
    found = run("""model M
      Real x(start = 1, fixed = true), y, z;
    algorithm z := y + 1;
    algorithm y := 10; y := y + x;
    equation der(x) = 0; end M;""")
    assert found["y"][-1] == 11 and found["z"][-1] == 12


def test_an_initial_algorithm_sets_the_start() -> None:
    found = run("""model M
      parameter Integer n = 4;
      Real x, y; discrete Real k;
    initial algorithm
      x := 1;
      for i in 1:n loop x := x*i; end for;
      k := x/2;
    equation
      der(x) = -k; y = x; when time > 0.5 then k = 0; end when;
    end M;""")
    assert found["x"][[0, -1]] == pytest.approx([24, 24 - 12 * 0.5])


def test_algorithms_of_parts_in_arrays() -> None:
    found = run("""model M
      model P parameter Real a; Real x(start = 0, fixed = true), y; Integer n(start = 0, fixed = true);
      algorithm
        y := a*time;
        if y > 1 then y := 1; end if;
        when x > 0.1 then n := pre(n) + 1; end when;
      equation der(x) = y; end P;
      P p[3](a = {1, 2, 4});
    end M;""")
    exact = [0.5, 0.25 + 0.5, 0.125 + 0.75]
    assert found["p.x"][-1] == pytest.approx(exact, abs=1e-9) and found["p.n"][-1].tolist() == [1, 1, 1]


def test_connectors_are_assigned() -> None:
    """A force element written as an algorithm."""
    found = run("""model M
      model Push Flange flange; algorithm flange.f := -2; flange.f := flange.f*1.5; end Push;
      Mass m(m = 1, q(start = 0, fixed = true), v(start = 0, fixed = true)); Push p;
    equation connect(p.flange, m.flange); end M;""")
    assert found["m.q"][-1] == pytest.approx(1.5, abs=1e-9)


def test_assertions_in_algorithms_hold_in_their_branch() -> None:
    text = """model M Real x(start = 0, fixed = true), y;
    algorithm y := x; if x > 0.5 then y := 2; assert({}, "too far", {}); end if;
    equation der(x) = 1; end M;"""
    found = run(text.format("x < 0.8", "AssertionLevel.warning"))
    assert [n.code for n in found.notes if n.severity == "warning"] == ["W0551"]
    with pytest.raises(lmoc.SimulationError, match="too far"):
        run(text.format("x < 0.8", "AssertionLevel.error"))
    assert run(text.format("x > 0.4", "AssertionLevel.error")).complete


@pytest.mark.parametrize(("body", "code"), [
    ("y := 1; p := 2;", "E0222"),  # a parameter
    ("y := 1; when time > 1 then when time > 2 then n := 1; end when; end when;", "E0252"),
    ("y := 1; if time > 1 then when time > 2 then n := 1; end when; end if;", "E0252"),
    ("y := 1; reinit(x, 2);", "E0252"),
    ("y := 1; n := integer(3); return;", "E0230"),
    ("y := true;", "E0301"),
    ("y := {1, 2};", "E0302"),
    ("nothing := 1;", "E0201"),
    ("y := 1; n := noEvent(if x > 0 then 1 else 2);", "E0251"),
])  # fmt: skip
def test_wrong_statements_have_their_line(body, code) -> None:
    text = "model M\nparameter Real p = 1; Real x(start = 1, fixed = true), y; Integer n(start = 0);\nalgorithm\n"
    text += f"{body}\n"
    assert (code, 4) in codes(text + "equation der(x) = y;\nend M;")


def test_a_variable_assigned_in_two_sections_is_overdetermined() -> None:
    assert codes("model M Real x(start = 0), y;\nalgorithm y := 1;\nalgorithm y := x;\nequation der(x) = y; end M;")


def test_sections_stay_apart_when_formatted(tmp_path, capsys) -> None:
    file = tmp_path / "m.lmo"
    file.write_text("model M\n  Real y;\n  Real z;\nalgorithm\n  z := y;\nalgorithm\n  y := 1;\nend M;\n")
    before = file.read_text()
    assert main(["fmt", str(file)]) == 0
    assert file.read_text() == before


def test_inputs_of_parts_are_assigned() -> None:
    """Of single parts and of arrays of parts, whole and by elements; what has been assigned is read back."""
    found = run("""model M
      model Part input Real x; input Real y[2]; Real z; equation z = 2*x + y[1]; end Part;
      Part part[3], one;
      Real s;
    algorithm
      one.x := 3;
      one.y := {1, 2};
      for i in 1:3 loop
        part[i].x := i*time;
        for j in 1:2 loop part[i].y[j] := part[i].x + j; end for;
      end for;
      s := part[2].x + part[3].y[1] + one.y[2] + sum(part.x);
    end M;""")
    t = found.time
    assert found["part[3].z"] == pytest.approx(9 * t + 1) and found["part[2].y[2]"] == pytest.approx(2 * t + 2)
    assert found["one.z"] == pytest.approx(7 + 0 * t)
    assert found["s"] == pytest.approx(2 * t + 3 * t + 1 + 2 + 6 * t)


def test_discrete_inputs_of_an_array_of_parts_are_assigned_in_a_when() -> None:
    found = run("""model M
      model Part input Integer n(start = 0); Real x(start = 0, fixed = true); equation der(x) = n; end Part;
      Part p[2];
    algorithm
      when sample(0.25, 0.25) then
        for i in 1:2 loop p[i].n := pre(p[i].n) + i; end for;
      end when;
    end M;""")
    assert [found["p[1].n"][-1], found["p[2].n"][-1]] == [4, 8]
    assert found["p[2].x"][-1] == pytest.approx(2 * 0.25 * (1 + 2 + 3), abs=1e-12)


@pytest.mark.parametrize(
    ("statement", "code"), [("p[3].x := 1;", "E0215"), ("p[1].y := {1, 2};", "E0230"), ("p[1].k := 2;", "E0222")]
)
def test_wrong_assignments_to_an_array_of_parts(statement, code) -> None:
    with pytest.raises(lmoc.ModelError) as failed:
        run(f"""model M
          model Part input Real x, y[2]; parameter Real k = 1; Real z; equation z = x + k + sum(y); end Part;
          Part p[2];
        algorithm for i in 1:2 loop p[i].x := i; for j in 1:2 loop p[i].y[j] := 0; end for; end for; {statement}
        end M;""")
    assert failed.value.diagnostics[0].code == code
