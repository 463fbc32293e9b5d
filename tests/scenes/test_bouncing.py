"""Balls and stops of any restitution up to 1: they come to rest, or bounce on, and no run hangs."""

import numpy as np
import pytest
from oracles.bouncing import SIZE, STACKED, draw

import lmoc


@pytest.mark.parametrize("solver", ["auto", "dop853", "taylor", "radau"])
def test_a_steel_floor_below_two_balls_that_lose_energy_between_them(solver):
    """By a computation with 60 digits they rest after 396 impacts, at 1.8105052639 s."""
    run = lmoc.compile_text(STACKED).simulate(stop=2.0, solver=solver)
    assert len(run.events) < 600
    (over,) = [e for e in run.events if e.kind == "accumulation" and e.name == "s"]
    assert over.time == pytest.approx(1.8105052639, abs=2e-9)
    assert run.modes[-1][1] == {"s": "contact", "t": "contact"}
    assert run["a.q"][-1] == pytest.approx(0.1, abs=1e-12) and run["b.v"][-1] == 0.0
    assert run.energy.balance < 1e-6


def test_a_ball_without_loss_bounces_for_ever():
    """The height of its fall does not matter."""
    for height in (1.0, 1e-3, 1e-6):
        text = f"""model Ball Mass m(m = 1, g = -10, q(start = {height!r}, fixed = true), v(start = 0, fixed = true));
            Stop s(L = 0, e = 1); Fixed w; equation connect(w.flange, s.a); connect(s.b, m.flange); end Ball;"""
        period = 2 * (2 * height / 10) ** 0.5
        run = lmoc.compile_text(text).simulate(stop=20.25 * period)
        assert [e.kind for e in run.events] == ["impact"] * 20
        assert run.events[-1].time == pytest.approx(19.5 * period, rel=1e-9)


def test_random_balls():
    """`python tests/many_bounces.py` draws more of them."""
    for seed in range(8):
        assert not compare(np.random.default_rng(seed))[1]


def compare(rng, stop=3.0):
    """Compare the first impacts with those in closed form; nothing may overlap or gain energy.

    Returns the run, and why it has ended early.
    """
    balls = draw(rng)
    text = balls.text()
    expected = [(t, f"s{k}") for t, k in balls.impacts(12, 1e-4) if t < stop]
    reason = ""
    try:
        run = lmoc.compile_text(text).simulate(stop=stop, rtol=1e-9)
    except lmoc.SimulationError as failed:
        run, reason = failed.partial, str(failed)
    found = [(e.time, e.name) for e in run.events if e.impulse][: len(expected)]
    assert [name for _, name in found] == [name for _, name in expected], text
    assert np.allclose([t for t, _ in found], [t for t, _ in expected], rtol=1e-7, atol=1e-9), text
    q = np.array([run[f"m{k}.q"] for k in range(len(balls.masses))])
    assert (np.diff(q, axis=0) >= SIZE - 1e-11).all() and (q[0] >= SIZE / 2 - 1e-11).all(), text
    assert (q[-1] <= balls.ceiling - SIZE / 2 + 1e-11).all(), text
    lost = np.array([sum(e.energy_lost for e in run.events if e.time == t) for t in {e.time for e in run.events}])
    assert (lost >= -1e-12).all(), text  # of all laws together; one may gain what another one loses
    return run, reason
