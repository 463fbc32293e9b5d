"""Consistent starts: fixed values, start values, initial equations, and what is said where they cannot hold."""

import numpy as np
import pytest
from oracles.by_hand import Scene

import lmoc
from lmoc.expression import dag
from lmoc.expression.dag import slot
from lmoc.ir.flat import Group
from lmoc.ir.program import Apply, Solve
from lmoc.messages.diagnostics import ModelError
from lmoc.numerics.options.options import RunOptions
from lmoc.numerics.run.simulate import simulate

START = RunOptions(times=[0.0])


def begin(scene: Scene, initial=None, **flat_more):
    run = simulate(scene.reduced(**flat_more), options=START, initial=initial)
    return run, {name: float(run[name][0]) for name in scene.names}


def gears(w1: float | None, fixed1: bool, w2: float | None, fixed2: bool) -> Scene:
    """Two meshed gears: one speed w2 is the state, w1 = 5·w2."""
    s = Scene()
    w2_ = s.state("gear2.w", w2, fixed2)
    s.rate(w2_, 0.0)
    s.begin(s.define("gear1.w", 5 * w2_), w1, fixed1)
    return s


def test_contradictory_fixed_values_are_named():
    with pytest.raises(ModelError) as wrong:
        begin(gears(10.0, True, 1.0, True))
    (found,) = wrong.value.diagnostics
    assert found.code == "E0531"
    assert "gear1.w = 10" in found.message and "gear2.w = 1" in found.message and "contradict" in found.message


def test_consistent_fixed_values_are_fine():
    assert begin(gears(5.0, True, 1.0, True))[1]["gear2.w"] == 1.0


@pytest.mark.parametrize(
    ("scene", "speed"),
    [
        (gears(10.0, True, None, False), 2.0),  # a fixed value on what is no state
        (gears(10.0, True, 1.0, False), 2.0),  # goes before a start value
        (gears(10.0, False, 1.0, True), 1.0),
        (gears(None, True, 3.0, False), 0.0),  # fixed without a value: 0
        (gears(10.0, False, None, False), 2.0),
        (gears(None, False, None, False), 0.0),
    ],
)
def test_what_goes_before_what(scene, speed):
    assert begin(scene)[1]["gear2.w"] == pytest.approx(speed, abs=1e-12)


def test_start_values_that_cannot_all_hold_are_met_as_closely_as_possible():
    run, value = begin(gears(10.0, False, 1.0, False))
    assert 1.0 < value["gear2.w"] < 2.0
    assert [n.code for n in run.notes] == ["W0533"]


def test_the_caller_overrides_a_variable():
    assert begin(gears(10.0, True, None, False), {"gear1.w": 20.0})[1]["gear2.w"] == pytest.approx(4.0)
    assert begin(gears(10.0, False, 1.0, True), {"gear2.w": 3.0})[1]["gear2.w"] == 3.0
    for name, code in (("gear3.w", "E0622"), ("k", "E0534")):
        scene = gears(1.0, True, None, False)
        scene.parameter("k", 1.0)
        with pytest.raises(ModelError) as wrong:
            begin(scene, {name: 1.0})
        assert wrong.value.diagnostics[0].code == code


def test_least_states_where_a_fixed_sum_leaves_a_choice():
    s = Scene()
    a, b, c = s.state("a"), s.state("b"), s.state("c", 7.0, True)
    s.begin(s.define("total", a + 2 * b + c), 12.0, True)
    value = begin(s)[1]
    assert (value["a"], value["b"], value["c"]) == pytest.approx((1.0, 2.0, 7.0))


def test_a_start_on_a_nonlinear_variable():
    s = Scene()
    angle = s.state("angle", 0.4)
    s.begin(s.define("height", 2 * dag.function("sin", angle)), 1.0, True)
    assert begin(s)[1]["angle"] == pytest.approx(np.pi / 6, abs=1e-12)


def equation(left, right) -> Group:
    """One initial equation over the variables of a scene, whose slots are their numbers."""
    columns = [[leaf.value[0] for leaf in dag.slots(left - right)]]
    names = {leaf: slot(k) for k, leaf in enumerate(dag.slots(left - right))}
    return Group(dag.substitute(left - right, names), dag.ZERO, np.array(columns), None)


def code_of(scene: Scene, *equations: Group) -> str:
    with pytest.raises(ModelError) as wrong:
        begin(scene, initial_groups=equations)
    (found,) = wrong.value.diagnostics
    return found.code


@pytest.mark.parametrize(
    ("law", "guess", "solution"),
    [
        (lambda q: q**2 - 4, 0.0, 2.0),  # stationary at the guess: the solution on the positive side
        (lambda q: q**2 - 4, -0.5, -2.0),  # else the one on the side of the guess
        (lambda q: q**2 - 4e-6, 0.0, 2e-3),
        (lambda q: q**2 - 4e6, 0.0, 2e3),
        (lambda q: q**4 - 16, 0.0, 2.0),
        (lambda q: dag.function("cos", q) - 0.5, 0.0, np.pi / 3),
        (lambda q: dag.function("cos", 2 * q) + 1, np.pi, np.pi / 2 + np.pi),
        (lambda q: dag.function("sqrt", q) - 2, 0.0, 4.0),  # the gradient is infinite
        (lambda q: dag.function("log", q) - 1, 0.0, np.e),  # so is the value
        (lambda q: q**3 - 3 * q + 18, 1.0, -3.0),  # uphill first
    ],
)
def test_the_first_guess_may_be_a_stationary_point(law, guess, solution):
    s = Scene()
    q = s.state("q", guess)
    value = begin(s, initial_groups=(equation(law(q), dag.ZERO),))[1]["q"]
    assert value == pytest.approx(solution, rel=1e-6)


def test_two_equations_from_a_stationary_point():
    s = Scene()
    x, y, z = s.state("x"), s.state("y"), s.state("z", 7.0, True)
    value = begin(s, initial_groups=(equation(x**2 + y**2, z + 18), equation(4 * x, 3 * y)))[1]
    assert (value["x"], value["y"], value["z"]) == pytest.approx((3.0, 4.0, 7.0))


def test_a_start_value_may_be_met_from_a_stationary_point():
    s = Scene()
    angle = s.state("angle")
    s.begin(s.define("height", dag.function("cos", angle)), 0.5)
    run, value = begin(s)
    assert value["angle"] == pytest.approx(np.pi / 3) and not run.notes


def test_an_impossible_height():
    s = Scene()
    angle = s.state("angle", 0.4)
    s.begin(s.define("height", 2 * dag.function("sin", angle)), 3.0, True)
    with pytest.raises(ModelError) as wrong:
        begin(s)
    (found,) = wrong.value.diagnostics
    assert found.code == "E0532" and "height = 3" in found.message
    assert "height = 2" in found.found


def test_only_what_is_certain_is_called_a_contradiction():
    def arm(height: float) -> Scene:
        s = Scene()
        angle = s.state("angle", 0.5, True)
        s.begin(s.define("height", 2 * dag.function("sin", angle)), height, True)
        return s

    assert code_of(arm(5.0)) == "E0531"  # the angle is fixed
    assert begin(arm(2 * np.sin(0.5)))[1]["angle"] == 0.5
    s = Scene()
    s.begin(s.define("two", dag.const(2.0)), 3.0, True)
    s.state("q")
    assert code_of(s) == "E0531"  # no state can change it
    s = Scene()
    q, p = s.state("q"), s.state("p")
    same = (equation(q, dag.ONE), equation(2 * q, dag.const(2.0)))  # agree
    assert code_of(s, *same, equation((p - q) ** 2, dag.const(-1.0))) == "E0532"
    assert code_of(s, equation(q, dag.ONE), equation(2 * q, dag.const(3.0)), equation(p**2, q)) == "E0531"


def test_initial_equations():
    s = Scene()
    q, v = s.state("q"), s.state("v")
    s.rate(q, v)
    s.rate(v, 3.0 - 2 * q)
    steady = Group(slot(0, 1), dag.ZERO, np.array([[1]]), None)  # der(v) = 0
    twice = Group(slot(0), 2 * slot(1), np.array([[1, 0]]), None)  # v = 2 q
    assert begin(s, initial_groups=(steady,))[1]["q"] == pytest.approx(1.5)
    value = begin(s, initial_groups=(steady, twice))[1]
    assert (value["q"], value["v"]) == pytest.approx((1.5, 3.0))
    three = Group(slot(0), dag.const(5.0), np.array([[0]]), None)
    with pytest.raises(ModelError) as wrong:
        begin(s, initial_groups=(steady, twice, three))
    assert "der(v) = 0" in str(wrong.value)


def test_a_value_missing_at_the_start_is_named():
    s = Scene()
    q = s.state("tank.level", -1.0)
    s.rate(q, s.define("tank.flow", dag.function("sqrt", q)))
    with pytest.raises(ModelError) as wrong:
        begin(s)
    assert wrong.value.diagnostics[0].code == "E0535" and "tank.flow" in str(wrong.value)


def test_many_equal_parts_at_once():
    """A thousand pairs, each with a fixed sum and a wanted difference."""
    s = Scene()
    for i in range(1000):
        a, b = s.state(f"p{i}.a"), s.state(f"p{i}.b")
        s.begin(s.define(f"p{i}.sum", a + b), i, True)
        s.begin(s.define(f"p{i}.difference", a - b), 2.0)
    run = simulate(s.reduced(), options=START)
    assert run.states[0, 0::2] == pytest.approx(np.arange(1000) / 2 + 1)
    assert run.states[0, 1::2] == pytest.approx(np.arange(1000) / 2 - 1)


def test_one_part_with_many_states():
    """A thousand and more states tied together by wishes for their differences, one of them fixed."""
    s, n = Scene(), 1100
    x = [s.state(f"x{i}") for i in range(n)]
    for i in range(n - 1):
        s.begin(s.define(f"gap{i}", x[i + 1] - x[i]), 0.01 * i)
    s.begin(s.define("twice", 2 * x[0]), 6.0, True)
    run = simulate(s.reduced(), options=START)
    i = np.arange(n)
    assert run.states[0] == pytest.approx(3.0 + 0.01 * i * (i - 1) / 2, rel=1e-9)
    assert run["twice"][0] == pytest.approx(6.0, abs=1e-9)


def linkage(start: float) -> tuple[Scene, tuple]:
    """cos(angle) = 1 - q by Newton: two branches, the start value of the angle chooses."""
    s = Scene()
    q = s.state("q", 0.5, True)
    s.rate(q, 0.1)
    angle = s.variable("angle")
    s.begin(angle, start)
    residual = len(s.names) + 1  # behind the variables and the one right-hand side
    unknown, out = np.array([[angle.value[0]]]), np.array([[residual]])
    slots = np.array([[angle.value[0], q.value[0]]])
    inner = Apply(dag.function("cos", slot(0)) + slot(1) - 1, slots, out[0])
    return s, (Solve((inner,), unknown, out, False, False),)


@pytest.mark.parametrize(("start", "branch"), [(1.0, 1.0), (-1.0, -1.0), (5.0, None)])
def test_newton_begins_at_the_start_value_and_keeps_to_its_branch(start, branch):
    s, steps = linkage(start)
    run = simulate(s.reduced(steps=steps, more_registers=1))
    exact = np.arccos(1 - 0.5 - 0.1 * run.time)
    assert np.cos(run["angle"]) == pytest.approx(np.cos(exact), abs=1e-9)
    if branch:
        assert run["angle"] == pytest.approx(branch * exact, abs=1e-9)


@pytest.mark.parametrize("force", [-0.09, 3.0])
def test_a_cubic_spring_pushed_from_its_flat_place(force):
    """Its free end: the extension is the cube root of the force over the stiffness, and the slope at zero is none."""
    text = f"""\
model Pushed
  Mass m(m = 1, q(fixed = true), v(fixed = true));
  CubicSpring s(k = 42);
  Force f(f = {force});
equation
  connect(m.flange, s.a);
  connect(s.b, f.flange);
end Pushed;
"""
    run = lmoc.compile_text(text).simulate(stop=2, points=5)
    assert run["s.extension"] == pytest.approx(np.full(5, np.cbrt(force / 42)), rel=1e-6)
    assert run["m.q"] == pytest.approx(force * run.time**2 / 2, rel=1e-6, abs=1e-12)


def test_a_flat_place_between_two_solutions_is_none():
    """Turned either way, the lever would be at rest along the force: the model does not say which."""
    lever = "model M Lever l(l1 = 1, l2 = 1); Force f(f = 1); equation connect(l.a, f.flange); end M;"
    with pytest.raises(lmoc.ModelError, match="E0535"):
        lmoc.compile_text(lever).check()


@pytest.mark.parametrize(("declared", "told"), [("P.T x", []), ("P.T x(start = 5)", ["W0533"])])
def test_a_guess_of_a_type_that_is_not_met_is_no_news(declared, told):
    run = lmoc.compile_text(f"""package P type T = Real(start = 288); end P;
      model M Real s(start = 1, fixed = true); {declared}; equation der(s) = -s; x = 2*s; end M;""",
      model="M").simulate(stop=1)  # fmt: skip
    assert (run["x"][0], [n.code for n in run.notes]) == (2.0, told)


def test_what_has_no_value_at_the_first_guess_follows_when_the_others_have():
    """A temperature is heat over mass: 0/0 until the tank is filled."""
    run = lmoc.compile_text("""model M Real level(start = 0.5, fixed = true), T(start = 313, fixed = true), m, H;
      equation m = 1000*level; der(m) = -100; H = 4000*m*T; der(H) = -100*4000*T; end M;""").simulate(stop=1)
    assert (run["H"][0], run["T"][-1]) == (pytest.approx(4000 * 500 * 313), pytest.approx(313))
