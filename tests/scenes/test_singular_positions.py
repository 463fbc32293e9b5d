"""Places at which coordinates or constraints come to an end: right on the other side, or a clear stop; never wrong."""

import re

import numpy as np
import pytest
from oracles.models import CONNECTED_SLIDER_CRANK, PARALLELOGRAM, compiled_text
from scipy.integrate import solve_ivp

import lmoc
from lmoc.engine.compiler import find_compiler

G = 9.81
ISOSCELES = """model Isosceles "a slider crank whose crank is as long as its rod"
  import Planar.*;
  inner World world(g = 0);
  Ground ground;
  Revolute main(phi(start = 0.5, fixed = true), omega(start = 2, fixed = true)), pin(phi(start = -1)), gudgeon;
  Bar crank(l = 1, m = 1), rod(l = 1, m = 1);
  Prismatic line(s(start = 1.7));
  Body slider(m = 1, J = 1);
equation
""" + CONNECTED_SLIDER_CRANK + """
end Isosceles;"""


@pytest.fixture
def no_compiler(monkeypatch):
    """Have no C compiler found; it is looked for once, so anew before and after."""
    monkeypatch.setenv("LMOC_CC", "")
    find_compiler.cache_clear()
    yield
    monkeypatch.undo()
    find_compiler.cache_clear()


def upright(ratio: float, omega: float, times: np.ndarray) -> np.ndarray:
    """Angles from the upright of θ'' = ratio·g·sin θ."""
    return solve_ivp(lambda t, z: [z[1], ratio * G * np.sin(z[0])], (0, times[-1]), [0, omega], "DOP853", times,
                     rtol=1e-13, atol=1e-13).y[0]  # fmt: skip


@pytest.mark.parametrize(
    ("rtol", "solver", "allowed"),
    [
        (1e-3, "dop853", 0.1),
        (1e-5, "auto", 0.01),
        (1e-6, "cvode", 0.02),
        (1e-8, "taylor", 1e-6),
        (1e-10, "dop853", 1e-8),
    ],
)
def test_parallelogram_goes_on_as_one_through_its_flat_positions(rtol, solver, allowed):
    """(5/3)·θ'' = 2·g·sin θ: the bars are in line four times in 4 s, where they could cross as well."""
    run = compiled_text(PARALLELOGRAM).simulate(stop=4, points=101, rtol=rtol, solver=solver)
    assert np.abs(run["first.phi"] - np.pi / 2 + upright(1.2, -1, run.time)).max() < allowed
    assert np.abs(run["second.phi"] - run["first.phi"]).max() < 1e-12
    assert [n.message.split(" were")[0] for n in run.notes if n.code == "N0633"] == ["4 singular positions"]


@pytest.mark.parametrize("compiler", ["own", "none"])
@pytest.mark.parametrize(("rtol", "solver"), [(1e-3, "dop853"), (1e-5, "auto"), (1e-8, "taylor")])
def test_singular_positions_are_counted_and_told_when_they_are(request, compiler, rtol, solver):
    """Once each, where the bars are in line, though Newton's method goes over to crossed bars before some of them."""
    if compiler == "none":
        request.getfixturevalue("no_compiler")
    run = lmoc.compile_text(PARALLELOGRAM).simulate(stop=4, points=101, rtol=rtol, solver=solver)
    (note,) = [n.message for n in run.notes if n.code == "N0633"]
    assert note.startswith("4 singular positions were passed, the first at t = ")
    times = np.linspace(0, 1, 1001)
    expected = np.interp(np.pi / 2, upright(1.2, 1, times), times)
    assert float(note.split("t = ")[1].split()[0]) == pytest.approx(expected, abs=1e-4)


@pytest.mark.parametrize(("solver", "tolerances"), [("taylor", (1e-7, 1e-9)), ("gauss", (1e-6,))])
def test_neighbouring_tolerances_pass_alike_without_a_compiler(no_compiler, solver, tolerances):
    """A step that leads too far is tried again from the branch on which it began, not from where it has ended."""
    dae = lmoc.compile_text(PARALLELOGRAM)
    for rtol in (rtol * (1 + k / 1000) for rtol in tolerances for k in (0, 1, 5)):
        run = dae.simulate(stop=4, points=101, rtol=rtol, solver=solver)
        assert np.abs(run["first.phi"] - np.pi / 2 + upright(1.2, -1, run.time)).max() < 100 * rtol


@pytest.mark.parametrize("solver", ["taylor", "adams", "ida", "cvode"])
def test_nothing_is_lost_where_a_singular_position_is_passed(solver):
    """The errors are those of the same solver on the equation of the angle, which has no such positions."""
    angle = compiled_text("""model Angle
      Real a(start = 0, fixed = true), w(start = -1, fixed = true);
    equation
      der(a) = w; der(w) = 1.2*9.81*sin(a);
    end Angle;""")
    options = {"stop": 4, "points": 41, "rtol": 1e-10, "solver": solver}
    own, other = (scene.simulate(**options) for scene in (compiled_text(PARALLELOGRAM), angle))
    exact = upright(1.2, -1, own.time)
    assert any(n.message.startswith("4 singular positions") for n in own.notes)
    error = np.abs(own["first.phi"] - np.pi / 2 + exact).max()
    assert error < max(5 * np.abs(other["a"] - exact).max(), 5e-9)


def test_unequal_bars_go_on_as_one_as_well():
    text = PARALLELOGRAM.replace("rocker(l = 1, m = 1)", "rocker(l = 1, m = 0.3)").replace(
        "coupler(l = 1, m = 1)", "coupler(l = 1, m = 2.5)"
    )
    run = compiled_text(text).simulate(stop=5, points=50, rtol=1e-10)
    ratio = (1 / 2 + 2.5 + 0.3 / 2) / (1 / 3 + 2.5 + 0.3 / 3)
    assert np.abs(run["first.phi"] - np.pi / 2 + upright(ratio, -1, run.time)).max() < 1e-8
    assert np.abs(run["second.phi"] - run["first.phi"]).max() < 1e-12


@pytest.mark.parametrize(
    ("rtol", "solver", "allowed"), [(1e-3, "auto", 0.1), (1e-6, "cvode", 0.01), (1e-10, "dop853", 1e-8)]
)
def test_isosceles_slider_crank_goes_beyond_its_pivot(rtol, solver, allowed):
    """Across the line the slider might stay at the pivot while the bars turn: ½·(2/3 + 6·sin² φ)·ω² stays as it is."""
    run = compiled_text(ISOSCELES).simulate(stop=4, points=101, rtol=rtol, solver=solver)

    def slope(t, z):
        return [z[1], -3 * np.sin(2 * z[0]) * z[1] ** 2 / (2 / 3 + 6 * np.sin(z[0]) ** 2)]

    exact = solve_ivp(slope, (0, 4), [0.5, 2], "DOP853", run.time, rtol=1e-12, atol=1e-13).y[0]
    assert np.abs(run["main.phi"] - exact).max() < allowed
    assert np.abs(run["line.s"] - 2 * np.cos(run["main.phi"])).max() < 1e-12
    assert np.abs(run["rod.b.x"] - run["line.s"]).max() < 1e-12


def test_long_steps_over_a_singular_place_become_shorter_without_a_compiler(no_compiler):
    run = lmoc.compile_text(PARALLELOGRAM).simulate(stop=2, points=11, rtol=1e-3, solver="dop853")
    assert np.abs(run["first.phi"] - np.pi / 2 + upright(1.2, -1, run.time)).max() < 0.1
    assert np.abs(run["second.phi"] - run["first.phi"]).max() < 1e-12


@pytest.mark.parametrize("more", [1e-10, 1e-4])
def test_bars_that_almost_fit_turn_or_stop_but_never_jump(more):
    """With a coupler a little too long the two branches do not meet: the rocker turns sharply nearby."""
    text = PARALLELOGRAM.replace("coupler(l = 1,", f"coupler(l = {1 + more!r},")
    try:
        run = compiled_text(text).simulate(stop=1, points=2001, rtol=1e-8)
    except lmoc.SimulationError as error:
        assert "singular" in str(error) and error.time > 0.69
        run = error.partial
    way = np.diff(run["second.phi"])
    rate = np.abs(run["second.omega"])
    assert np.abs(way).max() < 1.1 * rate.max() * np.diff(run.time).max()
    energy = run["crank.energy"] + run["coupler.energy"] + run["rocker.energy"]
    assert np.abs(energy / energy[0] - 1).max() < 1e-6


@pytest.mark.parametrize(
    ("solver", "rtol", "points", "stop"),
    [
        ("dop853", 1e-3, 11, 1),
        ("dop853", 1e-5, 3, 5),
        ("radau", 1e-3, 11, 1),
        ("radau", 1e-5, 500, 1),
        ("auto", 1e-5, 3, 10),
        ("auto", 1e-8, 501, 5),
    ],
)
def test_cartesian_pendulum_is_as_right_as_one_with_an_angle(solver, rtol, points, stop):
    """x and y take turns as coordinates, whatever output times are asked for."""
    cartesian = compiled_text("""model Cartesian
      Real x(start = 0, fixed = true), y(start = -1), vx(start = 7.1, fixed = true), vy, T;
    equation
      der(x) = vx; der(y) = vy; der(vx) = -T*x; der(vy) = -T*y - 9.81; x^2 + y^2 = 1;
    end Cartesian;""")
    angular = compiled_text("""model Angular
      Real theta(start = 0, fixed = true), omega(start = 7.1, fixed = true);
    equation
      der(theta) = omega; der(omega) = -9.81*sin(theta);
    end Angular;""")
    times = np.linspace(0, stop, points)
    exact = solve_ivp(lambda t, z: [z[1], -G * np.sin(z[0])], (0, stop), [0, 7.1], "DOP853", times, rtol=1e-13,
                      atol=1e-14).y[0]  # fmt: skip
    run = cartesian.simulate(times=times, rtol=rtol, solver=solver)
    other = np.sin(angular.simulate(times=times, rtol=rtol, solver=solver)["theta"])
    own = np.abs(run["x"] - np.sin(exact)).max()
    assert own < 30 * max(np.abs(other - np.sin(exact)).max(), rtol)
    assert np.abs(run["x"] ** 2 + run["y"] ** 2 - 1).max() < 1e-9


def test_a_run_that_ends_while_a_singular_place_is_passed_has_its_last_output():
    """The step over the place is longer than what is left of the run."""
    dae = compiled_text(ISOSCELES)
    whole = dae.simulate(stop=1.6, points=801, rtol=1e-8)
    at = whole.time[np.argmin(np.abs(whole["line.s"]))]  # the pivot
    run = dae.simulate(stop=at + 0.01, points=11, rtol=1e-8)
    assert len(run.time) == 11 and run.complete
    assert run["main.phi"][-1] == pytest.approx(np.interp(run.time[-1], whole.time, whole["main.phi"]), abs=1e-5)


WITH_LAWS = ISOSCELES.replace("line(s", "line(useFlange = true, s")
FRICTION = ".DryFriction rub(F = 0.5); .Fixed wall;", "rub"
STOP = ".Stop rub(L = {}, e = 0.5); .Fixed wall;", "rub"


def with_law(law: str, part: str) -> str:
    text = WITH_LAWS.replace("equation\n", f"  {law}\nequation\n  connect({part}.a, wall.flange);", 1)
    return text.replace("equation\n", f"equation\n  connect({part}.b, line.flange);\n", 1)


def isosceles(times: np.ndarray, friction: float = 0.0) -> np.ndarray:
    """The angle of the crank: T = (5/12 + 9/4 s² + c²/4 + 4 s²) ω²/2 with its sine s and cosine c."""

    def rate(_, z):
        sine, cosine = np.sin(z[0]), np.cos(z[0])
        inertia, slope = 5 / 12 + 6.25 * sine**2 + 0.25 * cosine**2, 12 * sine * cosine
        return [z[1], (-2 * friction * abs(sine) * np.sign(z[1]) - slope * z[1] ** 2 / 2) / inertia]

    return solve_ivp(rate, (0, times[-1]), [0.5, 2.0], "DOP853", times, rtol=1e-12, atol=1e-13, max_step=1e-2).y[0]


def test_a_slider_crank_with_friction_passes_its_change_points():
    run = compiled_text(with_law(*FRICTION)).simulate(stop=4, rtol=1e-9)
    exact = isosceles(run.time, friction=0.5)
    assert any(n.code == "N0633" for n in run.notes) and exact[-1] > 3 * np.pi / 2
    assert run["main.phi"] == pytest.approx(exact, abs=1e-5)
    assert run["line.s"] == pytest.approx(2 * np.cos(exact), abs=1e-5)
    assert run.energy.balance < 1e-6


def test_a_stop_behind_a_change_point_is_met_on_the_branch():
    run = compiled_text(with_law(STOP[0].format(-1.5), STOP[1])).simulate(stop=3, rtol=1e-9)
    impact = next(e for e in run.events if e.kind == "impact")
    times = np.linspace(0, 3, 30001)
    assert impact.time == pytest.approx(np.interp(np.arccos(-0.75), isosceles(times), times), abs=1e-6)
    before = run.time < impact.time
    assert run["line.s"][before] == pytest.approx(2 * np.cos(isosceles(run.time)[before]), abs=1e-6)
    assert run.energy.balance < 1e-6


def test_an_impact_at_a_change_point_is_told_where_the_run_ends():
    with pytest.raises(lmoc.SimulationError, match="a law or an event changes it just there") as stopped:
        compiled_text(with_law(STOP[0].format(0), STOP[1])).simulate(stop=3, rtol=1e-9)
    run = stopped.value.partial
    assert 0 < run["line.s"][-1] < 0.02
    assert run["main.phi"] == pytest.approx(isosceles(run.time), abs=1e-6)


def test_a_discrete_event_on_the_way_does_not_hide_a_change_point():
    """The relation changes far from the change points; its integral counts the time behind it."""
    text = WITH_LAWS.replace("equation\n", "  Real late(start = 0, fixed = true);\nequation\n"
                             "  der(late) = if time > 0.4 then 1 else 0;\n", 1)  # fmt: skip
    run = compiled_text(text).simulate(stop=4, rtol=1e-9)
    assert any(n.code == "N0633" for n in run.notes)
    assert run["main.phi"] == pytest.approx(isosceles(run.time), abs=1e-6)
    assert run["late"][-1] == pytest.approx(3.6, abs=1e-9)


THROUGH_ITS_CENTRE = """model Wheel "a crank drives a slotted wheel by a pin that passes the wheel's centre"
  import Planar.*;
  inner World world(g = 0);
  Ground ground, beside(x = 1);
  Revolute main(phi(start = 0.5, fixed = true), omega(start = -2, fixed = true)), axle(phi(start = 1.8)), pin;
  Bar crank(l = 1, m = 1);
  Body wheel(m = 1, J = 0.3);
  Prismatic slot(s(start = 0.5));
equation
  connect(ground.frame, main.a); connect(main.b, crank.a);
  connect(beside.frame, axle.a); connect(axle.b, wheel.frame);
  connect(wheel.frame, slot.a); connect(slot.b, pin.a); connect(pin.b, crank.b);
end Wheel;"""


@pytest.mark.parametrize("points", [2, 9, 201])
def test_an_output_at_a_singular_position_is_the_limit(points):
    """The wheel turns by half the angle of the crank; at 0.25 s its rate is 0/0 in terms of the crank's."""
    times = np.unique(np.append(np.linspace(0, 2, points), 0.25))
    run = compiled_text(THROUGH_ITS_CENTRE).simulate(times=times, rtol=1e-9)
    assert any(n.code == "N0633" for n in run.notes)
    assert run["axle.omega"] == pytest.approx(-1.0, abs=1e-7)
    assert run["axle.phi"] == pytest.approx(np.pi / 2 + 0.25 - run.time, abs=1e-7)
    assert run["slot.s"] == pytest.approx(2 * np.sin(0.25 - run.time), abs=1e-7)
    assert run.energy.stored == pytest.approx(run.energy.stored[0], rel=1e-7)


def isosceles_before_its_line(distance: float) -> str:
    angle = float(np.pi / 2 - distance)
    text = ISOSCELES.replace("phi(start = 0.5", f"phi(start = {angle!r}")
    text = text.replace("start = -1", f"start = {-2 * angle!r}")
    return text.replace("start = 1.7", f"start = {float(2 * np.cos(angle))!r}")


def test_a_run_from_shortly_before_a_singular_position_passes_it_or_stops_soon():
    """Nearby the right-hand side is rounded so much that no step meets a tolerance as fine."""
    try:
        run = compiled_text(isosceles_before_its_line(1e-3)).simulate(stop=1, rtol=1e-9)
        assert run["line.s"] == pytest.approx(2 * np.cos(run["main.phi"]), abs=1e-9)
    except lmoc.SimulationError as stopped:
        assert "a singular position lies ahead" in str(stopped) and 4e-4 < stopped.time < 5e-4
        assert stopped.partial.stats["steps"] < 10_000


def test_a_run_from_so_near_that_its_constraints_are_small_throughout_stops_soon():
    angle = np.pi - 1e-4
    text = PARALLELOGRAM.replace("up(unit", "away(unit").replace("start = up", f"start = {angle!r}")
    with pytest.raises(lmoc.SimulationError, match="a singular position lies ahead") as stopped:
        compiled_text(text.replace("start = -up", f"start = {-angle!r}")).simulate(stop=1, rtol=1e-9)
    assert stopped.value.time < 1e-4 and stopped.value.partial.stats["steps"] < 10_000


def test_a_start_next_to_a_singular_position_is_told():
    with pytest.raises(lmoc.ModelError, match="E0535.*starts next to a singular position"):
        compiled_text(isosceles_before_its_line(1e-6)).simulate()


@pytest.mark.parametrize("angle", [0.0, np.pi])
@pytest.mark.parametrize("speed", [0.0, 1.0])
def test_a_start_at_a_singular_position_is_told(angle, speed):
    text = PARALLELOGRAM.replace("omega(start = 1,", f"omega(start = {speed},").replace("up(unit", "away(unit")
    text = text.replace("start = up", f"start = {angle}").replace("start = -up", f"start = {-angle}")
    with pytest.raises(lmoc.ModelError, match="E0535.*starts at a singular position"):
        compiled_text(text).simulate()


def resized(text: str, size: float) -> str:
    """A mechanism of so many times its size that moves as before: with gravity and inertias in proportion."""
    text = re.sub(r"\b(l|x|s\(start) = ([-+.e\d]+)", lambda m: f"{m[1]} = {float(m[2]) * size!r}", text)
    text = re.sub(r"\bJ = ([.\d]+)", lambda m: f"J = {float(m[1]) * size**2!r}", text)
    return re.sub(r"World world(\(g = 0\))?", lambda m: m[0] if m[1] else f"World world(g = {G * size!r})", text)


@pytest.mark.parametrize("size", [1e-9, 1e-4, 100.0, 1e6])
def test_a_mechanism_of_any_size_passes_its_singular_positions(size):
    run = compiled_text(resized(PARALLELOGRAM, size)).simulate(stop=4, points=21, rtol=1e-8)
    assert run["first.phi"] == pytest.approx(np.pi / 2 - upright(1.2, -1, run.time), abs=1e-6)
    assert [n.message.split(" were")[0] for n in run.notes if n.code == "N0633"] == ["4 singular positions"]


@pytest.mark.parametrize("size", [1e-9, 1e-6])
def test_a_start_next_to_a_singular_position_is_told_at_any_size(size):
    with pytest.raises(lmoc.ModelError, match="E0535.*starts (next to|at) a singular position"):
        compiled_text(resized(isosceles_before_its_line(1e-6), size)).simulate()
