"""Derivatives of a motion by parameters and start values, against closed forms and differences of tight runs."""

import pickle

import numpy as np
import pytest
from conftest import ROOT

import lmoc
from lmoc.lower.series import LENGTH
from lmoc.messages.diagnostics import ModelError
from lmoc.numerics.evaluate.engine_system import EngineSystem
from lmoc.numerics.evaluate.tangent_system import TangentSystem

SWING = """
model Swing
  parameter Real k = 8, c = 0, m = 2, twice = 2*k;
  parameter Real t0 = 1;
  parameter Integer n = 2;
  output Real x(start = 1, fixed = true);
  Real v(start = 0.3, fixed = true);
  output Real force = twice/2*x + c*v;
  input Real f = 0;
equation
  der(x) = v;
  m*der(v) = -twice/2*x - c*v + f;
end Swing;
"""


@pytest.fixture(scope="module")
def dae():
    return lmoc.compile_text(SWING)


@pytest.mark.parametrize(("solver", "rtol"), [("auto", 1e-6), ("cvode", 1e-6), ("taylor", 1e-6), ("auto", 1e-10)])
def test_an_oscillator(dae, rtol, solver):
    run = dae.simulate(stop=5, points=41, rtol=rtol, solver=solver, sensitivities=("k", "m", "x", "v"))
    t, w = run.time, 2.0
    x = np.cos(w * t) + 0.3 / w * np.sin(w * t)
    by_w = -t * np.sin(w * t) + 0.3 * (t * np.cos(w * t) / w - np.sin(w * t) / w**2)
    exact = {"k": by_w * w / (2 * 8), "m": -by_w * w / (2 * 2), "x": np.cos(w * t), "v": np.sin(w * t) / w}
    for name, truth in exact.items():
        error = np.abs(run.sensitivity("x", name) - truth).max() / np.abs(truth).max()
        assert error < 100 * rtol, (name, error)
        force = 8 * truth + (x if name == "k" else 0)
        assert np.abs(run.sensitivity("force", name) - force).max() < 100 * rtol * np.abs(force).max()


def test_the_run_itself_is_the_same_to_the_last_bit(dae):
    plain, with_them = (dae.simulate(stop=3, points=9, sensitivities=names) for names in ((), ("k",)))
    assert np.array_equal(plain["x"], with_them["x"])


DECAY = """
model Decay
  parameter Real c(min = 2) = 2;
  output Real x(start = 1, fixed = true);
equation
  der(x) = -c*x;
end Decay;
"""


def test_a_parameter_may_stand_at_its_bound():
    run = lmoc.compile_text(DECAY).simulate(stop=2, points=21, rtol=1e-9, sensitivities="c")
    assert np.allclose(run.sensitivity("x", "c"), -run.time * np.exp(-2 * run.time), rtol=0, atol=1e-8)


def test_a_value_that_the_reduction_assumes_is_refused():
    dae = lmoc.compile_text(DECAY.replace("c(min = 2) = 2", "c = 0"))
    with pytest.raises(ModelError, match="the reduction assumes a value of 'c'"):
        dae.simulate(stop=2, sensitivities="c")


def _differences(dae, name, variable, initial, **options):
    """A difference of order four of runs at 1e-12."""
    base = dae.simulate(rtol=1e-12, **options)
    value = base[name][0] if initial else float(dae.parameters[name])
    step = 1e-3 * (abs(value) or 1.0)

    def run(k):
        given = {"initial" if initial else "parameters": {name: value + k * step}}
        return dae.simulate(rtol=1e-12, **options, **given)[variable]

    return (8 * (run(1) - run(-1)) - (run(2) - run(-2))) / (12 * step)


@pytest.mark.parametrize(
    ("file", "name", "initial", "variable"),
    [
        ("notes/ex05_suspension", "k1", False, "q2"), ("notes/ex05_suspension", "c2", False, "tire_force"),
        ("notes/ex05_suspension", "body.v", True, "q2"), 
        ("planar/double_pendulum", None, False, None), ("planar/crane", None, False, None),
    ],
)  # fmt: skip
def test_scenes(file, name, initial, variable):
    path = ROOT / "models" / f"{file}.lmo"
    if not path.exists():
        pytest.skip("no such scene")
    dae = lmoc.compile(path)
    name = name or next(
        n for n in dae.parameters if float(dae.parameters[n]) not in (0.0, 1.0) and n.endswith(("m", "l"))
    )
    variable = variable or dae.states[0]
    options = {"stop": 1.0, "points": 11, "energy": False}
    run = dae.simulate(rtol=1e-8, sensitivities=(name,), **options)
    truth = _differences(dae, name, variable, initial, **options)
    assert np.abs(run.sensitivity(variable, name) - truth).max() < 1e-6 * np.abs(truth).max()


def test_a_start_that_is_computed(dae):
    """At rest in the equilibrium x = f/k, for whatever k."""
    run = dae.simulate(stop=1, points=5, initial="equilibrium", inputs={"f": "4"}, sensitivities=("k",))
    assert np.allclose(run.sensitivity("x", "k"), -4 / 64, atol=1e-7)


def test_kinks_in_time_may_move_with_a_parameter(dae):
    """x from t0 on under f = 3: the answer to the step, (3/k)(1 - cos 2(t - t0)), comes later with it."""
    push = {"f": "if time < t0 then 0 else 3"}
    run = dae.simulate(stop=3, points=13, rtol=1e-9, inputs=push, sensitivities=("k", "t0"))
    truth = _differences(dae, "k", "x", False, stop=3, points=13, inputs=push)
    assert np.abs(run.sensitivity("x", "k") - truth).max() < 1e-6 * np.abs(truth).max()
    late = -3 / 4 * np.sin(2 * np.maximum(run.time - 1, 0))
    assert np.abs(run.sensitivity("x", "t0") - late).max() < 1e-7


def test_where_there_are_none_it_is_said():
    dae = lmoc.compile_text(SWING.replace("- c*v + f", "- noEvent(sign(v))*c + f"))
    with pytest.raises(ModelError, match="E0575"):
        dae.simulate(stop=0.5, sensitivities=("k",))


def test_what_smooth_says_to_be_continuous_has_derivatives():
    """y' = k x² where x = t - p is above zero: y = k (t - p)³/3 from then on."""
    model = "model A parameter Real k = 3, p = 0.4; Real x(start = -p, fixed = true), y(start = 0, fixed = true); "
    model += "equation der(x) = 1; der(y) = {}if x > 0 then k*x^2 else 0); end A;"
    dae = lmoc.compile_text(model.format("smooth(1, "))
    run = dae.simulate(times=[0, 0.3, 0.7, 1.5], rtol=1e-9, sensitivities=("k", "p"))
    late = np.maximum(run.time - 0.4, 0)
    assert run.sensitivity("y", "k") == pytest.approx(late**3 / 3, abs=1e-7)
    assert run.sensitivity("y", "p") == pytest.approx(-3 * late**2, abs=1e-7)
    with pytest.raises(ModelError, match="jump"):
        lmoc.compile_text(model.format("noEvent(")).simulate(stop=1, sensitivities="k")


def test_what_smooth_says_to_be_continuous_may_bend():
    """v' = -1 - c v on the way up, -1 - d v on the way down."""
    model = "model A parameter Real c = 1, d = 3; Real v(start = 2, fixed = true); "
    model += "equation der(v) = -1 - smooth(0, if v > 0 then c*v else d*v); end A;"
    run = lmoc.compile_text(model).simulate(stop=2, points=20, rtol=1e-9, sensitivities=("c", "d"))

    def velocity(c, d):
        s = run.time - np.log(1 + 2 * c) / c
        return np.where(s < 0, (2 + 1 / c) * np.exp(-c * run.time) - 1 / c, (np.exp(-d * s) - 1) / d)

    h = 1e-5
    assert run.sensitivity("v", "c") == pytest.approx((velocity(1 + h, 3) - velocity(1 - h, 3)) / (2 * h), abs=1e-7)
    assert run.sensitivity("v", "d") == pytest.approx((velocity(1, 3 + h) - velocity(1, 3 - h)) / (2 * h), abs=1e-7)


def test_a_power_of_zero_does_not_depend_on_its_exponent():
    """y' = t^n: from t = 0 on, where the logarithm of t is none."""
    model = "model A parameter Real n = 1.5; Real x(start = 0, fixed = true), y(start = 0, fixed = true); "
    dae = lmoc.compile_text(model + "equation der(x) = 1; der(y) = x^n; end A;")
    run = dae.simulate(times=[1, 2], rtol=1e-9, sensitivities="n")
    truth = [t**2.5 * (np.log(t) / 2.5 - 1 / 2.5**2) for t in (1, 2)]
    assert run.sensitivity("y", "n") == pytest.approx(truth, abs=1e-7)


def test_a_parameter_that_a_condition_reads_has_derivatives_inside_it():
    """As the friction of a contact: x' = -k x if k > 0, and 1 otherwise."""
    model = "model A parameter Real k = {}; Real x(start = 1, fixed = true); "
    model += "equation if k > 0 then der(x) = -k*x; else der(x) = 1; end if; end A;"
    run = lmoc.compile_text(model.format(2)).simulate(stop=1, points=5, rtol=1e-9, sensitivities="k")
    assert run.sensitivity("x", "k") == pytest.approx(-run.time * np.exp(-2 * run.time), abs=1e-7)
    with pytest.raises(ModelError, match="a condition is on its edge"):
        lmoc.compile_text(model.format(0)).simulate(stop=1, sensitivities="k")


@pytest.mark.parametrize("asked", ["kk", "n", "f"])
def test_what_cannot_be_asked_for(dae, asked):
    with pytest.raises(ModelError):
        dae.simulate(stop=1, sensitivities=(asked,))


def test_runs_without_them_say_how_to_get_them(dae):
    with pytest.raises(KeyError, match="sensitivities="):
        dae.simulate(stop=1).sensitivity("x", "k")
    run = pickle.loads(pickle.dumps(dae.simulate(stop=1, points=3, sensitivities="k")))  # noqa: S301
    with pytest.raises(KeyError, match="asked for by k"):
        run.sensitivity("x", "m")
    assert run.sensitivity("x", "k").shape == (3,)


@pytest.mark.parametrize(
    ("file", "name", "variable", "stop"),
    [("classic/andrews", "c0", "beta", 0.015), ("planar/four_bar", "coupler.l", "rocker.theta", 1.0)],
)
def test_closed_loops(file, name, variable, stop):
    """Blocks that Newton's method solves are differentiated with their own matrix, starts with that of the assembly."""
    dae, options = lmoc.compile(ROOT / f"models/{file}.lmo"), {"stop": stop, "points": 16, "energy": False}
    run = dae.simulate(rtol=1e-8, sensitivities=name, **options)
    truth = _differences(dae, name, variable, False, **options)
    assert np.abs(run.sensitivity(variable, name) - truth).max() < 1e-6 * np.abs(truth).max()


def test_tangents_are_the_jacobian_times_the_directions():
    """Two states, an input from Python and a parameter, in two directions: S' = f_x S + f_p D."""
    dae = lmoc.compile_text(SWING)
    observer = dae.simulate(stop=1, points=3, inputs={"f": np.sin}, energy=False).trajectory.segments[0].observer
    plan = observer.plan
    inputs, outputs = (np.append(own, plan.parameters) for own in (plan.states, plan.derivatives))
    own = EngineSystem(plan, plan.program, inputs, outputs)
    own.prepare(observer.base, observer.signals)
    directions = np.linspace(-1.0, 2.0, 2 * len(plan.parameters)).reshape(-1, 2)
    system = TangentSystem(plan, plan.parameters, directions)
    system.prepare(observer.base, observer.signals)
    n, x, tangents = len(plan.states), np.array([0.4, -0.3]), np.array([[1.0, 2.0], [-0.5, 3.0]])
    rates = np.empty(3 * n)
    system.rhs(0.7, np.append(x, tangents), rates)
    matrix = own.jacobian(0.7, np.append(x, observer.base[plan.parameters]))[:n]
    assert rates[:n] == pytest.approx(own.registers[plan.derivatives], abs=0)
    exact = tangents @ matrix[:, :n].T + directions.T @ matrix[:, n:].T
    assert rates[n:].reshape(2, n) == pytest.approx(exact, rel=1e-14)
    assert system.jacobian(0.7, np.append(x, tangents)) == pytest.approx(np.kron(np.eye(3), matrix[:, :n]))


@pytest.mark.parametrize("file", ["notes/ex05_suspension", "planar/pendulum_cartesian", "planar/four_bar"])
def test_tangents_have_a_series(file):
    """The derivatives of a program as a program, blocks included: the same rates, and a polynomial that meets them."""
    dae = lmoc.compile(ROOT / f"models/{file}.lmo")
    observer = dae.simulate(stop=0.1, points=3, energy=False).trajectory.segments[0].observer
    plan = observer.plan
    moving = np.flatnonzero(np.isin(np.arange(plan.count), plan.parameters) & (observer.base != 0))[:3]
    system = TangentSystem(plan, moving, np.eye(3) * observer.base[moving][:, None])
    series, n = system.with_series(None), len(plan.states)
    for one in (system, series):
        one.prepare(observer.base, observer.signals)
    x = np.append(dae.simulate(stop=0.1, points=3, energy=False).trajectory.table[-1], np.linspace(-1.0, 1.0, 3 * n))
    rates, own, q = np.empty(4 * n), np.empty(4 * n), np.zeros((4 * n, LENGTH))
    system.rhs(0.1, x, rates)
    series.rhs(0.1, x, own)
    assert own == pytest.approx(rates, rel=1e-12, abs=1e-12 * np.abs(rates).max())
    assert series.series(0.1, x, 18, q.ctypes.data)
    h, later, slope = 1e-3, np.empty(4 * n), np.arange(1, 19) * 1e-3 ** np.arange(18)
    system.rhs(0.1 + h, np.polynomial.polynomial.polyval(h, q.T[:19]), later)
    assert q[:, 1:19] @ slope == pytest.approx(later, rel=1e-9, abs=1e-9 * np.abs(later).max())


def test_changes_of_coordinates():
    """A Cartesian pendulum changes from x to y and back; it swings as one in its angle does."""
    file = ROOT / "models/planar/pendulum_cartesian.lmo"
    dae, names = lmoc.compile(file), ("g", "L")
    run = dae.simulate(stop=3, points=31, rtol=1e-9, sensitivities=names)
    assert len(run.trajectory.segments) > 3
    for name in names:
        value = float(dae.parameters[name])
        low, high = (
            dae.simulate(stop=3, points=31, rtol=1e-12, parameters={name: value * (1 + h)}) for h in (-1e-5, 1e-5)
        )
        for variable in ("x", "y", "vx", "lambda"):
            slope = (high[variable] - low[variable]) / (2e-5 * value)
            assert np.abs(run.sensitivity(variable, name) - slope).max() < 1e-6 * np.abs(slope).max()
    # with x = L sin(a), a'' = -g/L sin(a): of another g there is the same swing in another time
    exact = run["vx"] * run.time / (2 * 9.81)
    assert np.abs(run.sensitivity("x", "g") - exact).max() < 1e-6


def test_a_motion_that_stays_on_a_kink_is_refused():
    """x = 0 for all time, but δ e^t beside it on the one side, and δ e^-t on the other."""
    model = "model A Real x(start = {}, fixed = true), y(start = 0, fixed = true); equation der(x) = {}abs(x); "
    model += "der(y) = abs(x - time); end A;"
    with pytest.raises(ModelError, match="kink"):
        lmoc.compile_text(model.format(0, "")).simulate(stop=1, points=5, sensitivities="x")
    run = lmoc.compile_text(model.format(0.5, "0*")).simulate(stop=2, points=5, rtol=1e-9, sensitivities="x")
    assert run.sensitivity("y", "x") == pytest.approx(np.minimum(run.time, 1.0 - run.time), abs=1e-7)
