"""Constraints of many loops are judged loop by loop: by what they are, at the cost of their number."""

from __future__ import annotations

import numpy as np
import pytest
from conftest import ROOT
from scipy.integrate import solve_ivp

import lmoc
from lmoc.numerics.coordinates import local_form, watch
from lmoc.numerics.coordinates.tableau import rank_margin

WINDOWS = ROOT / "models/classic/windows.lmo"


@pytest.fixture(autouse=True)
def few(monkeypatch):
    """Have few constraints seen in blocks as well."""
    monkeypatch.setattr(local_form, "DENSE", 8)


def looks(n: int, stop: float, monkeypatch) -> tuple[list, lmoc.Result]:
    """Run n windows; the form and the place of each look."""
    seen, look = [], watch.CoordinateWatch._look

    def recorded(self, t, x):
        place = look(self, t, x)
        seen.append((self._form, place, self.constraints.watched))
        return place

    with monkeypatch.context() as patched:
        patched.setattr(watch.CoordinateWatch, "_look", recorded)
        run = lmoc.compile(WINDOWS, parameters={"N": n}).simulate(stop=stop, points=31)
    return seen, run


def test_blocks_are_windows_and_say_what_the_whole_matrix_says(monkeypatch):
    """Twelve windows through their first singular position, at 0.72 s; (13/3 + 12)·θ'' = -(13/2 + 12)·g·cos θ."""
    seen, run = looks(12, 1.0, monkeypatch)
    assert len(seen) > 10
    for form, place, watched in seen:
        assert form.sizes == 12 * [6]
        rows = len(place.matrix)
        dependent, states = place.matrix[:, :rows], place.matrix[:, rows:]
        assert place.found.sign in (1.0, -1.0)
        assert place.found.plain == pytest.approx(np.linalg.solve(dependent, states)[watched], rel=1e-7, abs=1e-9)
        assert place.margin >= rank_margin(place.scaled) * (1 - 1e-9)
    assert [n.message.split(" was")[0] for n in run.notes if n.code == "N0633"] == ["a singular position"]
    ratio = (13 / 2 + 12) / (13 / 3 + 12) * 9.81
    exact = solve_ivp(lambda t, z: [z[1], -ratio * np.cos(z[0])], (0, 1), [np.pi / 2, -1], "DOP853", run.time,
                      rtol=1e-12, atol=1e-12).y[0]  # fmt: skip
    assert np.abs(run["first.phi"] - exact).max() < 1e-6
    assert all(np.abs(run[f"foot[{k}].phi"] - run["first.phi"]).max() < 1e-11 for k in range(1, 13))


def test_margin_is_that_of_one_window_however_many_there_are(monkeypatch):
    """The whole matrix comes nearer to dependence the more windows there are in a row; none of them does."""
    few, many = (looks(n, 1e-3, monkeypatch)[0][0][1] for n in (4, 24))
    assert rank_margin(many.scaled) < 0.3 * rank_margin(few.scaled)
    assert many.margin == pytest.approx(few.margin, rel=0.2)
