"""Free-body diagrams: their forces are those of the equations of motion, and of the lecture notes."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest
import sympy as sp

import lmoc
from lmoc.messages.diagnostics import ModelError
from lmoc.symbolic.names import base_of
from lmoc.symbolic.system import jet_symbol
from lmoc.view.bodies.balance import FreeBodies, free_bodies
from lmoc.view.bodies.compose import _numbers
from lmoc.view.bodies.plane import bodies_of, pulls
from lmoc.view.scene.abbreviate import shown
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
    # both gears feel F along their own sense: r2 is -N*r1, and theta2 is theta1/N
    "ex09_gear_pair_with_load": {
        "gear1": {("F*r1", 1), ("u", 1)},
        "gear2": {("F*N*r1", -1), ("k*theta1/N", -1), ("c*v_theta1/N", -1)},
    },
    "ex10_lever_and_mass": {
        "body": {("k2*(l*theta/4 - q)*l/4", -1), ("9*c2*l**2*v_theta/16", -1)},
        "mass": {("k2*(l*theta/4 - q)", 1), ("k1*q", -1), ("c1*v_q", -1)},
    },
}  # fmt: skip


@cache
def bodies(name: str) -> tuple[lmoc.DAE, FreeBodies]:
    dae = lmoc.compile(NOTES / f"{name}.lmo")
    prepared = dae.prepare()
    graph = shown(prepared.flat, prepared.values).graph
    return dae, free_bodies(prepared.reduced, prepared.values, graph)


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


@pytest.mark.parametrize("name", ["ex02_spring_mass_damper", "ex05_suspension", "ex08_cable_around_cylinder"])
def test_numbers_add_up_to_mass_times_acceleration(name):
    dae, found = bodies(name)
    run = dae.simulate(rtol=1e-10)
    prepared = dae.prepare()
    graph = shown(prepared.flat, prepared.values).graph
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
    dae = lmoc.compile(NOTES.parent / "laws" / f"{file}.lmo")
    prepared = dae.prepare()
    found = free_bodies(prepared.reduced, prepared.values, shown(prepared.flat, prepared.values).graph)
    names = {base_of(s.name)[0] for b in found.balances for f in b.forces for s in f.label.free_symbols}
    assert names - {"time"} <= {*dae.variables, *dae.parameters}


def test_forces_in_the_plane_have_their_size_and_direction():
    """A particle on a rod passes its lowest point: the rod pulls it up by m·g + m·v²/L."""
    dae = lmoc.compile(NOTES.parent / "planar" / "pendulum_on_a_rod.lmo")
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


def test_the_balance_stands_below():
    dae, _ = bodies("ex02_spring_mass_damper")
    items = dae.draw(free_body=True).picture.items
    texts = [plain(s.text) for i in items if i.symbol == "balance" for s in i.shapes if isinstance(s, Label)]
    assert texts == ["m·q\u0308 = f − k·q − c·q\u0307"]


def test_a_scene_without_bodies_is_refused():
    dae = lmoc.compile(NOTES.parent / "planar" / "pendulum_cartesian.lmo")
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
