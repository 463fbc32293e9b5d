"""The compiled scene: names, values, runs with other parameters, and its errors."""

import math

import numpy as np
import pytest
from conftest import SPRING

import lmoc

VANISHING = """\
model Vanishing
  parameter Real J(unit = "kg.m2") = 0;
  FixedShaft wall;
  TorsionSpring spring1(k = 3);
  Inertia middle(J = J);
  TorsionSpring spring2(k = 6);
  Inertia rotor(J = 2, theta(start = 1, fixed = true));
equation
  connect(wall.shaft, spring1.a);
  connect(spring1.b, middle.shaft);
  connect(middle.shaft, spring2.a);
  connect(spring2.b, rotor.shaft);
end Vanishing;
"""

CHAIN = """\
model Chain
  parameter Integer n = 3;
  Mass m[n](each m = 1);
  Fixed wall;
  Spring s[n](each k = 1);
equation
  connect(wall.flange, s[1].a);
  for i in 1:n loop
    connect(s[i].b, m[i].flange);
  end for;
  for i in 2:n loop
    connect(m[i-1].flange, s[i].a);
  end for;
end Chain;
"""


@pytest.fixture(scope="module")
def dae():
    return lmoc.compile_text(SPRING)


def test_names_are_dotted_paths(dae):
    assert dae.name == "Oscillator"
    assert dae.inputs == ["f"]
    assert dae.outputs == ["x"]
    assert len(dae.states) == 2
    assert set(dae.states) <= {"body.q", "body.v", "der(body.q)", "x", "der(x)"} | set(dae.variables)
    assert {"spring.f", "spring.a.q", "wall.flange.f", "x", "f"} <= set(dae.variables)
    assert "spring.k" not in dae.variables


def test_parameters_have_their_values(dae):
    assert dae.parameters["k"] == 8
    assert dae.parameters["spring.k"] == 8
    assert dae.parameters["body.m"] == 2
    assert "spring.f" not in dae.parameters
    with pytest.raises(KeyError):
        dae.parameters["spring.f"]


def test_parameters_given_at_compilation_stay():
    dae = lmoc.compile_text(SPRING, parameters={"k": 18})
    assert dae.parameters["spring.k"] == 18
    run = dae.simulate(stop=1, rtol=1e-9, parameters={"body.m": 0.5})
    assert run["x"][-1] == pytest.approx(0.5 * math.cos(6), abs=1e-7)


def test_parameters_change_from_run_to_run(dae):
    for k in (8, 2, 32, 8):
        run = dae.simulate(stop=1, rtol=1e-9, parameters={"k": k})
        assert run["x"][-1] == pytest.approx(0.5 * math.cos(math.sqrt(k / 2)), abs=1e-7)
        assert run["spring.k"][0] == k
    assert dae.parameters["k"] == 8


def test_start_and_input_can_be_given(dae):
    run = dae.simulate(times=[0, 0.5, 2], rtol=1e-9, initial={"body.q": 0, "body.v": 1}, inputs={"f": lambda t: 16.0})
    t = np.array([0, 0.5, 2])
    assert np.array_equal(run.time, t)
    assert run["x"] == pytest.approx(2 - 2 * np.cos(2 * t) + np.sin(2 * t) / 2, abs=1e-7)


def test_unknown_names_are_errors_with_a_hint(dae):
    for kind in ("parameters", "initial", "inputs"):
        with pytest.raises(lmoc.ModelError) as caught:
            dae.simulate(**{kind: {"bdy.q": 1}})
        assert "bdy.q" in str(caught.value)
    with pytest.raises(lmoc.ModelError, match=r"body\.m"):
        dae.simulate(parameters={"body.mass": 1})
    with pytest.raises(lmoc.ModelError, match="does not fit"):
        dae.simulate(parameters={"k": [1, 2]})


def test_a_value_that_changes_the_structure_is_told():
    dae = lmoc.compile_text(VANISHING)
    assert len(dae.states) == 2
    run = dae.simulate(stop=1, rtol=1e-9)
    assert run["rotor.theta"][-1] == pytest.approx(math.cos(1), abs=1e-7)
    other = dae.simulate(stop=1, rtol=1e-9, parameters={"J": 1.0})
    assert len(other.states) == 4
    assert any(note.code == "N0631" for note in other.notes)
    again = dae.simulate(stop=1, rtol=1e-9)
    assert np.array_equal(again["rotor.theta"], run["rotor.theta"])
    assert not any(note.code == "N0631" for note in again.notes)


def test_a_structural_parameter_flattens_again():
    dae = lmoc.compile_text(CHAIN)
    assert len(dae.states) == 6
    run = dae.simulate(stop=1, parameters={"n": 5})
    assert len(run.states) == 10
    assert any(note.code == "N0630" for note in run.notes)
    assert run["m.q"].shape == (501, 5)


def test_a_condition_on_a_parameter_flattens_again_where_it_changes():
    """What is compiled depends on n > 2 and on whether k is positive, on nothing else of them: x' = -k x, or x' = n."""
    model = "model A parameter Real k = 2, n = 1, m = 2*n; parameter Boolean on = k > 0; "
    model += "Real x(start = 1, fixed = true); "
    model += "equation if on and m < 4 then der(x) = -k*x; else der(x) = n; end if; end A;"
    dae = lmoc.compile_text(model)
    end = np.exp(-3), np.exp(-2)
    for given, truth, again in (({"k": 3}, end[0], 0), ({"n": 1.9}, end[1], 0), ({"n": 2}, 3, 1), ({"k": -1}, 2, 1)):
        run = dae.simulate(stop=1, points=3, rtol=1e-9, parameters=given)
        assert run["x"][-1] == pytest.approx(truth, abs=1e-7)
        assert [note.code for note in run.notes].count("N0630") == again
    many = dae.ensemble({"k": np.array([3.0, -1.0, 2.5])}, stop=1, points=3, keep="x")
    alone = [dae.simulate(stop=1, points=3, parameters={"k": k})["x"] for k in (3.0, -1.0, 2.5)]
    assert np.array_equal(many["x"], alone)


def test_a_failing_run_keeps_its_beginning():
    dae = lmoc.compile_text(SPRING.replace("push(f = f)", "push(f = f + 1/(1 - body.q)^3)"))
    with pytest.raises(lmoc.SimulationError) as caught:
        dae.simulate(inputs={"f": 9}, stop=20)
    error = caught.value
    assert 0 < error.time < 20
    assert not error.partial.complete
    assert error.partial.time[-1] <= error.time
    assert np.isfinite(error.partial["x"]).all()


def test_a_wrong_model_raises_with_diagnostics():
    with pytest.raises(lmoc.ModelError) as caught:
        lmoc.compile_text(SPRING.replace("Spring spring(k = k)", "Sprung spring(k = k)"))
    assert "Spring" in caught.value.diagnostics[0].hint
    assert caught.value.diagnostics[0].span.line == 6


def test_casadi_functions_follow_the_bindings(dae):
    f = dae.functions
    assert f.states == tuple(dae.states)
    assert f.inputs == ("f",)
    assert f.outputs == ("x",)
    assert "k" in f.parameters and "spring.k" not in f.parameters
    p = f.values.copy()
    p[f.parameters.index("k")] = 18
    rate = np.array(f.ode(0, [0.5, 0.25], 4, p)).ravel()
    assert rate == pytest.approx([0.25, (4 - 18 * 0.5) / 2])
    assert float(f.output(0, [0.5, 0.25], 4, p)) == 0.5
    a, b, c, d = (np.array(m) for m in f.jacobian(0, [0.5, 0.25], 4, p))
    assert a == pytest.approx(np.array([[0, 1], [-9, 0]]))
    assert b == pytest.approx(np.array([[0], [0.5]]))
    assert (c.tolist(), d.tolist()) == ([[1, 0]], [[0]])


@pytest.mark.parametrize("value", [float("nan"), "half", None])
def test_start_values_are_finite_numbers(dae, value):
    with pytest.raises(lmoc.ModelError, match="E0621"):
        dae.simulate(initial={"body.q": value})


def test_a_table_that_ends_early_is_told(dae):
    run = dae.simulate(stop=3, inputs={"f": ([0, 1], [0, 2])})
    assert [note.code for note in run.notes] == ["W0525"]
    assert run["f"][-1] == 2
    assert dae.simulate(stop=1, inputs={"f": ([0, 1], [0, 2])}).notes == ()


@pytest.mark.parametrize(
    "options",
    [{"points": 2.5}, {"points": "a"}, {"start": "0"}, {"stop": "a"}, {"stop": float("inf")}, {"start": float("nan")}],
)
def test_times_are_finite_numbers(dae, options):
    with pytest.raises(lmoc.ModelError, match="E0541"):
        dae.simulate(**options)


@pytest.mark.parametrize(
    ("text", "names", "line"),
    [
        ("model M\n parameter Real s;\n Mass m(m = 2*s); end M;", ["s"], 2),
        ("model M\n parameter Real a, b;\n parameter Real c = a + b;\n Mass m[2](each m = c); end M;", ["a", "b"], 2),
        ("model M\n parameter Real spare;\n Mass m; end M;", ["m.m"], 3),
    ],
)
def test_a_run_asks_for_the_parameters_that_the_user_left_open(text, names, line):
    """By the names that have to be given, not those bound to them; also where only an energy needs them."""
    with pytest.raises(lmoc.ModelError) as error:
        lmoc.compile_text(text).simulate()
    found = error.value.diagnostics
    assert [d.message.split("'")[1] for d in found if d.code == "E0530"] == names
    assert {d.span.line for d in found if d.code == "E0530"} == {line}


def test_equations_that_no_derivative_needs_have_a_solution_at_the_start():
    """A force on a lever that nothing holds; a root of a negative number."""
    lever = "model M Lever l(l1 = 1, l2 = 1); Force f(f = 1); equation connect(l.a, f.flange); end M;"
    for text in (lever, "model M Real x; equation x^2 + x = -1 - time; end M;"):
        with pytest.raises(lmoc.ModelError, match="E0535.*no solution"):
            lmoc.compile_text(text).check()


def test_values_that_are_not_finite_at_the_start_are_warned_of():
    text = "model M Real x(start = 1, fixed = true); Real y = log({} - time); equation der(x) = -x; end M;"
    notes = lmoc.compile_text(text.format("-1")).check()
    assert [(n.code, "y has no finite value" in n.message) for n in notes] == [("W0537", True)]
    assert lmoc.compile_text(text.format("1")).check() == ()


def test_values_that_are_lost_on_the_way_are_warned_of():
    text = "model M Real x(start = 1.001, fixed = true); Real y = sqrt(x); equation der(x) = -1; end M;"
    dae = lmoc.compile_text(text)
    assert not dae.simulate(stop=0.9).notes
    run = dae.simulate(stop=2)
    assert [(n.code, n.message) for n in run.notes] == [("W0537", "y has no finite value (nan) at t = 1.004 s")]
    assert np.isfinite(run["y"][run.time < 0.99]).all() and np.isnan(run["y"][run.time > 1.01]).all()


TYPED = """
model Typed
  parameter Integer n = 2;
  parameter Integer teeth = 20;
  parameter Boolean on = true;
  parameter Real k = 1;
  Real x[n](each start = 1);
equation
  for i in 1:n loop
    der(x[i]) = if on then -k*teeth*x[i] else 0;
  end for;
end Typed;
"""


@pytest.mark.parametrize(
    ("name", "value", "code"),
    [
        ("teeth", 2.5, "E0301"),
        ("on", 0.5, "E0301"),
        ("n", 1.5, "E0301"),
        ("k", "much", ("E0301", "E0621")),
        ("k", 1j, ("E0301", "E0621")),
        ("k", [1, 2], ("E0302", "E0621")),
        (3, 1, "E0622"),
        ("x", 1, "E0622"),
        ("x[", 1, "E0622"),
    ],
)
def test_a_value_that_does_not_fit_is_refused_at_once_and_from_run_to_run(name, value, code) -> None:
    dae = lmoc.compile_text(TYPED)
    for attempt in (lambda g: lmoc.compile_text(TYPED, parameters=g), lambda g: dae.simulate(parameters=g)):
        with pytest.raises(lmoc.ModelError) as caught:
            attempt({name: value})
        (only,) = caught.value.diagnostics
        assert only.code in code


def test_arguments_of_another_type() -> None:
    with pytest.raises(TypeError, match="not bytes"):
        lmoc.compile_text(TYPED.encode())
    with pytest.raises(lmoc.ModelError, match="E0601"):
        lmoc.compile_text(TYPED, model=3)


LIMITED = """
model Limited
  parameter Real k[2](each min = 0) = {1, 2};
  parameter Real top = 5;
  Real x(start = 1);
equation
  der(x) = -k[1]*x;
  assert(k[2] < top, "the second is too large");
  assert(x > -1, "too low");
end Limited;
"""


@pytest.mark.parametrize(
    ("given", "message", "found"),
    [
        ({"k[2]": -1}, "'k' must be at least 0", "k[2] = -1"),
        ({"top": 2}, "the second is too large", "k[2] = 2, top = 2"),
    ],
)
def test_parameters_out_of_their_limits_are_refused_before_the_run(given: dict, message: str, found: str) -> None:
    dae = lmoc.compile_text(LIMITED)
    assert dae.check() == ()
    at_once = lambda: lmoc.compile_text(LIMITED, parameters=given).check()  # noqa: E731
    sound_before = lambda: dae.simulate() and dae.simulate(parameters=given)  # noqa: E731
    for attempt in (at_once, lambda: dae.simulate(parameters=given), sound_before, sound_before):
        with pytest.raises(lmoc.ModelError) as caught:
            attempt()
        (only,) = caught.value.diagnostics
        assert (only.code, only.message, only.found) == ("E0551", message, found)


def test_output_times_stand_at_the_interval_of_the_experiment():
    body = "Mass m(m = 1); annotation(experiment(StartTime = 1, StopTime = 2, Interval = 0.3));"
    assert np.allclose(lmoc.compile_text(f"model M {body} end M;").simulate().time, [1, 1.3, 1.6, 1.9, 2])
    assert len(lmoc.compile_text(f"model M {body} end M;").simulate(stop=4).time) == 11


def test_more_output_times_than_memory_are_refused():
    with pytest.raises(lmoc.ModelError, match="at most 50000000 output points"):
        lmoc.compile_text("model M Mass m(m = 1); end M;").simulate(points=10**13)
