"""Initial equations with derivatives of anything: closed forms, and rates of whole programs by differences."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import lmoc
from lmoc.ir.program import Solve
from lmoc.messages.diagnostics import ModelError, Report
from lmoc.numerics.plan.plan import Plan, build_plan
from lmoc.numerics.signals.signals import default_signals
from lmoc.numerics.solve.interpreter import Interpreter
from lmoc.numerics.start.initial_equations import InitialEquations
from lmoc.numerics.start.lexicographic import split
from lmoc.structure.blocks.tangent import Tangent

MODELS = Path(__file__).parents[2] / "models"


def start(parts: str, equations: str, initial: str, inputs: dict | None = None) -> dict[str, float]:
    text = f"model S\n{parts}\ninitial equation\n{initial}\nequation\n{equations}\nend S;"
    dae = lmoc.compile_text(text)
    run = dae.simulate(times=[0.0], inputs=inputs or {})
    return {name: float(run[name][0]) for name in dae.variables}


def plan_of(dae: lmoc.DAE) -> tuple[Plan, dict]:
    report = Report()
    signals = default_signals(dae.flat)
    plan = build_plan(dae.reduced, signals, True, report)
    report.check()
    return plan, signals


GEARED = (
    "Inertia rotor(J = 1); Gear gear(N = 4); Drum drum(r = 0.5); Mass tip(m = 2, g = 10); Fixed w; Spring s(k = 8);"
)
TIED = (
    "connect(rotor.shaft, gear.a); connect(gear.b, drum.shaft); connect(drum.flange, tip.flange);"
    "connect(w.flange, s.a); connect(s.b, tip.flange);"
)


def test_velocity_of_a_geared_point():
    value = start(GEARED, TIED, "der(tip.q) = 1;")
    assert value["tip.v"] == pytest.approx(1)
    assert value["rotor.omega"] == pytest.approx(4 / 0.5)


def test_rest_by_two_derivatives_of_a_geared_point():
    value = start(GEARED, TIED, "der(tip.q) = 0; der(der(tip.q)) = 0;")
    assert value["tip.q"] == pytest.approx(2 * 10 / 8)  # weight over stiffness
    assert value["rotor.omega"] == pytest.approx(0)


def test_rate_of_a_force_and_of_its_square():
    value = start(GEARED + "Real square;", TIED + "square = s.f^2;", "der(s.f) = 4; der(square) = 16;")
    assert value["tip.v"] == pytest.approx(4 / 8)
    assert value["s.f"] == pytest.approx(16 / (2 * 4))


def test_jerk():
    """m·a = m·g - k·q, so the rate of the force m·a is -k·v, that of the inertia behind the gear included."""
    value = start(GEARED, TIED, "der(tip.a) = 3; tip.q = 0.1;")
    mass = 2 + 1 * (4 / 0.5) ** 2
    assert value["tip.v"] == pytest.approx(-3 * mass / 8)


def test_velocity_at_the_end_of_an_arm():
    parts = "Inertia rotor(J = 1, theta(start = 0.5, fixed = true)); Arm arm(l = 2); Mass load(m = 1);"
    value = start(
        parts, "connect(rotor.shaft, arm.shaft); connect(arm.flange, load.flange);", "der(arm.flange.q) = 0.3;"
    )
    assert value["rotor.omega"] == pytest.approx(0.3 / (2 * np.cos(0.5)))


def test_rate_of_what_is_found_by_iteration():
    parts = "Mass m(m = 1, q(start = 2, fixed = true)); Real u(start = 0.8); Real w;"
    value = start(parts, "u + u^3 = m.q; w^3 + u*w = 2*u;", "der(u) = 1;")
    assert value["u"] == pytest.approx(1)
    assert value["m.v"] == pytest.approx(1 + 3)
    # and one block behind the other: 3w²w' + u'w + u w' = 2u' with w = 1, u = 1
    assert start(parts, "u + u^3 = m.q; w^3 + u*w = 2*u;", "der(w) = 0.5;")["m.v"] == pytest.approx(0.5 * 4 * 4)


def test_rates_of_signals():
    parts, equations = "input Real u = sin(3*time); Mass m(m = 1); Real gap;", "gap = m.q - 2*u;"
    assert start(parts, equations, "der(gap) = 0;")["m.v"] == pytest.approx(2 * 3)
    times = np.linspace(0, 1, 21)
    table = (times, 5 * times + times**2)
    assert start(parts, equations, "der(gap) = 0;", {"u": table})["m.v"] == pytest.approx(2 * 5, rel=1e-6)
    value = start(parts, equations, "gap = 0; der(gap) = 0;", {"u": 3.0})
    assert (value["m.q"], value["m.v"]) == pytest.approx((6, 0))
    with pytest.raises(ModelError) as wrong:
        start(parts, equations, "der(gap) = 0;", {"u": lambda t: t})
    assert [d.code for d in wrong.value.diagnostics] == ["E0536"]
    assert "der(gap) = 0" in wrong.value.diagnostics[0].found


def test_constants_stand_still():
    parts, equations = "Mass m(m = 1); Real gap; Real rate;", "gap = m.q - 2; rate = der(gap);"
    assert start(parts, equations, "rate + der(gap) = 3;")["m.v"] == pytest.approx(1.5)


def test_a_force_that_is_not_unique_cannot_be_asked_for():
    parts = "Fixed w; Mass m(m = 1, g = 10); Rod left, right;"
    joined = "".join(f"connect(w.flange, {r}.a); connect({r}.b, m.flange);" for r in ("left", "right"))
    with pytest.raises(ModelError) as wrong:
        start(parts, joined, "left.a.f = 3;")
    assert [d.code for d in wrong.value.diagnostics] == ["E0536"]
    assert "left.a.f" in wrong.value.diagnostics[0].message


def test_many_rows_are_as_many_steps_as_few():
    def steps(n: int) -> int:
        dae = lmoc.compile_text(f"""
            model S
              Inertia j[{n}](each J = 1, each theta(start = 0.25, fixed = true));
              Arm arm[{n}](each l = 2);
              Mass m[{n}](each m = 1);
            initial equation
              for i in 1:{n} loop der(arm[i].flange.q) = i; end for;
            equation
              for i in 1:{n} loop
                connect(j[i].shaft, arm[i].shaft);
                connect(arm[i].flange, m[i].flange);
              end for;
            end S;""")
        assert dae.simulate(times=[0.0])[f"j[{n}].omega"][0] == pytest.approx(n / (2 * np.cos(0.25)))
        return len(InitialEquations(*plan_of(dae), Report()).program)

    assert steps(30) == steps(300)


@pytest.mark.parametrize(
    "name",
    ["hard/h08_turning_lever", "hard/h22_block_and_tackle", "hard/h15_cubic_spring", "bench/levers", "bench/network"],
)
def test_rates_agree_with_differences(name):
    """The rate of every register along the flow, against a central difference."""
    dae = lmoc.compile(MODELS / f"{name}.lmo")
    plan, signals = plan_of(dae)
    rate = np.full(plan.count, -1)
    rate[plan.states] = plan.derivatives
    tangent = Tangent(plan.full_program, rate)
    tangent.advance()
    run = Interpreter((*plan.full_program, *tangent.program), len(tangent.rate))
    base = np.concatenate([plan.base(dae.reduced.values, signals), np.full(len(tangent.rate) - plan.count, np.nan)])
    x = np.random.default_rng(1).uniform(-0.3, 0.3, len(plan.states))

    def at(x: np.ndarray, time: float) -> np.ndarray:
        w = base.copy()
        w[plan.states] = x
        run.run(w, time)
        return w

    h = 1e-5
    here = at(x, 0.3)
    flow = here[plan.derivatives]
    by_difference = (at(x + h * flow, 0.3 + h) - at(x - h * flow, 0.3 - h)) / (2 * h)
    made = np.flatnonzero((tangent.rate[: plan.count] >= 0) & np.isfinite(here[: plan.count]))
    residuals = [s.residuals.ravel() for s in plan.full_program if isinstance(s, Solve)]
    made = np.setdiff1d(made, np.concatenate([np.zeros(0, int), *residuals]))  # roundoff
    assert len(made) > len(plan.states)
    scale = 1 + np.abs(by_difference[made])
    np.testing.assert_allclose(here[tangent.rate[made]] / scale, by_difference[made] / scale, atol=2e-6)


PENDULUM = """
model Pendulum
  parameter Real x0 = 0.6;
  Real x, y, vx, vy, T;
equation
  der(x) = vx; der(y) = vy; der(vx) = -T*x; der(vy) = -T*y - 9.81; x^2 + y^2 = 1;
initial equation
  {};
end Pendulum;
"""


@pytest.mark.parametrize(
    "initial, expected",
    [
        ("x = 1", {"x": 1, "y": 0, "vx": 0, "vy": 0}),
        ("y = -1", {"x": 0, "y": -1, "vx": 0, "vy": 0}),
        ("y = -1; vx = 2", {"x": 0, "y": -1, "vx": 2, "vy": 0}),
        ("x = -1; der(y) = 2", {"x": -1, "y": 0, "vx": 0, "vy": 2}),
        ("y = -0.6; x + y = 0.2; vy = 1", {"x": 0.8, "y": -0.6, "vx": 0.75, "vy": 1}),
        ("T = 3; x = 0.6", {"x": 0.6, "y": 0.8, "T": 3}),  # T = v^2 - g y
    ],
)
def test_initial_equations_choose_coordinates_and_their_side(initial, expected):
    run = lmoc.compile_text(PENDULUM.format(initial)).simulate(stop=0.5, rtol=1e-9)
    assert {name: float(run[name][0]) for name in expected} == pytest.approx(expected, abs=1e-9)
    energy = (run["vx"] ** 2 + run["vy"] ** 2) / 2 + 9.81 * run["y"]
    assert energy == pytest.approx(energy[0], abs=1e-6)


@pytest.mark.parametrize("x0", [-1.0, -0.6, 0.0, 0.6, 1.0])
def test_parameters_of_initial_equations_may_ask_for_other_coordinates(x0):
    dae = lmoc.compile_text(PENDULUM.format("x = x0"))
    run = dae.simulate(stop=0.1, points=2, parameters={"x0": x0})
    assert run["x"][0] == pytest.approx(x0, abs=1e-12)
    assert run["x"] ** 2 + run["y"] ** 2 == pytest.approx(1.0, abs=1e-9)


@pytest.mark.parametrize("initial, code", [("x = 0.6; y = 0.7", "E0531"), ("x = 0.6; vx = 1; vy = 1", "E0531")])
def test_initial_equations_that_contradict_constraints_are_named(initial, code):
    with pytest.raises(ModelError) as wrong:
        lmoc.compile_text(PENDULUM.format(initial)).simulate(stop=0.1)
    assert [d.code for d in wrong.value.diagnostics] == [code]
    assert all(f"`{part.strip()}`" in wrong.value.diagnostics[0].message for part in initial.split(";"))


FOUR_BAR = """
model FourBar
  import Planar.*;
  inner World world;
  Ground left, right(x = 2);
  Revolute p, q, r, s;
  Bar crank(l = 0.5, m = 1), coupler(l = 2, m = 1), rocker(l = 1, m = 1);
equation
  connect(left.frame, p.a); connect(p.b, crank.a); connect(crank.b, q.a); connect(q.b, coupler.a);
  connect(coupler.b, r.a); connect(r.b, rocker.a); connect(rocker.b, s.a); connect(s.b, right.frame);
initial equation
  {};
end FourBar;
"""


@pytest.mark.parametrize(
    "wanted",
    [
        {"p.phi": 1.0, "p.omega": 2.0},
        {"coupler.b.y": 0.9, "der(coupler.b.y)": 0.3},
        {"r.phi": -1.5, "der(r.phi)": 1.0},
        {"crank.b.theta - rocker.b.theta": 0.0, "r.omega": 1.0},
        {"coupler.b.x^2 + coupler.b.y^2": 4.0, "s.omega": -1.0},
    ],
)
def test_initial_equations_of_a_loop_need_no_start_values(wanted):
    run = lmoc.compile_text(FOUR_BAR.format("; ".join(f"{k} = {v}" for k, v in wanted.items()))).simulate(
        stop=1e-3, points=21, rtol=1e-10
    )

    def values(text: str) -> np.ndarray:
        if text.startswith("der("):
            return np.gradient(values(text[4:-1]), run.time, edge_order=2)
        first, sign, second = (*text.split(" "), "", "")[:3]
        if not sign:
            name, _, power = text.partition("^")
            return run[name] ** int(power or 1)
        return values(first) + (1 if sign == "+" else -1) * values(second)

    for text, value in wanted.items():
        assert values(text)[0] == pytest.approx(value, abs=1e-5)
    x, y = run["crank.b.x"] - run["coupler.b.x"], run["crank.b.y"] - run["coupler.b.y"]
    assert np.hypot(x, y) == pytest.approx(2.0, abs=1e-9)


def test_an_initial_equation_that_leaves_no_start_is_named():
    """No start value tells the side of the circle, so that x is a state and 2 its value; y has none then."""
    text = """model P
  Real x, y, vx, vy, T;
initial equation
  x = 2;
equation
  der(x) = vx; der(y) = vy; der(vx) = -T*x; der(vy) = -T*y - 9.81; x^2 + y^2 = 1;
end P;"""
    with pytest.raises(ModelError) as wrong:
        lmoc.compile_text(text).simulate()
    (diagnostic,) = wrong.value.diagnostics
    assert "perhaps the model does not allow the initial equation `x = 2` in line 4" in diagnostic.hint


def test_a_parameter_that_the_start_gives_as_a_formula_follows_others():
    """No equation is left to solve: a stiff law of a pipe, whose factor the start gives, starts from any guess."""
    dae = lmoc.compile_text("""model M parameter Real dp = 1000, rate = 1e-4; parameter Real k(fixed = false);
      Real v(start = 0, fixed = true), p; initial equation k = dp/rate^2;
      equation p = k*v^2; der(v) = 1e-4; end M;""")
    for dp in (1000.0, 2000.0):
        run = dae.simulate(stop=1, points=3, parameters={"dp": dp})
        assert run["p"][-1] == pytest.approx(dp, rel=1e-9) and run["k"][-1] == dp / 1e-4**2


def test_the_start_of_a_parameter_that_is_found_is_a_guess():
    """A guess that is not met contradicts nothing (W0533 before)."""
    run = lmoc.compile_text("""model M parameter Real p(fixed = false, start = 1); Real x(start = 2, fixed = true);
      initial equation der(x) = 0; equation der(x) = 4 - p*x; end M;""").simulate(stop=1)
    assert run["p"] == pytest.approx(2) and run["x"] == pytest.approx(2) and not run.notes


def test_start_rows_with_steep_slopes_are_met_as_well_as_rounding_allows():
    """Lags of 1e-12 s in steady state: 1e-16 of a state is 1e-4 of its rate."""
    text = """model Steep
      parameter Real c[6] = {0.3, 0.7, 1.1, 1.3, 1.9, 2.3};
      Real w[6](each start = 0.5);
    equation
      for i in 1:6 loop
        der(w[i]) = 1e12*(cos(c[i]*w[i]) - w[i]);
      end for;
    initial equation
      der(w) = zeros(6);
    end Steep;"""
    w = lmoc.compile_text(text).simulate(times=[0.0])["w"][0]
    assert w == pytest.approx(np.cos([0.3, 0.7, 1.1, 1.3, 1.9, 2.3] * w), abs=1e-15)


@pytest.mark.parametrize("scale", [1.0, 1e-20])
def test_what_rounding_leaves_of_a_zero_is_zero(scale):
    """A relation would take it for a motion: 0.1 + 0.2 - 0.3 is 6e-17."""
    text = f"""model Left
      parameter Real a = 0.1, b = 0.2, c = 0.3;
      Real w, q;
      Boolean onwards = w > 0;
    equation
      der(q) = w;
      der(w) = if onwards then 1 else 0;
    initial equation
      w = {scale}*(a + b - c);
      q = {1 if scale == 1.0 else 0};
    end Left;"""
    run = lmoc.compile_text(text).simulate(stop=1.0)
    assert run["w"][0] == 0.0 and run["w"][-1] == 0.0


def test_a_start_value_next_to_zero_is_kept():
    text = """model Kept
      Real w(start = 1e-14), q(start = 1);
    equation
      der(q) = w;
      der(w) = 0;
    initial equation
      q^3 = 2;
    end Kept;"""
    run = lmoc.compile_text(text).simulate(times=[0.0])
    assert run["w"][0] == pytest.approx(1e-14, rel=1e-12) and run["q"][0] == pytest.approx(2 ** (1 / 3), rel=1e-12)


def test_what_is_wanted_small_beside_a_large_value_is_no_rounding() -> None:
    """It became zero without a word."""
    text = """model M parameter Real c(fixed = false), e(fixed = false), large(fixed = false);
        Real x(start = 1, fixed = true);
        initial equation c*e = 3e-16; e = 1; large = 5e18; equation der(x) = c*large; end M;"""
    assert lmoc.compile_text(text).simulate(stop=1)["x"][-1] == pytest.approx(1501, rel=1e-9)


def test_large_values_leave_no_rounding_in_what_the_rows_determine() -> None:
    rows, columns = (k.ravel() for k in np.indices((4, 4)))
    matrix = np.array([[2.0, 1, 0, 1], [1, 3, 1, 0], [0, 1, 2, 1], [1, 0, 1, 3]])
    jacobian, residual = (rows, columns, matrix.ravel()), np.array([1e-6, -2e-6, 0.0, 1e-6])
    step = split(jacobian, np.zeros(4, int), 4).step(jacobian, residual, np.full(4, 1e9))
    assert np.abs(matrix @ step + residual).max() < 1e-18


@pytest.mark.parametrize(
    ("row", "guess"),
    [("initial equation 0.5*m*v^2 = E0;", g) for g in (1.0, 0.0, -3.0)] + [("initial equation E = E0;", -3.0)],
)
def test_small_quantities_are_met_by_their_own_size(row: str, guess: float) -> None:
    """An energy of 1e-20 J is no zero for a mass of 1e-12 kg: what is met to 1e-7 of one was met by any velocity."""
    text = f"""
    model S
      parameter Real m(unit = "kg") = 1e-12;
      parameter Real E0(unit = "J") = 1e-20;
      Real v(unit = "m/s", start = {guess});
      Real E(unit = "J");
    {row}
    equation
      E = 0.5*m*v^2;
      m*der(v) = 0;
    end S;
    """
    dae = lmoc.compile_text(text)
    v = dae.simulate(times=[0.0])["v"][0]
    assert abs(v) == pytest.approx(np.sqrt(2e-8), rel=1e-9) and v * guess >= 0
    with pytest.raises(ModelError) as caught:
        dae.simulate(times=[0.0], parameters={"E0": -1e-20})
    assert [d.code for d in caught.value.diagnostics] == ["E0532"]
