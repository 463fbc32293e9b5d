"""Linear models in numbers: against finite differences and against the symbolic ones, on all small models."""

from pathlib import Path

import numpy as np
import pytest
import sympy as sp
from oracles.models import compiled
from oracles.symbolic_truth import IMPLICIT
from scipy.optimize import brentq

import lmoc
from lmoc.ir.prepared import Prepared
from lmoc.messages.diagnostics import ModelError
from lmoc.symbolic.linearize import linearize
from lmoc.symbolic.numeric import MOST_STATES as LARGEST
from lmoc.symbolic.numeric import NumericSystem, linearize_numerically
from lmoc.symbolic.rests import equilibria_numerically
from lmoc.symbolic.too_long import NoSymbolsError

ROOT = Path(__file__).parents[2]
WITH_LAWS = {"notes/fig6_slack_string", "notes/ex08_slack_cable"}  # solved mode by mode
MODELS = sorted(f"{folder}/{p.stem}" for folder in ("notes", "hard") for p in (ROOT / "models" / folder).glob("*.lmo"))
MODELS = [name for name in MODELS if name not in WITH_LAWS]
MOST_STATES = 12
every_model = pytest.mark.parametrize("name", MODELS)


def point_of(system: NumericSystem) -> dict[str, float]:
    generator = np.random.default_rng(5)
    names = [*system.states, *system.inputs]
    return dict(zip(names, generator.uniform(0.1, 0.6, len(names)), strict=True))


@every_model
def test_central_differences(name):
    dae = compiled(name)
    system = NumericSystem(dae.reduced, dae.values, ())
    point = point_of(system)
    model = linearize_numerically(dae.reduced, dae.values, point, ())
    x, u = (np.array([point[n] for n in names]) for names in (system.states, system.inputs))
    for matrix, at, rates in (
        (model.A, x, lambda z: system.rates(z, u)),
        (model.B, u, lambda z: system.rates(x, z)),
    ):
        for j in range(len(at)):
            step = 1e-5 * np.eye(len(at))[j]
            difference = (rates(at + step) - rates(at - step)) / 2e-5
            size = max(1.0, np.abs(matrix).max(initial=0.0))
            assert np.allclose(matrix[:, j], difference, rtol=1e-6, atol=1e-6 * size)


@pytest.mark.parametrize("name", [name for name in MODELS if name != "hard/h27_car_axis"])  # as long as all others
def test_numbers_equal_symbols(name):
    dae = compiled(name)
    if len(dae.states) > MOST_STATES:
        with pytest.raises(ModelError, match="too many"):
            dae.symbolic()
        return
    if name.removeprefix("hard/") in IMPLICIT:
        with pytest.raises(NoSymbolsError, match="no solution in closed form"):
            dae.symbolic()
        return
    system = dae.symbolic()
    point = point_of(NumericSystem(dae.reduced, dae.values, ()))
    outputs = dae.outputs or dae.states
    numeric = linearize_numerically(dae.reduced, dae.values, point, outputs)
    exact = linearize(system, {sp.Symbol(n): sp.Float(v, 17) for n, v in point.items()})
    for a, b in ((numeric.A, exact.A), (numeric.B, exact.B), (numeric.C, exact.C), (numeric.D, exact.D)):
        assert np.allclose(a, b, rtol=1e-9, atol=1e-9 * max(1.0, np.abs(b).max(initial=0.0)))
    assert np.allclose(
        numeric.drift, exact.drift, rtol=1e-9, atol=1e-9 * max(1.0, np.abs(exact.drift).max(initial=0.0))
    )


def test_about_the_equilibrium_by_default():
    model = compiled("notes/ex05_suspension").linearize()
    assert model.at_rest
    values = compiled("notes/ex05_suspension").parameters
    assert model.point["wheel.q"] == pytest.approx(-(values["m1"] + values["m2"]) * values["g"] / values["k1"])


def test_about_a_time_of_the_run():
    dae = compiled("notes/s9_lever_large_angles")
    model = dae.linearize(at=0.5)
    run = dae.simulate(times=[0.0, 0.5])
    theta = run["theta"][1]
    values = dae.parameters
    expected = -values["k"] * values["l2"] ** 2 * np.cos(2 * theta) / values["J"]
    damping = values["c"] * values["l1"] ** 2 * np.sin(2 * theta) * run["v_theta"][1] / values["J"]
    assert model.A[1, 0] == pytest.approx(expected + damping, rel=1e-6)
    assert not model.at_rest


def test_about_a_point_by_names():
    model = compiled("notes/s9_lever_large_angles").linearize(at={"body.theta": np.pi / 2})
    assert model.stability == "unstable"


def test_several_equilibria_are_not_chosen_from():
    with pytest.raises(ModelError, match="not one equilibrium"):
        compiled("notes/s9_lever_large_angles").linearize()


def test_each_of_several_equilibria_is_a_point():
    dae = compiled("notes/s9_lever_large_angles")
    found = {dae.linearize(at=e).stability for e in dae.equilibria()}
    assert found == {"asymptotically stable", "unstable"}


def test_unknown_name_of_a_point():
    with pytest.raises(ModelError, match="neither a state nor an input"):
        compiled("notes/ex02_spring_mass_damper").linearize(at={"mass.x": 1.0})


def test_parameters_of_one_derivation():
    dae = compiled("notes/ex02_spring_mass_damper")
    model = dae.linearize(parameters={"k": 200.0, "m": 2.0})
    assert np.allclose(model.frequencies, 10.0)
    assert np.allclose(dae.linearize().frequencies, 5.0)


def test_a_zero_changes_the_equations():
    dae = compiled("notes/ex02_spring_mass_damper")
    assert dae.equations(parameters={"c": 0.0}).lines() == ["m·q̈ + k·q = f"]


def test_files_for_other_tools(tmp_path):
    from scipy.io import loadmat

    model = compiled("notes/ex02_spring_mass_damper").linearize()
    model.save(str(tmp_path / "model.mat"))
    assert np.allclose(loadmat(tmp_path / "model.mat")["A"], model.A)
    assert np.allclose(model.to_scipy().A, model.A)


def test_large_chain_has_its_known_frequencies():
    n = 40
    dae = lmoc.compile(ROOT / "models/bench/chain.lmo", parameters={"N": n, "c": 0.0})
    expected = (
        2 * np.sqrt(dae.parameters["k"] / dae.parameters["m"]) * np.sin(np.arange(1, n + 1) * np.pi / (2 * (n + 1)))
    )
    found = dae.linearize().frequencies
    assert np.allclose(np.sort(found)[::2], np.sort(expected), rtol=1e-9)


def test_a_scene_too_large_for_symbols_still_rests():
    dae = lmoc.compile(ROOT / "models/bench/chain.lmo", parameters={"N": 200})
    (found,) = dae.equilibria()
    assert found.isolated and all(abs(float(v)) < 1e-12 for v in found.values.values())
    assert found.stability == "asymptotically stable" and "Newton" in found.how


@pytest.mark.parametrize("k", [1e3, 1e11, 1e16])
def test_what_is_stiff_leaves_nothing_beside_it_free(k):
    dae = lmoc.compile_text(
        f"""
        model Beside
          Fixed wall;
          Mass a(m = 1, g = 9.81), b(m = 1, g = 9.81), car(m = 1);
          Spring stiff(k = {k}), soft(k = 1);
        equation
          connect(wall.flange, stiff.a);
          connect(stiff.b, a.flange);
          connect(wall.flange, soft.a);
          connect(soft.b, b.flange);
        end Beside;
        """
    )
    (found,) = equilibria_numerically(Prepared(dae.flat, dae.reduced, dae.values), {})
    assert [x.name for x in found.free] == ["car.q"]
    assert float(found["b.q"]) == pytest.approx(9.81)
    assert float(found["a.q"]) == pytest.approx(9.81 / k, rel=1e-9, abs=1e-12)


def test_equilibria_know_their_inputs():
    with pytest.raises(ModelError, match="neither a state nor an input"):
        compiled("notes/ex02_spring_mass_damper").equilibria(inputs={"g": 1.0})


def test_a_value_given_from_outside_stays_a_symbol():
    parts = "Fixed w; Spring s(k = 50); Mass b(m = 2);"
    text = f"model A {parts} equation connect(w.flange, s.a); connect(s.b, b.flange); end A;"
    given = lmoc.compile_text(text, parameters={"s.k": 60, "b.g": 9.81}).equations()
    assert given.lines() == ["m·q̈ + k·q = g·m"]
    assert lmoc.compile_text(text).equations().lines() == ["m·q̈ + k·q = 0"]


def test_a_missing_value_is_asked_for_by_the_parameter_to_give():
    scene = lmoc.compile_text(
        "model M parameter Real J1; input Real u; Inertia rotor(J=J1); Torque t(tau=u);"
        " equation connect(t.shaft, rotor.shaft); end M;"
    )
    with pytest.raises(lmoc.ModelError, match="no value for J1"):
        scene.linearize(at={"rotor.theta": 0.0})


PENDULUM = """
model Pendulum
  parameter Real m = 1, l = 0.5, g = 9.81;
  input Real tau = 0;
  Real theta(start = 0.3, fixed = true), w(start = 0, fixed = true);
equation
  der(theta) = w;
  m*l^2*der(w) = tau - m*g*l*sin(theta);
  annotation(experiment(StartTime = 2, StopTime = 5));
end Pendulum;
"""


def test_an_equilibrium_under_load_is_a_point_with_its_inputs():
    dae = lmoc.compile_text(PENDULUM)
    found = dae.equilibria(inputs={"tau": 2.0})
    expected = np.arcsin(2.0 / (9.81 * 0.5))
    assert [float(e["theta"]) for e in found] == pytest.approx([expected, np.pi - expected])
    for e, sign in zip(found, (1, -1), strict=True):
        model = dae.linearize(at=e)
        assert model.at_rest and model.point["tau"] == 2.0
        assert model.A[1, 0] == pytest.approx(-sign * 9.81 / 0.5 * np.cos(expected))
        poles = dae.transfer_function("tau", "theta", at=e).poles
        assert poles**2 == pytest.approx(model.A[1, 0] * np.ones(2))


def test_a_run_gives_its_last_point_and_its_parameters():
    dae = lmoc.compile_text(PENDULUM)
    run = dae.simulate(times=[2.0, 3.0], parameters={"l": 0.8})
    model = dae.linearize(at=run)
    assert model.point["theta"] == run["theta"][-1]
    expected = dae.linearize(at=dict(model.point), parameters={"l": 0.8})
    assert np.array_equal(model.A, expected.A) and not np.array_equal(model.A, dae.linearize(at=dict(model.point)).A)
    with pytest.raises(ModelError, match="a model in symbols"):
        dae.linearize(at=run, symbolic=True)
    with pytest.raises(TypeError, match="a time, {name: value}, an equilibrium or a run, not str"):
        dae.linearize(at="rest")


def test_a_time_counts_from_the_start_of_the_experiment():
    dae = lmoc.compile_text(PENDULUM)
    assert dae.linearize(at=2).point["theta"] == pytest.approx(0.3)
    run = dae.simulate(times=[2.0, 3.0])
    assert dae.linearize(at=3.0).point["theta"] == pytest.approx(run["theta"][1], rel=1e-5)
    with pytest.raises(ModelError, match="starts at 2 s"):
        dae.linearize(at=1.0)


@pytest.mark.parametrize("width", [1e-12, 1e-9, 1e-4, 1.0, 1e2, 1e6])
def test_equilibria_of_any_size_are_seen(width):
    dae = lmoc.compile_text(
        f"""
        model Snap
          parameter Real a(unit = "m") = {width}, g(unit = "m/s2") = 1, c(unit = "1/s") = 1;
          Real x(unit = "m"), v(unit = "m/s");
        equation
          der(x) = v;
          der(v) = g*(tanh(x/a) - x/(2*a)) - c*v;
        end Snap;
        """
    )
    found = [float(e["x"]) / width for e in dae.equilibria()]
    assert found == pytest.approx([-1.9150080481545, 0.0, 1.9150080481545], abs=1e-9)


def test_equations_of_very_different_sizes_leave_nothing_free():
    """Written with R^2 as a factor, one is 1e13 times the other, which was taken for a state of rest at any y."""
    dae = lmoc.compile_text(
        """
        model Two
          parameter Real a(unit = "m") = 1, R(unit = "m") = 6.4e6, k(unit = "1/s2") = 100, c(unit = "1/s") = 1;
          Real x(unit = "m"), v(unit = "m/s"), y(unit = "m"), u(unit = "m/s");
        equation
          der(x) = v;
          der(v) = -k*x*(1 - 1.2*a/sqrt(x^2 + a^2)) - c*v + k*(y - x)^3/R^2;
          der(y) = u;
          der(u) = -k*y*(1 - 1.2*a/sqrt(y^2 + a^2)) - c*u + 0.1*k*x;
        end Two;
        """
    )
    found = sorted((float(e["x"]), float(e["y"])) for e in dae.equilibria())
    beside = np.sqrt(1.2**2 - 1)
    far = brentq(lambda y: y * (1 - 1.2 / np.hypot(y, 1)) - 0.1 * beside, 0.7, 2)
    expected = [(-beside, -far), (0, -beside), (0, 0), (0, beside), (beside, far)]
    assert np.array(found) == pytest.approx(np.array(expected), abs=1e-9)


def test_even_roots_are_exact_where_their_sign_is_known():
    import sympy as sp

    text = "model D parameter Real a = {}, b = 1; Real x, v; equation der(x) = v; der(v) = a*x - b*x^3 - v; end D;"
    found = lmoc.compile_text(text.format(4)).equilibria()
    a, b = sp.symbols("a b")
    assert [e["x"] for e in found] == [-sp.sqrt(a / b), 0, sp.sqrt(a / b)] and found.how == "exact"
    assert [e["x"] for e in lmoc.compile_text(text.format(-4)).equilibria()] == [0]


def test_nothing_rests_that_time_drives_even_where_there_are_no_symbols():
    dae = lmoc.compile_text(
        "model T parameter Real k = 3; Real x, y; equation der(x) = -y; y + 0.1*sin(y) = k*x - cos(time); end T;"
    )
    with pytest.raises(ModelError, match="time itself"):
        dae.equilibria()


def frequency_response(model, omega):
    n = len(model.states)
    proper = model.realization()
    powers = [D[0, 0] * (1j * omega) ** k for k, D in enumerate(proper.Ds)]
    return (proper.C @ np.linalg.solve(1j * omega * np.eye(n) - proper.A, proper.B))[0, 0] + sum(powers)


@pytest.mark.parametrize(
    ("scene", "u", "y"),
    [
        ("notes/ex05_suspension", "u", "q2"),
        ("notes/ex05_suspension", "u", "tire_force"),
        ("notes/ex04_moving_frame", "f", "q2"),
        ("hard/h21_prescribed_rotation", "u", "tau1"),
    ],
)
def test_transfer_functions_in_numbers_are_those_in_symbols(scene, u, y):
    from lmoc.symbolic.transfer import transfer_function_of_numbers

    dae = compiled(scene)
    model = dae.linearize(outputs=[y])
    found, expected = transfer_function_of_numbers(model, u, y), dae.transfer_function(u, y)
    for a, b in zip(found.coefficients, expected.coefficients, strict=True):
        assert np.allclose(a, b, rtol=1e-9, atol=1e-9 * np.abs(b).max())
    assert found.response(np.array([3.0]))[0] == pytest.approx(frequency_response(model, 3.0))


def test_a_scene_without_closed_form_has_a_transfer_function_in_numbers():
    text = """
    model Bent
      input Real u = 0;
      Real x(start = 0), v, y;
    equation
      der(x) = v;
      der(v) = u - y - 0.5*v;
      y + 0.2*sin(y) = 3*x;
    end Bent;
    """
    tf = lmoc.compile_text(text).transfer_function("u", "x")
    assert str(tf.input_output_equation) == "(p² + 0.5·p + 2.5) x = u"
    assert tf.coefficients[1] == pytest.approx([1, 0.5, 3 / 1.2]) and tf.gain == pytest.approx(0.4)


def test_a_root_found_in_numbers_comes_with_numbers_only():
    """A spring between two cubic ones has no closed form: what follows linearly from the root is no symbol either."""
    scene = lmoc.compile_text(
        "model T Mass m(m = 1, g = 9.81); CubicSpring a(k = 3, d0 = 0.1); Spring b(k = 2); Mass m2(m = 3); "
        "CubicSpring c(k = 1); Fixed w; equation connect(w.flange, a.a); connect(a.b, m.flange); "
        "connect(m.flange, b.a); connect(b.b, m2.flange); connect(m2.flange, c.a); connect(c.b, w.flange); end T;"
    )
    (rest,) = scene.equilibria()
    q, r = float(rest["m.q"]), float(rest["m2.q"])
    assert 9.81 - 3 * (q - 0.1) ** 3 + 2 * (r - q) == pytest.approx(0, abs=1e-9)
    assert -2 * (r - q) - r**3 == pytest.approx(0, abs=1e-9)


DRIVEN = """
model Driven
  parameter Real F0(unit="N") = 3;
  input Real u(unit="N");
  Mass m(m = 2); Spring s(k = 8); Fixed w; Force f(f = u);
equation
  connect(w.flange, s.a); connect(s.b, m.flange); connect(f.flange, m.flange);
end Driven;
"""


@pytest.mark.parametrize("text", ["__import__('os').system('touch executed')", "open('executed', 'w')", "u.x", "time"])
def test_text_is_never_executed(text, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    dae = lmoc.compile_text(DRIVEN)
    for ask in (
        lambda: dae.equilibria(inputs={"u": text}),
        lambda: dae.linearize(inputs={"u": text}),
        lambda: dae.linearize(at={"m.q": text}),
        lambda: dae.linearize(at={"m.q": text}, symbolic=True),
        lambda: dae.transfer_function("u", "m.q", at={"m.q": text}),
        lambda: dae.equations().about({"m.q": text}),
    ):
        with pytest.raises(ModelError):
            ask()
    assert not list(tmp_path.iterdir())


def test_a_text_is_a_formula_of_the_language():
    dae = lmoc.compile_text(DRIVEN)
    (rest,) = dae.equilibria(inputs={"u": "F0*sin(pi/2) + 5"})
    assert rest["m.q"].subs({"F0": 3, "s.k": 8}) == 1
    assert dae.linearize(at={"m.q": "F0/2", "u": "12"}).point == {"m.q": 1.5, "m.v": 0.0, "u": 12.0}


@pytest.mark.parametrize("value", [None, [1.0], {"a": 1}])
def test_values_that_are_no_numbers(value):
    with pytest.raises(ModelError, match="'u' does not fit"):
        lmoc.compile_text(DRIVEN).equilibria(inputs={"u": value})


def test_one_name_is_enough():
    dae = lmoc.compile_text(DRIVEN)
    assert dae.linearize(outputs="m.q").outputs == ["m.q"]
    assert dae.linearize(outputs="m.q", symbolic=True).outputs == ["m.q"]
    assert list(dae.symbolic("s.f").variables) == ["s.f"]


@pytest.mark.parametrize("verb", ["linearize", "equilibria"])
def test_full_matrices_that_take_gigabytes_are_refused(verb):
    dae = lmoc.compile_text(f"model M Mass m[{LARGEST}](each m = 1); end M;")
    with pytest.raises(lmoc.ModelError, match="too large"):
        getattr(dae, verb)()
