"""Equilibria, linear models and starts at rest of scenes with laws, against closed forms."""

import json

import numpy as np
import pytest
from oracles.models import compiled
from oracles.two_bobs import TWO_BOBS
from scipy.optimize import brentq

import lmoc
from lmoc import pipeline
from lmoc.cli.main import main

HANGING = """model Hanging Fixed c; Cable s(L = 1.5); Mass m(m = 2, g = 9.81);
equation connect(c.flange, s.a); connect(s.b, m.flange); end Hanging;"""

PRESSED = """model Pressed Fixed w, e; Spring k(k = 100, d0 = {d0}); Mass m(m = 2); Stop s(L = 1);
equation connect(w.flange, k.a); connect(k.b, m.flange); connect(m.flange, s.a); connect(s.b, e.flange);
end Pressed;"""

STUCK = """model Stuck Fixed w; Spring k(k = 100);
Mass m(m = 2, q(start = 1)); DryFriction d(F = 5, Fstick = 6); Force p;
input Real load = 0;
equation p.f = load; connect(w.flange, k.a); connect(k.b, m.flange); connect(w.flange, d.a); connect(d.b, m.flange);
connect(p.flange, m.flange); end Stuck;"""

TWO_BLOCKS = """model TwoBlocks Fixed w; Spring k1(k = 100), k2(k = 50); Mass m1(m = 1), m2(m = 2);
DryFriction f1(F = 5), f2(F = 3); Force p(f = 4);
equation connect(w.flange, k1.a); connect(k1.b, m1.flange); connect(w.flange, f1.a); connect(f1.b, m1.flange);
connect(m1.flange, k2.a); connect(k2.b, m2.flange); connect(w.flange, f2.a); connect(f2.b, m2.flange);
connect(p.flange, m2.flange); end TwoBlocks;"""

LEVER = """model TwoStrings "a lever on two strings, of which the load lets one become slack"
Fixed c; Lever lever(l1 = -1, l2 = 0.5, smallAngle = {small}); Inertia j(J = 1); Cable left(L = 0), right(L = 0.1);
TorsionSpring k(k = 10); FixedShaft g; Torque t(tau = {tau});
equation connect(lever.pivot, j.shaft); connect(t.shaft, j.shaft); connect(g.shaft, k.a); connect(k.b, j.shaft);
connect(left.a, c.flange); connect(left.b, lever.a); connect(right.a, c.flange); connect(right.b, lever.b);
end TwoStrings;"""

PENDULUM = """model Rough
FixedShaft g; Inertia j(J = 1); BearingFriction b(tau = 2); Torque t(tau = -9.81*sin(j.theta));
equation connect(g.shaft, b.a); connect(b.b, j.shaft); connect(t.shaft, j.shaft); end Rough;"""

BELT = """model Belt Fixed wall; Spring spring(k = 50);
Mass mass(m = 1); Motion belt(q = 0.2*time); DryFriction d(F = 2);
equation connect(wall.flange, spring.a); connect(spring.b, mass.flange); connect(belt.flange, d.a);
connect(d.b, mass.flange); end Belt;"""


def rests(text: str, **inputs: float) -> list:
    return lmoc.compile_text(text).equilibria(inputs)


def number(dae: lmoc.DAE, value) -> float:
    return float(value.subs({s: dae.parameters[s.name] for s in value.free_symbols}))


def test_a_mass_on_a_string_under_gravity():
    dae = lmoc.compile_text(HANGING)
    (rest,) = dae.equilibria()
    assert rest.laws.modes == {"s": "taut"}
    assert number(dae, rest["m.q"]) == 1.5 and rest["m.v"] == 0
    assert number(dae, rest.laws.forces["s.f"]) == pytest.approx(19.62, rel=1e-15)
    assert rest.stability == "stable" and rest.isolated


@pytest.mark.parametrize(("d0", "mode"), [(0.5, "contact"), (-1.0, "contact"), (-1.5, "open")])
def test_a_block_on_a_stop_pushed_by_a_spring(d0, mode):
    """The stop at -1 carries k·(d0 + 1) where the spring would push beyond it."""
    dae = lmoc.compile_text(PRESSED.format(d0=d0))
    (rest,) = dae.equilibria()
    assert rest.laws.modes == {"s": mode}
    assert number(dae, rest["m.q"]) == pytest.approx(min(d0, -1.0), abs=1e-15)
    if mode == "contact":
        force = rest.laws.forces["force of s"]
        assert number(dae, force) == pytest.approx(100 * (d0 + 1), abs=1e-13)
    assert rest.stability == ("undecided" if d0 == -1.0 else "stable")  # a contact without force may open
    assert rest.laws.at_limit == (("s",) if d0 == -1.0 else ())


@pytest.mark.parametrize("load", [0.0, 3.0, -20.0])
def test_dry_friction_holds_on_an_interval(load):
    (rest,) = rests(STUCK, load=load)
    (held,) = rest.free
    assert held.name == "m.q" and rest.laws.modes == {"d": "stick"}
    assert rest.laws.range["m.q"] == pytest.approx(((load - 6) / 100, (load + 6) / 100), rel=1e-12)
    assert rest.laws.force_range["force of d"] == pytest.approx((-6, 6), rel=1e-12)
    assert rest.laws.member["m.q"] == pytest.approx(load / 100, abs=1e-15)


def test_two_frictions_hold_a_polygon():
    (rest,) = rests(TWO_BLOCKS)
    assert rest.laws.range["m1.q"] == pytest.approx((-0.04, 0.12), rel=1e-12)
    assert rest.laws.range["m2.q"] == pytest.approx((-0.02, 0.26), rel=1e-12)
    assert [rest.laws.member[n] for n in ("m1.q", "m2.q")] == pytest.approx([0.04, 0.12], rel=1e-12)


@pytest.mark.parametrize("small", ["true", "false"])
@pytest.mark.parametrize(("tau", "angle", "modes"), [
    (-3, 0.0, {"left": "taut", "right": "slack"}),
    (1, 0.1, {"left": "slack", "right": "slack"}),
    (4, 0.2, {"left": "slack", "right": "taut"}),
])  # fmt: skip
def test_a_lever_on_two_strings(small, tau, angle, modes):
    dae = lmoc.compile_text(LEVER.format(tau=tau, small=small))
    (rest,) = dae.equilibria()
    assert rest.laws.modes == modes
    exact = np.arcsin(angle) if small == "false" and angle == 0.2 else angle  # sin θ = 0.1/0.5 where right is taut
    assert number(dae, rest["j.theta"]) == pytest.approx(exact, abs=1e-9)


def test_a_rough_pendulum_rests_on_two_intervals():
    """|9.81·sin θ| ≤ 2, about the lower and the upper equilibrium."""
    found = rests(PENDULUM)
    edge = np.arcsin(2 / 9.81)
    ranges = sorted(e.laws.range["j.theta"] for e in found)
    assert np.array(ranges) == pytest.approx(np.array([(-edge, edge), (np.pi - edge, np.pi + edge)]), rel=1e-11)


def test_friction_on_a_moving_belt_slips_at_rest():
    dae = lmoc.compile_text(BELT)
    (rest,) = dae.equilibria()
    assert rest.laws.modes == {"d": "slip"} and number(dae, rest["mass.q"]) == pytest.approx(0.04)
    assert dae.linearize().frequencies == pytest.approx([50**0.5, 50**0.5])


def test_statically_indeterminate_strings_have_ranges():
    """Two strings without slack hold a lever: the torque fixes the difference of their forces alone."""
    text = LEVER.format(tau=3, small="true").replace("L = 0.1", "L = 0").replace("0.5", "1").replace("k = 10", "k = 0")
    (rest,) = rests(text)
    assert rest.laws.modes == {"left": "taut", "right": "taut"} and not rest.laws.forces
    assert rest.laws.force_range == {"left.f": (0.0, np.inf), "right.f": (pytest.approx(3.0), np.inf)}


def test_no_equilibrium_is_said(tmp_path, capsys):
    file = tmp_path / "loose.lmo"
    file.write_text("""model Loose Fixed c; Cable s(L = 1); Mass m(m = 1), other(m = 1); Force f(f = 20);
    equation connect(c.flange, s.a); connect(s.b, m.flange); connect(f.flange, other.flange); end Loose;""")
    assert main(["equilibria", str(file)]) == 0
    assert "no equilibrium: nothing balances the constant loads" in capsys.readouterr().out
    assert main(["run", str(file), "--init", "equilibrium"]) == 2
    assert "there is no equilibrium to start from" in capsys.readouterr().err


def test_without_values_each_mode_has_its_conditions():
    dae = lmoc.compile_text(STUCK.replace("(k = 100)", "").replace("F = 5, Fstick = 6", "").replace("(m = 2, q", "(q"))
    (rest,) = dae.equilibria()
    assert {str(c) for c in rest.laws.conditions} == {"d.F - k.k*m.q", "d.F + k.k*m.q"}


def test_runs_start_at_rest_under_laws():
    for text, name, value in ((HANGING, "m.q", 1.5), (TWO_BLOCKS, "m2.q", 0.12), (BELT, "mass.q", 0.04)):
        run = lmoc.compile_text(text).simulate(stop=2, initial="equilibrium", rtol=1e-9)
        assert np.abs(run[name] - value).max() <= 1e-12
    dae = lmoc.compile_text(STUCK)
    run = dae.simulate(stop=1, initial=dae.equilibria()[0])
    assert np.ptp(run["m.q"]) == 0.0 and not run.events


def test_linear_models_are_those_of_the_mode():
    dae = lmoc.compile_text(LEVER.format(tau=1, small="true"))
    assert dae.linearize().eigenvalues.imag == pytest.approx([10**0.5, -(10**0.5)])
    held = lmoc.compile_text(LEVER.format(tau=4, small="true"))
    assert held.linearize().states == [] and held.linearize(at={"j.theta": 0.1}).states == ["j.theta", "j.omega"]
    stuck = lmoc.compile_text(STUCK)
    assert stuck.linearize(at={"m.q": 0.01}).states == ["m.q"]
    assert stuck.linearize(at={"m.q": 1.0}).states == ["m.q", "m.v"]
    run = stuck.simulate(stop=0.05)
    assert stuck.linearize(at=run).A == pytest.approx(np.array([[0, 1], [-50, 0]]))
    assert stuck.linearize(at=0.05).point["m.q"] == pytest.approx(run["m.q"][-1], rel=1e-6)


def test_a_mode_is_reduced_once(monkeypatch):
    """Where an equilibrium has been found it is linearized, and closing loops in space is most of the work for both."""
    dae, modes, reduce = lmoc.compile_text(HANGING), [], pipeline.reduce
    monkeypatch.setattr(pipeline, "reduce", lambda flat, *more: modes.append(flat.closed) or reduce(flat, *more))
    (rest,) = dae.equilibria()
    found = len(modes)
    model = dae.linearize(at=rest)
    assert len(modes) == found > 0 and model.states == []
    dae.equilibria(parameters={"m.m": 3})
    assert len(modes) > found


def test_many_laws_are_not_enumerated():
    """Masses on strings under gravity: one state of rest among 2²⁴ modes, L·n below the ceiling."""
    n = 24
    dae = lmoc.compile_text(f"""model Chain
    Fixed top; Mass m[{n}](each m = 1, each g = 9.81); Cable s[{n}](each L = 0.5);
    equation connect(top.flange, s[1].a);
    for i in 1:{n} loop connect(s[i].b, m[i].flange); end for;
    for i in 2:{n} loop connect(m[i - 1].flange, s[i].a); end for; end Chain;""")
    (rest,) = dae.equilibria()
    assert set(rest.laws.modes.values()) == {"taut"}
    assert number(dae, rest[f"m[{n}].q"]) == pytest.approx(0.5 * n)
    assert number(dae, rest.laws.forces["s[1].f"]) == pytest.approx(9.81 * n)


def test_json_tells_the_laws(tmp_path, capsys):
    file = tmp_path / "stuck.lmo"
    file.write_text(STUCK)
    assert main(["equilibria", str(file), "--json", "--input", "load=1"]) == 0
    (data,) = json.loads(capsys.readouterr().out)
    assert data["laws"]["modes"] == {"d": "stick"} and data["laws"]["ranges"]["m.q"] == pytest.approx([-0.05, 0.07])


def random_scene(seed: int) -> str:
    """Return a scene of damped masses with springs to the ground, strings, stops and friction."""
    generator = np.random.default_rng(seed)
    number, count = generator.uniform, int(generator.integers(2, 4))
    parts, joined, ends = ["Fixed g;"], [], ["g", *(f"m{i}" for i in range(count))]
    for i in range(count):
        weight = generator.choice([0, 9.81, -9.81])
        parts += [f"Mass m{i}(m = {number(0.5, 3)}, g = {weight}, q(start = {number(-1, 1)}, fixed = true));"]
        parts += [f"Damper d{i}(c = 30);", f"Spring k{i}(k = {number(20, 200)}, d0 = {number(-1, 1)});"]
        joined += [f"connect(g.flange, {e}{i}.a); connect({e}{i}.b, m{i}.flange);" for e in "dk"]
    for j, kind in enumerate(["Cable(L = {0})", "Stop(L = -{0})", "DryFriction(F = {1})"]):
        a, b = generator.choice(len(ends), 2, replace=False)
        name, values = kind.split("(")
        parts.append(f"{name} l{j}({values.format(number(2.2, 3), number(0.1, 20))};")
        joined.append(f"connect({ends[a]}.flange, l{j}.a); connect({ends[b]}.flange, l{j}.b);")
    return f"model R\n{' '.join(parts)}\nequation\n{' '.join(joined)}\nend R;"


@pytest.mark.parametrize("seed", [1, 3])
def test_damped_scenes_come_to_rest_in_an_equilibrium(seed):
    """Where a run ends is one of the states of rest that the complementarity problem gives, or in one of the sets."""
    dae = lmoc.compile_text(random_scene(seed))
    run = dae.simulate(stop=100, points=2, rtol=1e-8)
    at = {name: float(run[name][-1]) for name in dae.states}

    def reached(rest) -> bool:
        known = {n: v.subs({s: at[s.name] for s in v.free_symbols if s.name in at}) for n, v in rest.items()}
        inside = all(low - 1e-6 <= at[name] <= high + 1e-6 for name, (low, high) in rest.laws.range.items())
        return inside and all(abs(number(dae, v) - at[name]) < 1e-5 for name, v in known.items())

    assert any(reached(rest) for rest in dae.equilibria())


def test_strings_in_the_plane_hang_taut_though_the_scene_starts_slack():
    """The double pendulum of two point masses: its places, tensions and frequencies."""
    dae = lmoc.compile_text(TWO_BOBS)
    (rest,) = dae.equilibria()
    assert [float(rest[n]) for n in ("a.x", "a.y", "b.x", "b.y")] == pytest.approx([0, -1, 0, -1.5], abs=1e-9)
    assert set(rest.laws.modes.values()) == {"taut"}
    assert {n: float(f) for n, f in rest.laws.forces.items()} == pytest.approx({"upper.f": 29.43, "lower.f": 9.81})
    m1, m2, l1, l2, g = 2, 1, 1, 0.5, 9.81
    M = np.array([[(m1 + m2) * l1**2, m2 * l1 * l2], [m2 * l1 * l2, m2 * l2**2]])
    K = np.diag([(m1 + m2) * g * l1, m2 * g * l2])
    omega = np.sort(np.sqrt(np.linalg.eigvals(np.linalg.solve(M, K))))
    for model in (rest.model, dae.linearize(), dae.linearize(at=rest)):
        assert model.frequencies == pytest.approx(np.repeat(omega, 2), rel=1e-9)
    run = dae.simulate(initial=rest, stop=1.0)
    assert len(run.events) == 0 and np.ptp(run["b.y"]) < 1e-12


def test_a_pendulum_on_a_string_stands_on_its_head_nowhere():
    """Upside down its string would have to push; a rod does."""
    string = compiled("laws/slack_pendulum").equilibria()
    assert [float(e["bob.y"]) for e in string] == pytest.approx([-1.0])


@pytest.mark.parametrize("verb", ["equilibria", "linearize"])
def test_rates_that_overflow_are_told(verb) -> None:
    text = """model Elevator
  Inertia drum(J = 200);
  Brake brake(tau = 30000);
  StringDrum cable(r = 0.5);
  Mass cabin(m = 1e300, g = -1e308);
equation
  connect(brake.shaft, drum.shaft);
  connect(drum.shaft, cable.shaft);
  connect(cable.flange, cabin.flange);
end Elevator;"""
    with pytest.raises(lmoc.ModelError, match=r"no conditions of rest: 'der\(cabin\.v\)' without a finite value"):
        getattr(lmoc.compile_text(text), verb)()


@pytest.mark.parametrize("g", [0.37, 1.7, 3.3, 9.81, -9.81])
@pytest.mark.parametrize("size", [1.0, 1e-9])
def test_a_root_that_is_right_to_rounding_is_a_state_of_rest(g: float, size: float) -> None:
    """What rounding leaves of a root was compared with the force of an open stop, which is as small."""
    text = f"""model Hardening
  Fixed w; Mass m(m = 1, g = {g * size}); Spring s(k = 2); CubicSpring c(k = {2 / size**2}); Stop stop(L = 0);
equation
  connect(w.flange, s.a); connect(s.b, m.flange); connect(w.flange, c.a); connect(c.b, m.flange);
  connect(w.flange, stop.a); connect(stop.b, m.flange);
end Hardening;"""
    (rest,) = lmoc.compile_text(text).equilibria()
    expected = brentq(lambda q: 2 * q + 2 * q**3 - g, 0, 3) if g > 0 else 0.0
    assert float(rest["m.q"]) == pytest.approx(expected * size, rel=1e-9)


@pytest.mark.parametrize(
    ("g", "F", "size"), [(0.37, 0.5, 1.0), (3.3, 1e-6, 1e-6), (9.81, 0.5, 100.0)]
)
def test_friction_holds_within_narrow_and_wide_limits(g: float, F: float, size: float) -> None:
    """A grid of 28 mm over 10 m on both sides saw neither what is narrower nor what is farther away."""
    text = f"""model Held
  Fixed w; Mass m(m = 1, g = {g * size}); DryFriction f(F = {F * size});
  Spring s(k = 2); CubicSpring c(k = {2 / size**2});
equation
  connect(w.flange, s.a); connect(s.b, m.flange); connect(w.flange, c.a); connect(c.b, m.flange);
  connect(w.flange, f.a); connect(f.b, m.flange);
end Held;"""
    (rest,) = lmoc.compile_text(text).equilibria()
    limits = [brentq(lambda q, load=load: 2 * q + 2 * q**3 - load, -3, 3, xtol=1e-15) for load in (g - F, g + F)]
    assert np.array(rest.laws.range["m.q"]) / size == pytest.approx(limits, rel=1e-8)
