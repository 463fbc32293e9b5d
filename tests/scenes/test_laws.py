"""Scenes with laws against their closed forms: when something happens, what comes of it, and what energy it takes."""

import json
from pathlib import Path

import numpy as np
import pytest
from oracles.models import compiled

import lmoc

ROOT = Path(__file__).parents[2]
MODELS = ROOT / "models/laws"
SCENES = {s["id"]: s for s in json.loads((ROOT / "tests/data/laws.json").read_text())}


def run(name, **options):
    return compiled(MODELS / f"{name}.lmo").simulate(**({"rtol": 1e-10} | options))


@pytest.mark.parametrize(
    "name, scene, variables",
    [
        ("h06_bungee", "H06", {"q1": "upper.q", "v1": "upper.v", "q2": "lower.q", "v2": "lower.v"}),
        ("h07_ball_on_string", "H07", {"x": "x", "y": "y", "vx": "ball.vx", "vy": "ball.vy", "T": "string.f"}),
        ("h16_stick_slip", "H16", {"q": "mass.q", "v": "mass.v"}),
        ("h17_backlash", "H17", {"theta1": "theta1", "theta2": "theta2", "w1": "first.omega", "w2": "second.omega"}),
        ("h18_freewheel", "H18", {"w1": "driver.omega", "w2": "load.omega"}),
        ("h19_bouncing_ball", "H19", {"y": "ball.q", "v": "ball.v"}),
        ("h20_road_step", "H20", {"q1": "wheel.q", "v1": "wheel.v", "q2": "body.q", "v2": "body.v"}),
        ("h34_slack_string", "H34", {"q": "mass.q", "v": "mass.v", "T": "pulley.f"}),
    ],
)
def test_reference_trajectories(name, scene, variables):
    truth = SCENES[scene]
    found = run(name, times=truth["t"])
    for theirs, ours in variables.items():
        assert found[ours] == pytest.approx(np.array(truth["ref"][theirs], float), abs=2e-9)
    assert found.energy.balance < 1e-8 or (scene == "H20" and "infinite power" in str(found.energy))


def test_friction_stops_a_block_and_holds_it():
    found = run("friction_stop")
    (stop,) = found.events
    assert stop.kind == "stick" and stop.time == pytest.approx(0.7645259938837919, abs=1e-10)
    held = found["box.q"][found.time > 1]
    assert held[0] == pytest.approx(1.146788990825688, abs=1e-9)
    assert (held == held[0]).all() and (found["box.v"][found.time > 1] == 0).all()
    assert found.energy.lost[-1] == pytest.approx(4.5, rel=1e-9)


def test_a_clutch_locks():
    found = run("clutch_lock")
    (lock,) = found.events
    assert lock.kind == "lock" and lock.time == pytest.approx(4 / 3, abs=1e-10)
    assert found["w1"][-1] == pytest.approx(10 / 3, abs=1e-9) and found["w2"][-1] == pytest.approx(10 / 3, abs=1e-9)
    assert found.energy.lost[-1] == pytest.approx(100 / 3, rel=1e-9)


def test_an_atwood_machine_takes_up_its_slack():
    found = run("atwood_jerk")
    (jerk,) = [e for e in found.events if e.impulse > 0 and e.kind == "taut"]
    assert jerk.time == pytest.approx(np.sqrt(2 * 0.5 / 9.81), abs=1e-10)
    assert jerk.impulse == pytest.approx(2.08806130178211, abs=1e-9)
    assert jerk.energy_lost == pytest.approx(3.27, abs=1e-9)


def test_bounces_come_to_an_end():
    found = lmoc.compile(MODELS / "h19_bouncing_ball.lmo", parameters={"e": 0.7}).simulate(rtol=1e-10)
    times = [e.time for e in found.events]
    assert times[:3] == pytest.approx([0.4515236409857309, 1.083656738365754, 1.5261499065317703], abs=1e-10)
    assert found.events[-1].kind == "accumulation" and times[-1] == pytest.approx(2.558633965585808, abs=1e-8)
    rest = found.time > 2.6
    assert (found["ball.q"][rest] == 0).all() and (found["ball.v"][rest] == 0).all()
    assert found.energy.lost[-1] == pytest.approx(9.81, rel=1e-9)


@pytest.mark.parametrize("solver", ["cvode", "adams", "ida", "radau", "gauss"])
def test_every_solver_goes_through_impacts_stops_and_slack(solver):
    """Multistep methods begin anew at each event, with order one; the errors are those of the tolerance."""
    ball = lmoc.compile(MODELS / "h19_bouncing_ball.lmo", parameters={"e": 0.7}).simulate(rtol=1e-8, solver=solver)
    assert [e.time for e in ball.events[:3]] == pytest.approx([0.45152364098573, 1.08365673836575, 1.52614990653177])
    last = ball.events[-1]
    assert last.kind == "accumulation" and last.time == pytest.approx(2.558633965585808, abs=1e-6)
    assert ball["ball.q"][-1] == ball["ball.v"][-1] == 0.0
    box = run("friction_stop", rtol=1e-8, solver=solver)
    assert [e.kind for e in box.events] == ["stick"]
    assert box.events[0].time == pytest.approx(0.7645259938837919, abs=1e-7)
    assert box["box.q"][-1] == pytest.approx(1.146788990825688, abs=1e-7) and box["box.v"][-1] == 0.0
    locked = run("clutch_lock", rtol=1e-8, solver=solver)
    assert [e.time for e in locked.events] == pytest.approx([4 / 3], abs=1e-7)
    assert locked["w1"][-1] == pytest.approx(10 / 3, abs=1e-7)
    pendulum = run("slack_pendulum", rtol=1e-8, solver=solver, stop=2)
    assert [e.kind for e in pendulum.events] == ["slack", "taut"]
    assert [e.time for e in pendulum.events] == pytest.approx([0.484466131711, 1.276023589312], abs=1e-6)


def test_wagons_are_caught_one_after_the_other():
    found = lmoc.compile(MODELS / "wagons.lmo", parameters={"N": 12}).simulate(rtol=1e-10)
    caught = [e for e in found.events if e.kind == "taut"]
    k = np.arange(1, 12)
    assert [e.time for e in caught] == pytest.approx(np.sqrt(0.01 * k * (k + 1)), abs=1e-10)
    assert [e.name for e in caught] == [f"string[{i}]" for i in k]
    assert found["v"][-1] == pytest.approx((10 * 6) / 12, abs=1e-9)
    # wagon k + 1 is caught with the impulse p = v, of which each wagon before it has taken its share
    last = caught[-1]
    assert last.passed_on == tuple((f"string[{i}]", pytest.approx(last.impulse * i / 11, abs=1e-9)) for i in k[:-1])
    gaps = np.array([found[f"string[{i}].gap"] for i in k])
    assert gaps.min() > -1e-12 and np.array([found[f"string[{i}].f"] for i in k]).min() > -1e-9


def test_at_an_asked_time_that_is_an_event_the_value_is_the_one_behind_it():
    jump = run("h06_bungee").events[0].time
    found = run("h06_bungee", times=[0.0, jump, 1.0])
    assert found["upper.v"][1] == pytest.approx(2.08806130178211, abs=1e-9)
    assert found["lower.v"][1] == pytest.approx(found["upper.v"][1], abs=1e-14)


def test_modes_and_pieces_are_reported():
    found = run("h06_bungee")
    assert [e.kind for e in found.events] == ["taut", "slack", "taut"]
    assert [(e.before, e.after) for e in found.events] == [("slack", "taut"), ("taut", "slack"), ("slack", "taut")]
    assert found["string.gap"].min() > -1e-12 and found["string.f"].min() >= 0


@pytest.mark.parametrize("name", ["h06_bungee", "h16_stick_slip", "clutch_lock"])
def test_scenes_with_laws_have_a_picture(name, tmp_path):
    path = tmp_path / "run.png"
    run(name, rtol=1e-6).plot(path=path)
    assert path.stat().st_size > 10_000
