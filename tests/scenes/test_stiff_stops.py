"""A stop as a stiff spring tends to the law's answer as its stiffness grows, and as fast as theory says."""

import math

import pytest

import lmoc
from benchmarks.laws import ON_SPRING, ON_STOP, SPEED, height


def test_the_law_is_exact():
    """Two bounces without loss in 2 s."""
    run = lmoc.compile_text(ON_STOP).simulate(stop=2, points=21, rtol=1e-10)
    assert run["ball.q"] == pytest.approx([height(t) for t in run.time], abs=1e-11)
    assert [e.kind for e in run.events] == ["impact", "impact"] and run.energy.balance < 1e-12


def test_springs_tend_to_the_law():
    """Each contact takes half a period of the mass on the spring, π·√(m/k), where the impact takes no time."""
    dae, t = lmoc.compile_text(ON_SPRING), 1.0  # behind the first bounce
    scaled = []
    for k in (1e5, 1e7, 1e9):
        run = dae.simulate(stop=t, points=2, rtol=1e-10, parameters={"k": k})
        scaled.append((height(t) - run["ball.q"][-1]) * math.sqrt(k))
        assert run["ball.v"][-1] == pytest.approx(2 * SPEED - 9.81 * t, abs=50 / math.sqrt(k))
    late = math.pi * (9.81 * t - 2 * SPEED)  # the height changes by −ẏ·delay
    assert scaled[-1] == pytest.approx(-late, rel=1e-3)
    assert abs(scaled[0] + late) > 10 * abs(scaled[2] + late)
