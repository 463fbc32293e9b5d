"""Equations of closed loops in the textbook's form: they hold along simulated motions, and are refused where not."""

import numpy as np
import pytest
import sympy as sp
from oracles.models import compiled

import lmoc
from lmoc.symbolic.system import jet_symbol

MULTIPLIERS = [sp.Symbol(n) for n in ("lambda", "lambda1", "lambda2")]


@pytest.mark.parametrize("scene", ["planar/slider_crank", "planar/four_bar"])
def test_equations_with_closures_hold_along_a_motion(scene):
    """With the multipliers that suit best, at positions, velocities and accelerations of a run."""
    dae = compiled(scene)
    found = dae.equations()
    run = dae.simulate(stop=0.5, points=2, rtol=1e-10, formulation="index1")
    parameters = {sp.Symbol(n): v for n, v in dae.parameters.items()}
    unknown = [m for m in MULTIPLIERS if any(e.residual.has(m) for e in found.equations)]
    assert len(unknown) == len(found.closures) > 0
    for k in range(len(run.time)):
        numbers = dict(parameters)
        for q in found.coordinates:
            rate = run.reduced.state_names[run.reduced.state_names.index(q) + 1]
            jets = run[q][k], run[rate][k], run[f"der({rate})"][k]
            numbers |= {jet_symbol(q, n): value for n, value in enumerate(jets)}
        for closure in found.closures:
            assert abs(float(closure.subs(numbers))) < 1e-8
        left = [sp.expand(e.residual.subs(numbers)) for e in found.equations]
        rows = np.array([[float(r.coeff(m)) for m in unknown] for r in left])
        rest = np.array([float(r.subs(dict.fromkeys(unknown, 0))) for r in left])
        force = np.linalg.lstsq(rows, -rest, rcond=None)[0]
        size = np.abs(rows) @ np.abs(force) + np.abs(rest)
        assert np.abs(rows @ force + rest).max() <= 1e-6 * size.max()


def test_the_nearly_parallel_four_bar_reads_as_in_a_textbook():
    found = compiled("hard/h03_four_bar").equations()
    assert found.lines()[0] == "J_crank·θ̈ - rx_A·sin(θ)·λ1 - rx_A·cos(θ)·λ2 = 0"
    assert found.closure_lines()[1] == "L·sin(φ_coupler) + rx_A·sin(θ) - rx_B·sin(φ) = 0"
    assert "closures of the loops:" in found.text()
    assert len(found.to_dict()["closures"]) == 2
    assert "\\lambda" in found.latex()
    with pytest.raises(lmoc.ModelError, match="E0660"):
        found.about({})  # there are none in deviations
