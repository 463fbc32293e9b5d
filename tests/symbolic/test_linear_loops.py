"""Linear models of closed loops in symbols: against the numeric ones, differences of the motion, and closed forms."""

import numpy as np
import pytest
import sympy as sp
from conftest import ROOT
from mpmath import mp

import lmoc
from lmoc.symbolic.linearize import LinearModel

PLANAR = ROOT / "models/planar"


def numbers(model: LinearModel) -> dict[sp.Symbol, sp.Float]:
    return {s: sp.Float(v, 17) for s, v in (*model.loops.values.items(), *model.loops.numbers.items())}


def evaluated(matrix: sp.Matrix, model: LinearModel) -> np.ndarray:
    """Return a matrix whose entries hold parameters and coordinates at rest, and nothing else, as numbers."""
    allowed = set(model.loops.values) | set(model.loops.numbers) - set(model.loops.shorthand)
    assert matrix.free_symbols <= allowed
    table = numbers(model)
    with mp.workdps(30):  # many terms cancel
        found = sp.lambdify(list(table), matrix, "mpmath", cse=True)(*map(mp.mpf, map(str, table.values())))
    return np.array(found.tolist(), float).reshape(matrix.shape)


DRIVEN = """
model Rocker
  import Planar.*;
  parameter Real a = 0.3, b = 0.9, c = 0.8, d = 1.0;
  input Real M(unit = "N.m");
  inner World world;
  Ground left, right(x = d);
  Revolute motor(useShaft = true, phi(start = -1.8)), first, second, pivot;
  Bar crank(l = a, m = 1), coupler(l = b, m = 2, theta(start = 1)), rocker(l = c, m = 1.5, theta(start = 2.5));
  .Torque drive(tau = M);
  .TorsionDamper friction(c = 0.5);
  FixedShaft housing;
equation
  connect(left.frame, motor.a);
  connect(motor.b, crank.a);
  connect(crank.b, first.a);
  connect(first.b, coupler.a);
  connect(coupler.b, second.a);
  connect(second.b, rocker.b);
  connect(pivot.b, rocker.a);
  connect(right.frame, pivot.a);
  connect(drive.shaft, motor.shaft);
  connect(housing.shaft, friction.a);
  connect(friction.b, motor.shaft);
end Rocker;
"""


@pytest.fixture(scope="module")
def driven():
    """Return a four-bar with a torque as input, and a state of rest."""
    dae = lmoc.compile_text(DRIVEN)
    return dae, min(dae.equilibria(inputs={"M": 0}), key=lambda e: float(e["motor.phi"]))


@pytest.fixture(scope="module")
def piston():
    """Return a slider crank, and a state of rest off its dead centres."""
    dae = lmoc.compile(PLANAR / "slider_crank.lmo", parameters={"l": 1.2, "rod.m": 1.7})
    return dae, dae.equilibria()[-2]


@pytest.mark.parametrize("scene", ["driven", "piston"])
def test_the_linear_model_in_symbols_is_that_in_numbers(scene, request):
    dae, rest = request.getfixturevalue(scene)
    outputs = [*dae.states, "crank.theta", "rod.theta" if scene == "piston" else "coupler.omega"]
    ours, theirs = (dae.linearize(at=rest, symbolic=s, outputs=outputs) for s in (True, False))
    assert (ours.states, ours.outputs) == (theirs.states, theirs.outputs)
    for name in "ABC":
        expected = getattr(theirs, name)
        assert evaluated(getattr(ours, name), ours) == pytest.approx(expected, rel=1e-9, abs=1e-9)
    table = numbers(ours)
    for e in (*ours.loops.closures, *ours.loops.balance):
        assert abs(float(e.evalf(17, subs=table))) < 1e-9


def test_entries_are_differences_of_the_motion(piston):
    """Accelerations where runs start that begin beside the state of rest."""
    dae, rest = piston
    model = dae.linearize(at=rest, symbolic=True)

    def acceleration(theta: float, omega: float) -> float:
        run = dae.simulate(initial={"main.phi": theta, "main.omega": omega}, times=[0.0])
        return float(run["der(main.omega)"][0])

    at, h = float(rest["main.phi"]), 1e-4
    by_place = (acceleration(at + h, 0) - acceleration(at - h, 0)) / (2 * h)
    by_rate = (acceleration(at, h) - acceleration(at, -h)) / (2 * h)
    assert evaluated(model.A, model)[1] == pytest.approx([by_place, by_rate], rel=1e-6)


def test_the_transfer_function_of_a_four_bar_is_short_and_right(driven):
    """κ/(M s² + c s + K) with the transmission κ of the four-bar, which follows from the intersection of circles."""
    dae, rest = driven
    found = dae.transfer_function("M", "rocker.theta", at=rest)
    s = sp.Symbol("s")
    kappa = next(k for k, (of, _) in found.loops.meaning.items() if of.name == "pivot.phi")
    assert found.short.numerator == kappa
    assert sp.degree(found.short.denominator, s) == 2 and "M_e" in str(found.short.denominator)
    allowed = {s, *found.loops.values, *found.loops.numbers} - set(found.loops.shorthand)
    assert found.expression.free_symbols <= allowed

    def rocker(theta: float) -> float:
        x, y = 0.3 * np.cos(theta) - 1, 0.3 * np.sin(theta)
        distance = np.hypot(x, y)
        inside = np.arccos((distance**2 + 0.8**2 - 0.9**2) / (2 * distance * 0.8))
        return float(np.arctan2(y, x) - inside)

    at = float(rest["motor.phi"])
    assert rocker(at) % (2 * np.pi) == pytest.approx(found.loops.numbers[sp.Symbol("pivot.phi")] % (2 * np.pi))
    transmission = (rocker(at + 1e-6) - rocker(at - 1e-6)) / 2e-6
    assert found.loops.numbers[kappa] == pytest.approx(transmission, rel=1e-7)
    numeric = dae.linearize(at=rest, outputs="rocker.theta")
    omega = np.array([0.3, 3.0, 30.0])
    expected = [(numeric.C @ np.linalg.solve(1j * w * np.eye(2) - numeric.A, numeric.B))[0, 0] for w in omega]
    assert found.response(omega) == pytest.approx(expected, rel=1e-9)


def test_a_series_spring_and_damper_in_a_loop_is_a_state_of_first_order(driven):
    text = DRIVEN.replace(
        ".TorsionDamper friction(c = 0.5);",
        ".TorsionDamper friction(c = 0.5); .TorsionSpring spring(k = 40, theta0 = 0);",
    ).replace("connect(friction.b, motor.shaft);", "connect(friction.b, spring.a); connect(spring.b, motor.shaft);")
    dae = lmoc.compile_text(text)
    (between,) = set(dae.states) - {"motor.phi", "motor.omega"}
    rest = {"motor.phi": float(driven[1]["motor.phi"]), between: float(driven[1]["motor.phi"])}
    ours, theirs = (dae.linearize(at=rest, symbolic=s) for s in (True, False))
    assert evaluated(ours.A, ours) == pytest.approx(theirs.A, rel=1e-9, abs=1e-9)
    assert evaluated(ours.B, ours) == pytest.approx(theirs.B, rel=1e-9, abs=1e-9)


def test_parameters_without_values_stay_symbols():
    dae = lmoc.compile_text(DRIVEN.replace("a = 0.3", "a"))
    model = dae.linearize(at={"motor.phi": sp.pi / 3}, symbolic=True)
    assert model.loops.numbers == {} and {"a", "b"} <= {s.name for s in model.A.free_symbols}
    assert sp.Symbol("motor.phi") not in model.A.free_symbols  # an exact place is inserted


def test_a_place_that_is_no_state_of_rest_is_refused(driven):
    dae, _ = driven
    with pytest.raises(lmoc.ModelError, match="state of rest"):
        dae.linearize(at={"motor.phi": 0.5}, symbolic=True)
    assert not dae.linearize(at={"motor.phi": 0.5}).at_rest


@pytest.mark.parametrize("seed", range(2))
def test_random_loops_held_by_a_torque(driven, seed):
    """Other lengths, masses and places; the torque that holds the crank there follows from the numeric model."""
    dae, _ = driven
    generator = np.random.default_rng(seed)
    sizes = dict(zip("abcd", (0.3, 0.9, 0.8, 1.0) * generator.uniform(0.9, 1.1, 4), strict=True))
    masses = {
        f"{bar}.m": m for bar, m in zip(("crank", "coupler", "rocker"), generator.uniform(0.5, 3, 3), strict=True)
    }
    parameters = {**sizes, **masses}
    place = {"motor.phi": float(generator.uniform(-3, 3)), "motor.omega": 0.0}
    free = dae.linearize(at=place | {"M": 0.0}, parameters=parameters)
    held = {"M": float(-free.drift[1] / free.B[1, 0])}
    outputs = ["coupler.theta", "rocker.omega", "rocker.b.x"]
    ours, theirs = (
        dae.linearize(at=place, inputs=held, symbolic=s, outputs=outputs, parameters=parameters) for s in (True, False)
    )
    for name in "ABCD":
        expected = getattr(theirs, name)
        assert evaluated(getattr(ours, name), ours) == pytest.approx(expected, rel=1e-8, abs=1e-8)
