"""The key numbers of docs/stability.md, from the same runs."""

from pathlib import Path

import numpy as np
import pytest

from benchmarks import stability

PAGE = Path(__file__).parents[2] / "docs" / "stability.md"
EXPECTED = {
    stability.damping_of_bdf: lambda n: n["cvode"] > 5e-3 and n["auto"] < 1e-4 and n["gauss"] < 1e-9,
    stability.drift: lambda n: n["1e-06"] > 1e-4 and n["0.0001"] > 0.01 and n["reduced"] < 1e-9,
    stability.formulations: lambda n: n["index3"] < 20 and n["index1"] > 1e-4 and n["projected"] + n["reduced"] < 1e-12,
    stability.beyond_the_stability_limit: lambda n: n["rk4"] > 1e3 and n["verlet"] > 1e3 and n["midpoint"] < 2,
    stability.stiffness: lambda n: n["dop853"] > 50 * n["auto"],
    stability.ringing: lambda n: n["midpoint"] > 0.5 and n["generalized-alpha"] < 0.1 and n["radau"] < 1e-4,
    stability.order_reduction: lambda n: n["order at k = 1"] > 7.5 and n["order at k = 100000"] < 5,
    stability.stiff_limit_of_laws: lambda n: n["apart at k = 10000"] > 0.1 and n["instants of the law"] < 1e-9,
    stability.chatter: lambda n: n["stopped"] < 0.1 and n["told"] and n["seconds"] < 5,
    stability.creep: lambda n: n["smooth"] > 0.05 and n["dry"] == 0,
    stability.aliasing: lambda n: n["at periods"] > 3 and n["auto"] < 0.2,
    stability.a_pulse_stepped_over: lambda n: abs(n["rk4"] - 1.77) > 1 and abs(n["auto"] - 1.7724539) < 1e-4,
    stability.zeno: lambda n: 1 < n["rests"] < 10 and n["events"] < 1000,
    stability.bifurcation: lambda n: n["reached"] > 0 and n["energy"] < 1e-4,
    stability.small_amplitudes: lambda n: n["absolute"] > 0.3 and n["default"] < 1e-4,
}


SHORT = {stability.damping_of_bdf: {"symplectic": 628.0}}


@pytest.mark.parametrize("make", EXPECTED, ids=lambda make: make.__name__)
def test_the_failure_and_its_remedy(make):
    failure = make(**SHORT.get(make, {}))
    assert EXPECTED[make](failure.numbers), failure.numbers
    assert f"## {failure.title}" in PAGE.read_text(encoding="utf-8")


def test_every_failure_is_on_the_page():
    text = PAGE.read_text(encoding="utf-8")
    assert text.count("\n## ") >= 12
    assert set(stability.ALL) - set(EXPECTED) == {stability.long_runs, stability.chaos}  # too long as they are


def test_energy_over_ten_thousand_periods():
    """The default keeps it within 1e-4; the symplectic method does not drift, and a method with error control does."""
    H = stability.own("oscillator").simulate(stop=62832.0, points=201)["H"]
    assert abs(H - 1).max() < 1e-4
    numbers = stability.long_runs(stop=3141.6).numbers
    assert numbers["gauss"] == pytest.approx(numbers["gauss early"], rel=0.1) and numbers["gauss"] < 1e-7
    assert numbers["dop853"] > 3 * numbers["dop853 early"]


def test_chaos_buys_seconds_for_digits():
    """Errors grow by a constant rate, so that finer tolerances postpone their end by a constant time."""
    dae = stability.model("models/planar/double_pendulum.lmo")
    runs = {rtol: dae.simulate(stop=20, rtol=rtol, solver="dop853", points=201) for rtol in (1e-6, 1e-8, 1e-12)}
    name = runs[1e-6].states[0]
    until = [runs[1e-6].time[np.argmax(abs(runs[r][name] - runs[1e-12][name]) > 0.01)] for r in (1e-6, 1e-8)]
    assert 5 < until[0] < until[1] - 1 < 19
