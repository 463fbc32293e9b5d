"""Free-body diagrams: their forces are those of the equations of motion, and of the lecture notes."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest
import sympy as sp
from oracles.models import compiled

import lmoc
from lmoc.messages.diagnostics import ModelError
from lmoc.symbolic.names import base_of
from lmoc.symbolic.system import jet_symbol
from lmoc.view.bodies.balance import FreeBodies, free_bodies
from lmoc.view.bodies.compose import _numbers
from lmoc.view.bodies.measured import measured_bodies
from lmoc.view.bodies.plane import bodies_of, centre_of, pulls
from lmoc.view.scene.abbreviate import shown, whole
from lmoc.view.scene.compose import world_gravity
from lmoc.view.scene.names import Names
from lmoc.view.scene.picture import Label
from lmoc.view.scene.planar import draw_plane
from lmoc.view.scene.text import plain

NOTES = Path(__file__).parents[2] / "models" / "notes"

# what each arrow says in the notes, in the scene's own symbols: (formula, along the coordinate or against it)
DRAWN = {
    "ex02_spring_mass_damper": {"mass": {("k*q", -1), ("c*v_q", -1), ("f", 1)}},
    "ex03_two_masses": {
        "mass1": {("k1*q1", -1), ("c1*v_q1", -1), ("k2*(q2 - q1)", 1), ("f1", 1)},
        "mass2": {("k2*(q2 - q1)", -1), ("-k3*q2", 1), ("f2", 1)},
    },
    "ex05_suspension": {
        "wheel": {
            ("k1*(q1 - u)", -1), ("c1*(v_q1 - v_u)", -1), ("k2*(q2 - q1)", 1), ("c2*(v_q2 - v_q1)", 1), ("m1*g", -1)
        },
        "body": {("k2*(q2 - q1)", -1), ("c2*(v_q2 - v_q1)", -1), ("m2*g", -1)},
    },
    "ex08_cable_around_cylinder": {
        "cylinder": {("T*r", 1), ("k*r**2*theta", -1), ("c*v_theta", -1)},
        "mass": {("f", 1), ("T", -1), ("m*g", 1)},
    },
    "ex09_gear_pair_with_load": {  # solved for theta1; at the second gear stands theta2
        "gear1": {("F*r1", 1), ("u", 1)},
        "gear2": {("F*r2", 1), ("k*theta2", -1), ("c*v_theta2", -1)},
    },
    "s8_gears": {
        "gear1": {("F*r1", 1), ("tau1", 1)},
        "gear2": {("F*r2", -1), ("tau2", 1)},
    },
    "ex10_lever_and_mass": {
        "body": {("k2*(l*theta/4 - q)*l/4", -1), ("9*c2*l**2*v_theta/16", -1)},
        "mass": {("k2*(l*theta/4 - q)", 1), ("k1*q", -1), ("c1*v_q", -1)},
    },
}  # fmt: skip


@cache
def bodies(name: str) -> tuple[lmoc.DAE, FreeBodies]:
    dae = compiled(NOTES / f"{name}.lmo")
    prepared = dae.prepare()
    return dae, free_bodies(prepared.reduced, prepared.values, whole(prepared.flat, prepared.values))


def in_own_symbols(dae: lmoc.DAE, found: FreeBodies, text: str) -> sp.Expr:
    """A formula of the table with the full names of what it is about."""
    names = {own: sp.Symbol(full) for full, own in found.own.items()}
    names |= {n: names.get(n, sp.Symbol(n)) for n in (*dae.parameters, *dae.inputs)}
    rates = {f"v_{n}": jet_symbol(s.name, 1) for n, s in names.items()}
    names |= {"F": sp.Symbol("mesh.F")}
    return sp.sympify(text, locals={**names, **rates})


@pytest.mark.parametrize("name", DRAWN)
def test_forces_are_those_of_the_notes(name):
    dae, found = bodies(name)
    for balance in found.balances:
        drawn = {(sp.expand(f.label), f.sense) for f in balance.forces}
        wanted = {(sp.expand(in_own_symbols(dae, found, t)), s) for t, s in DRAWN[name][balance.body.name]}
        assert drawn == wanted


@pytest.mark.parametrize("name", [*DRAWN, "ex04_moving_frame", "ex07_two_inertias", "fig6_string_over_pulley"])
def test_balances_agree_with_the_equations_of_motion(name):
    """The accelerations that lmoc derives solve all balances, for some value of the internal forces."""
    dae, found = bodies(name)
    ode = dae.symbolic_ode()
    solved = {}
    for state in dae.states:
        if f"der({state})" not in ode:
            solved[jet_symbol(state, 1)] = ode[state]
    rates = {jet_symbol(q, 2): ode[v] for q, v in pairs(dae)}
    jets = {sp.Symbol(v): jet_symbol(q, 1) for q, v in pairs(dae)}
    residuals = [b.residual.xreplace(rates).xreplace(jets) for b in found.balances]
    parameters = {sp.Symbol(n) for n in dae.parameters}
    moving = {s for q, _ in pairs(dae) for s in (sp.Symbol(q), jet_symbol(q, 1))}
    inputs = {jet_symbol(u, k) for u in dae.inputs for k in range(3)}
    unknown = set().union(*(r.free_symbols for r in residuals)) - parameters - moving - inputs - {sp.Symbol("time")}
    assert len(unknown) < len(residuals)
    values = sp.solve(residuals, sorted(unknown, key=str), dict=True) if unknown else [{}]
    assert len(values) == 1
    assert [sp.simplify(r.xreplace(values[0])) for r in residuals] == [0] * len(residuals)


def pairs(dae: lmoc.DAE) -> list[tuple[str, str]]:
    system = dae.symbolic()
    return [(system.states[q].name, system.states[v].name) for q, v in system.coordinates if v >= 0]


def test_a_lever_is_a_bar_with_the_forces_of_the_notes_at_its_points():
    dae, found = bodies("ex10_lever_and_mass")
    lever = next(b for b in found.balances if b.body.name == "body")
    near, far = sorted(lever.points, key=lambda p: p.arm)
    assert (near.arm, far.arm) == (0.25, 0.75)
    drawn = [{(sp.expand(f.label), f.sense) for f in p.forces} for p in (near, far)]
    wanted = [{(sp.expand(in_own_symbols(dae, found, t)), -1)} for t in ("k2*(l*theta/4 - q)", "3*c2*l*v_theta/4")]
    assert drawn == wanted
    items = dae.draw(free_body=True).picture.items
    bar = next(i for i in items if i.symbol == "lever")
    assert not any(i.symbol == "disk" for i in items)
    assert [i.part for i in items if i.symbol == "reaction"] == ["lever"]
    (_, _, top), (_, _, bottom) = bar.shapes[0].vertices
    joints = sorted(i.ends[0].y - bar.ends[0].y for i in items if i.symbol == "joint")
    assert (top, joints) == (0.0, [0.0, pytest.approx(bottom / 3), bottom])


@pytest.mark.parametrize("file", ["notes/s9_lever_large_angles", "hard/h08_turning_lever", "notes/ex10_lever_and_mass"])
def test_moments_of_the_forces_at_a_levers_points_are_its_torque(file):
    dae = compiled(NOTES.parent / f"{file}.lmo")
    prepared = dae.prepare()
    graph = whole(prepared.flat, prepared.values)
    found = free_bodies(prepared.reduced, prepared.values, graph)
    run = dae.simulate(stop=0.3)
    numbers = _numbers(found, prepared, graph, run, len(run.time) - 1)
    balance = next(b for b in found.balances if b.points)
    angle = 0.0 if balance.points[0].small else numbers.angle(balance)
    moments = [p.arm * np.cos(angle) * f.sense * numbers.of(balance, f) for p in balance.points for f in p.forces]
    torque = sum(f.sense * numbers.of(balance, f) for f in balance.forces if f.part == "lever")
    assert sum(moments) == pytest.approx(torque, rel=1e-9)
    assert abs(torque) > 1e-3


def test_what_a_mass_owes_to_the_turning_of_its_lever_is_no_force():
    """``q = l·sin θ`` has an acceleration with ``θ̇²``: a part of ``m·q̈``, not of the forces."""
    dae = compiled(NOTES.parent / "hard/h08_turning_lever.lmo")
    prepared = dae.prepare()
    found = free_bodies(prepared.reduced, prepared.values, whole(prepared.flat, prepared.values))
    for name in ("mass1", "mass2"):
        balance = next(b for b in found.balances if b.body.name == name)
        assert [f.part for f in balance.forces] == [name, "lever"]
        assert not any(base_of(s.name)[1] for f in balance.forces for s in f.label.free_symbols)


@pytest.mark.parametrize("name", ["ex02_spring_mass_damper", "ex05_suspension", "ex08_cable_around_cylinder"])
def test_numbers_add_up_to_mass_times_acceleration(name):
    dae, found = bodies(name)
    run = dae.simulate(rtol=1e-10)
    prepared = dae.prepare()
    graph = whole(prepared.flat, prepared.values)
    at = len(run.time) // 3
    numbers = _numbers(found, prepared, graph, run, at)
    for balance in found.balances:
        total = sum(f.sense * numbers.of(balance, f) for f in balance.forces)
        kind = "alpha" if balance.turns else "a"
        mass = run[f"{balance.body.name}.{'J' if balance.turns else 'm'}"][at]
        assert total == pytest.approx(mass * run[f"{balance.body.name}.{kind}"][at], rel=1e-6, abs=1e-7)


def test_arrows_are_to_scale_and_turn_round_with_the_sign():
    dae, _ = bodies("ex02_spring_mass_damper")
    run = dae.simulate()
    late = dae.draw(free_body=True, run=run, time=3.0).picture
    assert "t = 3 s" in late.title
    lengths = {}
    for item in late.items:
        if item.symbol == "force":
            (_, x0, _), *_ = item.shapes[0].vertices
            tip = item.shapes[1].vertices[0]
            lengths[item.part] = tip[1] - x0
    spring, push = 50 * run["mass.q"][-1], 10.0
    assert lengths["spring"] / lengths["push"] == pytest.approx(-spring / push, rel=1e-6)
    assert max(map(abs, lengths.values())) == pytest.approx(70.0)


@pytest.mark.parametrize("file", ["h16_stick_slip", "h34_slack_string", "clutch_lock", "atwood_jerk", "h18_freewheel"])
def test_forces_of_laws_stand_as_variables_of_the_scene(file):
    dae = compiled(NOTES.parent / "laws" / f"{file}.lmo")
    prepared = dae.prepare()
    found = free_bodies(prepared.reduced, prepared.values, shown(prepared.flat, prepared.values).graph)
    names = {base_of(s.name)[0] for b in found.balances for f in b.forces for s in f.label.free_symbols}
    assert names - {"time"} <= {*dae.variables, *dae.parameters}


def test_forces_in_the_plane_have_their_size_and_direction():
    """A particle on a rod passes its lowest point: the rod pulls it up by m·g + m·v²/L."""
    dae = compiled(NOTES.parent / "planar" / "pendulum_on_a_rod.lmo")
    run = dae.simulate(times=[0.0], energy=False)
    graph = shown(dae.flat, dae.values).graph
    plane = draw_plane(graph, Names(graph), lambda name: float(run[name][0]))
    (body,) = bodies_of(graph)
    rod, weight = pulls(plane, body, world_gravity(graph))
    assert (rod.part, weight.part) == ("rod", "mass")
    assert (rod.x, rod.y) == pytest.approx((0.0, 9.81 + 7.1**2), abs=1e-6)
    assert (weight.x, weight.y) == (0.0, -9.81)
    texts = [s.text for _, s, _ in dae.draw(free_body=True, run=run).picture.placed() if isinstance(s, Label)]
    assert "T = 60.22 N" in texts


MOVING = {  # scene: an instant, s, and a difference of times that resolves its motion
    "planar/andrews": (0.01, 1e-6),
    "planar/scissor_lift": (0.5, 1e-4),
    "planar/slider_crank": (0.4, 1e-4),
    "planar/wheel_with_pendulum": (0.5, 1e-4),
    "hard/h03_four_bar": (1.0, 1e-4),
}


@pytest.mark.parametrize("name", MOVING)
def test_forces_and_moments_in_the_plane_add_up_to_what_accelerates_each_body(name):
    """ΣF is m times the second difference of the centre's place, and ΣM about it J times that of the angle."""
    dae = compiled(NOTES.parent / f"{name}.lmo")
    t, h = MOVING[name]
    run = dae.simulate(times=[0, t - h, t, t + h], rtol=1e-11, energy=False)
    graph = shown(dae.flat, dae.values).graph
    planes = [draw_plane(graph, Names(graph), lambda n, k=k: float(run[n][k])) for k in (1, 2, 3)]
    plane = planes[1]
    assert bodies_of(graph)
    for body in bodies_of(graph):
        centres = [np.array(centre_of(p, body)) / p.scale * [1, -1] for p in planes]
        forces = pulls(plane, body, world_gravity(graph))
        m, largest = graph.value(body, "m"), max(p.size for p in forces)
        a = (centres[0] - 2 * centres[1] + centres[2]) / h**2
        assert np.allclose([sum(p.x for p in forces), sum(p.y for p in forces)], m * a, rtol=0, atol=1e-5 * largest)
        inertia = graph.value(body, "J", m * graph.value(body, "l", 0.0) ** 2 / 12)
        alpha = (run[f"{body.name}.omega"][3] - run[f"{body.name}.omega"][1]) / (2 * h)
        moments = [p.moment(centre_of(plane, body), plane.scale) for p in forces]
        assert sum(moments) == pytest.approx(inertia * alpha, abs=1e-5 * max(*map(abs, moments), 1e-3 * largest))


def test_what_acts_at_the_end_of_an_arm_is_drawn_there():
    """A pin in the middle of a bar, at the end of a rigid link, exerts no moment about the centre."""
    picture = compiled(NOTES.parent / "planar" / "scissor_lift.lmo").draw(free_body=True).picture
    texts = [plain(s.text) for i in picture.items if i.symbol == "balance" for s in i.shapes if isinstance(s, Label)]
    assert "Jrising·α = r×Fhinge + r×Froller" in texts
    assert "Jplatform·α = r×Ftop + r×Ftrack + Mtrack" in texts


LONG = """
model Long "Forces with long formulas, and a weight with a negative number"
  Fixed floor;
  Mass ball(m = 1, g = -9.81, q(start = 1, fixed = true));
  Stop contact(L = 0);
  ElasticCable rope(k = 50, d0 = 0.5);
  Fixed ceiling(q0 = 2);
  Motion shaker(q = if time < 1 then 0 else 0.1);
  Spring spring(k = 20);
equation
  connect(floor.flange, contact.a);
  connect(contact.b, ball.flange);
  connect(ball.flange, rope.a);
  connect(rope.b, ceiling.flange);
  connect(shaker.flange, spring.a);
  connect(spring.b, ball.flange);
end Long;
"""


def test_a_formula_without_room_at_its_arrow_is_a_symbol():
    items = lmoc.compile_text(LONG).draw(free_body=True).picture.items
    (text,) = [plain(s.text) for i in items if i.symbol == "balance" for s in i.shapes if isinstance(s, Label)]
    assert text == "m·q\u0308ball = frope − m·9.81 − fcontact − fspring"
    up = {i.part for i in items if i.symbol == "force" and i.shapes[1].vertices[0][2] < 0}
    assert up == {"rope", "contact"}  # the string pulls, the floor pushes


def test_a_force_without_room_at_its_arrow_has_the_sign_of_its_part():
    dae = lmoc.compile_text(
        "model S TableForce push(table = {{-1, 2}, {0, 0}, {1, -1}}); Mass mass(m = 1, q(start = 0.5, fixed = true));"
        "equation connect(push.flange, mass.flange); annotation(experiment(StopTime = 0.01)); end S;"
    )
    run = dae.simulate(points=2)
    items = dae.draw(free_body=True, run=run, time=0).picture.items
    seen = {plain(s.text) for i in items for s in i.shapes if isinstance(s, Label)}
    assert run["push.f"][0] == run["mass.a"][0] < 0
    assert {f"f = \N{MINUS SIGN}{-run['push.f'][0]:.4g} N", "m·q\u0308 = f"} <= seen


def test_bodies_beside_parts_that_are_left_out_feel_these_parts():
    items = compiled(NOTES.parent / "laws" / "wagons.lmo").draw(free_body=True).picture.items
    texts = [plain(s.text) for i in items if i.symbol == "balance" for s in i.shapes if isinstance(s, Label)]
    assert texts[2] == "m3·q\u03083 = f2 − f3"
    assert texts[-2:] == ["m49·q\u030849 = f48 − f49", "m50·q\u030850 = f49"]


def test_the_balance_stands_below():
    dae, _ = bodies("ex02_spring_mass_damper")
    items = dae.draw(free_body=True).picture.items
    texts = [plain(s.text) for i in items if i.symbol == "balance" for s in i.shapes if isinstance(s, Label)]
    assert texts == ["m·q\u0308 = f − k·q − c·q\u0307"]


def test_a_scene_without_bodies_is_refused():
    dae = compiled(NOTES.parent / "planar" / "pendulum_cartesian.lmo")
    with pytest.raises(ModelError, match="has no bodies"):
        dae.draw(free_body=True)
    with pytest.raises(TypeError, match="free_body=True"):
        dae.draw(time=np.pi)


def test_the_instant_and_the_run_of_a_diagram_must_fit_the_scene():
    dae, _ = bodies("ex02_spring_mass_damper")
    with pytest.raises(TypeError, match="give `run` as well"):
        dae.draw(free_body=True, time=1.0)
    other, _ = bodies("ex05_suspension")
    with pytest.raises(ValueError, match="the run is one of Suspension, not of "):
        dae.draw(free_body=True, run=other.simulate(stop=0.1))


# ------------------------------------------------------------------ forces without formulas

PICTURES = Path(__file__).parents[1] / "data" / "pictures"


@pytest.mark.parametrize(
    "name, body, acceleration, time", [("bell_crank", "plunger", "a", None), ("engine", "flywheel", "alpha", 0.04)]
)
def test_forces_without_formulas_are_numbers_and_add_up_to_mass_times_acceleration(name, body, acceleration, time):
    dae = lmoc.compile(PICTURES / f"{name}.lmo")
    run = dae.simulate(stop=0.05, points=6)
    at = 0 if time is None else 4
    flat, values = run.flat, dae.prepare().values
    balance = next(b for b in measured_bodies(whole(flat, values), {body}).balances)
    known = {s: float(run[s.name][at]) for f in balance.forces for s in f.label.free_symbols}
    total = sum(float(f.term.subs(known)) for f in balance.forces)
    inertia = float(run[str(balance.mass)][at]) * float(run[f"{body}.{acceleration}"][at])
    assert total == pytest.approx(inertia, rel=1e-6, abs=1e-6) and abs(inertia) > 1.0
    drawing = dae.draw(free_body=True, **({} if time is None else {"run": run, "time": time}))
    written = [plain(s.text) for _, s, _ in drawing.picture.placed() if isinstance(s, Label)]
    for force in balance.forces:
        value = float(force.label.subs(known))
        assert any(f"= {value:.4g}".replace("-", "−") in text for text in written), (value, written)
    assert ("start" in drawing.picture.title) == (time is None)
    assert "no solution in closed form" in drawing.picture.notes[0]


def test_all_that_turns_with_a_shaft_is_in_its_balance():
    """A weight on an arm has no J of its own, and two inertias on one shaft turn together."""
    start = "shaft.theta(start = 1)"
    swinging = f"""model M parameter Real m = 2, l = 0.5; GravityLever bob(m = m, l = l, {start}); Torque push(tau = 1);
      equation connect(push.shaft, bob.shaft); end M;"""
    joined = """model M parameter Real J1 = 1, J2 = 2, k = 3; Inertia a(J = J1), b(J = J2); TorsionSpring s(k = k);
      FixedShaft w; equation connect(a.shaft, b.shaft); connect(b.shaft, s.b); connect(s.a, w.shaft); end M;"""
    for text, left in ((swinging, "m·l^{2}·θ̈ ="), (joined, "(J_{1} + J_{2})·θ̈ =")):
        picture = lmoc.compile_text(text).draw(free_body=True).picture
        texts = [s.text for i in picture.items for s in i.shapes if hasattr(s, "text")]
        assert sum(t.startswith(left) for t in texts) == 1, texts
    assert "J_{1} + J_{2}" in texts and "−k·θ_{a}" not in "".join(texts)
