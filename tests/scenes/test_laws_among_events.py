"""Laws in scenes with events of other kinds: what has been let go stays free while both are settled at one instant."""

import numpy as np
import pytest

import lmoc

BLOCK = """
model Block
  Fixed ground;
  DryFriction friction(F = 3, Fstick = 4);
  Mass body(m = 2, q(start = 0, fixed = true), v(start = 3, fixed = true));
  Force push(f = if time < 3 then 0 else {slope}*(time - 3));
  {declarations}
equation
  connect(ground.flange, friction.a);
  connect(friction.b, body.flange);
  connect(push.flange, body.flange);
  {equations}
end Block;
"""
STRING = """
model String
  Fixed ceiling;
  Mass body(m = 1, q(start = 1, fixed = true), v(start = 0, fixed = true));
  Cable string(L = 1);
  Force pull(f = if time < 1 then 2 else 2 - 2*(time - 1));
  Boolean loaded = string.f > 0;
  discrete Integer n(start = 0, fixed = true);
equation
  connect(ceiling.flange, string.a);
  connect(string.b, body.flange);
  connect(pull.flange, body.flange);
  when not loaded then
    n = pre(n) + 1;
  end when;
end String;
"""


def block(slope, declarations="", equations=""):
    text = BLOCK.format(slope=slope, declarations=declarations, equations=equations)
    return lmoc.compile_text(text).simulate(stop=7, rtol=1e-9)


@pytest.mark.parametrize("slope", [2, 2.1, 1.7, -2])
def test_a_block_breaks_away_from_its_sticking_friction(slope):
    run = block(slope)
    away = 3 + 4 / abs(slope)
    t = run.time
    behind = np.sign(slope) * (abs(slope) * ((t - 3) ** 2 - (away - 3) ** 2) / 2 - 3 * (t - away)) / 2
    v = np.where(t < 2, 3 - 1.5 * t, np.where(t < away, 0, behind))
    np.testing.assert_allclose(run["body.v"], v, atol=1e-8)
    assert [e.kind for e in run.events] == ["stick", "relation", "slip"]
    assert run.events[-1].time == pytest.approx(away, abs=1e-10)


def test_a_jump_of_friction_that_others_count_does_not_make_it_stick_again():
    run = block(
        2,
        "discrete Integer n(start = 0, fixed = true); Boolean weak = abs(friction.f) < 3.5;",
        "when weak then n = pre(n) + 1; end when;",
    )
    assert run["body.v"][-1] == pytest.approx(3.0, abs=1e-8)  # ((4² − 2²) − 3·2)/2
    assert run["n"][-1] == 1  # at 5 s the friction falls from 4 N to 3 N
    assert sum(e.kind == "slip" for e in run.events) == 1


def test_friction_that_a_bounce_turns_opens_nothing():
    wall = "Stop wall(e = 0.5, L = 0); Fixed side(q0 = 1);"
    run = block(0, wall, "connect(body.flange, wall.a); connect(side.flange, wall.b);")
    assert {(e.name, e.kind, e.before, e.after) for e in run.events[:2]} == {
        ("wall", "impact", "open", "open"), ("friction", "reversal", "slip", "slip"),
    }  # fmt: skip
    assert [e.kind for e in run.events[2:]] == ["stick"]


def test_a_string_opens_with_what_depends_on_its_tension():
    run = lmoc.compile_text(STRING).simulate(stop=3, rtol=1e-9)
    t = run.time
    np.testing.assert_allclose(run["body.q"], np.where(t < 2, 1, 1 - (t - 2) ** 3 / 3), atol=1e-9)
    assert run["n"][-1] == 1
    assert [(e.kind, round(e.time, 9)) for e in run.events if e.name == "string"] == [("slack", 2.0)]


@pytest.mark.parametrize("motion", ["sin(time)", "if time < 1 then 0 else 0.5*(time - 1)"])
@pytest.mark.parametrize("friction", [False, True])
def test_what_a_moving_string_tows_keeps_its_own_coordinates(motion, friction):
    """Neither the gap of the string nor the rate of its friction is a better state than the body's position."""
    rubs = "DryFriction rub(F = 1); Fixed floor;" if friction else ""
    joins = "connect(floor.flange, rub.a); connect(rub.b, body.flange);" if friction else ""
    scene = lmoc.compile_text(f"""
        model Towed
        Motion hand(q = {motion}); Cable string(L = 1); Mass body(m = 2, q(start = 0.4, fixed = true)); {rubs}
        equation connect(body.flange, string.a); connect(string.b, hand.flange); {joins} end Towed;""")
    assert scene.states == ["body.q", "body.v"]
    run = scene.simulate(stop=6, rtol=1e-9)
    assert (run["string.gap"] > -1e-12).all() and (run["string.f"] > -1e-9).all()
    if "time - 1" in motion:  # caught at 3.8 s, without restitution
        caught = np.where(run.time < 3.8, 0.4, 0.4 + 0.5 * (run.time - 3.8))
        np.testing.assert_allclose(run["body.q"], caught, atol=1e-9)


SURFACE = """
model Surface "A mass on a surface that moves up and down by a formula, and is heavy"
  Mass m(m = 2, q(start = 0.02, fixed = true), v(start = 0, fixed = true), g = -9.81);
  Real lift, f(unit = "N");
  Force push(f = f);
equation
  lift = %s;
  connect(push.flange, m.flange);
  Law.unilateral(f, m.q - lift);
end Surface;
"""


def test_what_jumps_away_under_a_mass_lets_it_fall() -> None:
    run = lmoc.compile_text(SURFACE % "0.01*mod(time, 0.7)").simulate(times=[0.0, 0.69, 0.7, 0.71, 0.73, 0.8])
    s = np.array([0.0, 0.01, 0.03])
    assert run["m.q"][2:5] == pytest.approx(0.007 + 0.01 * s - 9.81 * s**2 / 2, rel=1e-9)
    landed = [e for e in run.events if e.kind == "contact"]
    fall = np.roots([-9.81 / 2, 0.0, 0.007]).max()  # beside the tooth that begins with the same velocity
    assert [e.time for e in landed][-1] == pytest.approx(0.7 + fall, rel=1e-9)
    assert landed[-1].energy_lost == pytest.approx(2 * 9.81 * 0.007, rel=1e-8)
    assert run.energy.balance < 1e-6


def test_what_turns_down_under_a_mass_throws_it() -> None:
    run = lmoc.compile_text(SURFACE % "if time < 0.5 then 0.02*time else 0.02 - 0.02*time").simulate(stop=0.6)
    release, landing = [e for e in run.events if e.name == "f"][-2:]
    assert (release.time, release.kind, landing.kind) == (0.5, "release", "contact")
    assert landing.time == pytest.approx(0.5 + 2 * 0.04 / 9.81, rel=1e-9)
    assert landing.energy_lost == pytest.approx(0.04**2, rel=1e-6)
    assert run.energy.balance < 1e-6


def test_what_turns_up_under_a_mass_hits_it() -> None:
    run = lmoc.compile_text(SURFACE % "if time < 0.5 then -0.02*time else 0.02*time - 0.02").simulate(stop=0.6)
    hit = [e for e in run.events if e.name == "f"][-1]
    assert (hit.time, hit.kind) == (0.5, "impact")
    assert hit.impulse == pytest.approx(2 * 0.04, rel=1e-9)
    assert run["m.v"][-1] == pytest.approx(0.02, rel=1e-9)
    assert run.energy.balance < 1e-6


def test_what_jumps_up_under_a_mass_is_refused() -> None:
    with pytest.raises(lmoc.SimulationError, match=r"gap of 'f', which is closed, jumps to -0\.01 at t = 0\.5 s"):
        lmoc.compile_text(SURFACE % "if time < 0.5 then 0.0 else 0.01").simulate(stop=0.6)


@pytest.mark.parametrize("solver", ["auto", "dop853", "radau", "cvode"])
def test_a_load_that_is_moved_below_a_taut_rope_falls_into_it(solver):
    """What was closed opens where a jump of the states leaves a gap, and is refused where they overlap."""
    text = """model Moved Fixed c; Cable rope(L = 1);
        Mass m(m = 1, g = 10, q(start = 1, fixed = true), v(start = 0, fixed = true));
      equation connect(c.flange, rope.a); connect(rope.b, m.flange);
        when time > 0.5 then reinit(m.q, pre(m.q) + ({by})); end when; end Moved;"""
    run = lmoc.compile_text(text.format(by=-0.1)).simulate(stop=1.0, solver=solver)
    slack, taut = [e for e in run.events if e.name == "rope"]
    assert (slack.kind, slack.time) == ("slack", 0.5) and taut.kind == "taut"
    assert taut.time == pytest.approx(0.5 + 0.02**0.5, abs=1e-6) and taut.impulse == pytest.approx(2**0.5, rel=1e-5)
    falling = (run.time > 0.5) & (run.time < taut.time)
    assert run["m.q"][falling] == pytest.approx(0.9 + 5 * (run.time[falling] - 0.5) ** 2, abs=1e-6)
    assert run["m.q"][-1] == pytest.approx(1.0, abs=1e-9)
    with pytest.raises(lmoc.SimulationError, match="the gap of 'rope' is negative, -0.1, at t = 0.5 s"):
        lmoc.compile_text(text.format(by=0.1)).simulate(stop=1.0, solver=solver)


def test_a_hand_that_steps_lets_a_rope_go_slack_and_moves_no_load():
    text = """model Hand Motion hand(q = if time < 0.5 then 0 else ({to})); Cable rope(L = 1);
        Mass m(m = 1, g = 10, q(start = {first}, fixed = true), v(start = 0, fixed = true));
      equation connect(hand.flange, rope.a); connect(rope.b, m.flange); end Hand;"""
    run = lmoc.compile_text(text.format(to=0.2, first=1.0)).simulate(stop=1.0)
    ropes = [e for e in run.events if e.name == "rope"]
    assert [e.kind for e in ropes] == ["slack", "taut"]
    assert [e.time for e in ropes] == pytest.approx([0.5, 0.7], abs=1e-6)
    assert run["m.q"][-1] == pytest.approx(1.2, abs=1e-9)
    run = lmoc.compile_text(text.format(to=-0.1, first=-0.6)).simulate(stop=0.52)  # slack before and behind
    assert not [e for e in run.events if e.name == "rope"]
    assert run["m.q"][-1] == pytest.approx(-0.6 + 5 * 0.52**2, abs=1e-8)
    with pytest.raises(lmoc.SimulationError, match="gap of 'rope', which is closed, jumps to -0.2"):
        lmoc.compile_text(text.format(to=-0.2, first=1.0)).simulate(stop=1.0)
