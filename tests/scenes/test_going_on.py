"""Runs of scenes with laws and events that are cut anywhere go on as if they had never stopped."""

from pathlib import Path

import numpy as np
import pytest
from oracles.random_laws import draw

import lmoc

MODELS = Path(__file__).parents[2] / "models" / "laws"
RTOL = 1e-9

SAMPLED = """model Sampled "a sampled controller with memory, and conditions of every kind"
  Real x(start = 1, fixed = true), y(start = 0, fixed = true);
  discrete Real u(start = 0, fixed = true);
  Integer n(start = 0, fixed = true);
  Boolean up(start = false, fixed = true);
equation
  der(x) = -x + u;
  der(y) = if x > 0.3 then 1 else -1;
  when sample(0.1, 0.25) then u = -0.8*pre(u) + x; n = pre(n) + 1; end when;
  when x > 0.45 then up = not pre(up); elsewhen time > 1.7 then up = true; end when;
end Sampled;"""


def check(dae: lmoc.DAE, stop: float, cuts: list[float]) -> None:
    whole = dae.simulate(stop=stop, rtol=RTOL, points=3)
    names = [n for n in whole.flat.names() if n.split(".")[0] != "ledger" and "heat" not in n]
    names = [n for n in names if whole.flat.find(n) is not None]
    told = sorted((e.name, e.kind, round(e.time, 7)) for e in whole.events)
    for cut in cuts:
        first = dae.simulate(stop=cut, rtol=RTOL, points=2)
        second = dae.simulate(start=cut, stop=stop, initial=first.end, rtol=RTOL, points=2)
        both = sorted((e.name, e.kind, round(e.time, 7)) for e in (*first.events, *second.events))
        assert both == told, f"cut at {cut!r}"
        assert second.modes[-1][1] == whole.modes[-1][1]
        for name in names:
            assert second[name][-1] == pytest.approx(whole[name][-1], rel=1e-6, abs=1e-6), f"{name}, cut at {cut!r}"


@pytest.mark.parametrize("name", ["atwood_jerk", "clutch_lock", "h06_bungee", "h16_stick_slip", "h18_freewheel"])
def test_laws(name):
    dae = lmoc.compile(MODELS / f"{name}.lmo")
    stop = dae.flat.experiment.stop
    events = [e.time for e in dae.simulate(rtol=RTOL).events][:2]
    cuts = np.random.default_rng(4).uniform(0, stop, 2).tolist()
    check(dae, stop, cuts + [t + apart for t in events for apart in (0.0, 1e-12, -1e-12)])


def test_a_bouncing_ball_is_cut_at_a_bounce():
    dae = lmoc.compile(MODELS / "h19_bouncing_ball.lmo")
    bounce = dae.simulate(rtol=RTOL).events[1].time
    check(dae, 2.0, [bounce, bounce + 1e-13, 1.0])


def test_a_run_ends_wherever_it_is_stopped_beside_a_bounce():
    """Of a step of a few units of the last digit of time no more is seen than its ends."""
    dae = lmoc.compile(MODELS / "h19_bouncing_ball.lmo")
    bounce = dae.simulate(rtol=RTOL, stop=2.0).events[1].time
    for ulps in range(-12, 13):
        with lmoc.budget(20):
            run = dae.simulate(stop=bounce + ulps * 2.0**-52, rtol=RTOL, points=2)
        assert [e.kind for e in run.events] in (["impact"] * 2, ["impact"]), ulps
        assert abs(run["ball.q"][-1]) < 1e-12


def test_samples_and_discrete_values():
    check(lmoc.compile_text(SAMPLED), 3.0, [0.1, 0.35, 0.35 - 1e-13, 1.7, 0.2, 1.9])


def test_what_a_model_does_at_its_end_is_not_done_by_a_run_that_goes_on():
    text = """model Ending
      Real x(start = 1, fixed = true);
      Integer n(start = 0, fixed = true), ends(start = 0, fixed = true);
    equation
      der(x) = -x;
      when sample(0.1, 0.2) then n = pre(n) + 1; end when;
      when terminal() then reinit(x, 5); ends = pre(ends) + 1; end when;
    end Ending;"""
    dae = lmoc.compile_text(text)
    first = dae.simulate(stop=0.5, rtol=1e-12)
    second = dae.simulate(start=0.5, stop=1, initial=first.end, rtol=1e-12, times=[0.75, 1])
    assert first["x"][-1] == second["x"][-1] == 5
    assert first.end["x"] == pytest.approx(np.exp(-0.5), abs=1e-11)
    assert second["x"][0] == pytest.approx(np.exp(-0.75), abs=1e-11)
    assert (second["n"][-1], second["ends"][-1]) == (5, 1)


@pytest.mark.parametrize("seed", [1, 3, 4, 9])
def test_random_scenes_go_on_wherever_they_are_cut(seed):
    """Also within sticking, between bounces, and right beside events."""
    dae = lmoc.compile_text(draw(seed).text)
    whole = dae.simulate(stop=2, rtol=1e-12, points=2)
    dice = np.random.default_rng(seed)
    events = [e.time for e in whole.events if 0 < e.time < 2]
    near = [t + apart for t, apart in zip(dice.permutation(events)[:2], (0.0, 1e-12), strict=False)]
    for cut in [*dice.uniform(0.1, 1.9, 2), *near]:
        first = dae.simulate(stop=cut, rtol=1e-12, points=2)
        second = dae.simulate(start=cut, stop=2, initial=first.end, rtol=1e-12, points=2)
        assert len(first.events) + len(second.events) == len(whole.events)
        assert second.modes[-1][1] == whole.modes[-1][1]
        for name in dae.states:
            assert second[name][-1] == pytest.approx(whole[name][-1], rel=1e-10, abs=1e-10), (name, cut)


def test_changed_parameters_are_judged_again():
    """Friction that has held lets go where the limit is less in the second run."""
    dae = lmoc.compile(MODELS / "h16_stick_slip.lmo")
    first = dae.simulate(stop=0.3)
    second = dae.simulate(start=0.3, stop=0.4, initial=first.end, parameters={"friction.Fstick": 2.0})
    assert [(e.kind, e.time) for e in second.events] == [("slip", 0.3)]


def test_the_size_of_a_motion_does_not_depend_on_the_output_times():
    """A ball that starts just above the floor and is seen at its start and its end alone."""
    text = """model Ball Fixed floor; Mass ball(m = 1, g = -9.81, q(start = 2.8e-15, fixed = true),
    v(start = -3, fixed = true)); Stop contact(L = 0, e = 0.5);
    equation connect(floor.flange, contact.a); connect(contact.b, ball.flange); end Ball;"""
    run = lmoc.compile_text(text).simulate(stop=2, points=2)
    assert run["ball.q"][-1] == 0.0 and run.events[-1].kind == "accumulation"
    assert run.events[-1].time == pytest.approx(2 * 1.5 / 9.81 / (1 - 0.5), rel=1e-7)
