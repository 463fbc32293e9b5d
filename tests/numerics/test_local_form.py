"""Constraints of many loops are judged loop by loop: by what they are, at the cost of their number."""

from __future__ import annotations

import numpy as np
import pytest
from conftest import ROOT
from scipy.integrate import solve_ivp

import lmoc
from lmoc.numerics.coordinates.local_form import LocalRows
from lmoc.numerics.coordinates.local_places import LocalPlaces
from lmoc.numerics.coordinates.tableau import rank_margin

WINDOWS = ROOT / "models/classic/windows.lmo"
LIFT = """
model Lift "Crossing bars in stages; the lowest ones stand on a pin and on a slider"
  import Planar.*;
  parameter Integer N = 7;
  inner World world;
  Ground ground;
  Revolute hinge, foot, middle[N], left[N - 1], right[N - 1];
  Prismatic slide(s(start = cos(0.5), fixed = true), v(start = 0, fixed = true));
  Bar up[N](each l = 1, each m = 1, each theta(start = 0.5));
  Bar down[N](each l = 1, each m = 1, each theta(start = 2.64));
  Link rising[N](each rx = 0.5, each ry = 0), falling[N](each rx = 0.5, each ry = 0);
equation
  connect(ground.frame, hinge.a);
  connect(hinge.b, up[1].a);
  connect(ground.frame, slide.a);
  connect(slide.b, foot.a);
  connect(foot.b, down[1].a);
  for i in 1:N loop
    connect(up[i].a, rising[i].a);
    connect(down[i].a, falling[i].a);
    connect(rising[i].b, middle[i].a);
    connect(middle[i].b, falling[i].b);
  end for;
  for i in 1:N - 1 loop
    connect(down[i].b, left[i].a);
    connect(left[i].b, up[i + 1].a);
    connect(up[i].b, right[i].a);
    connect(right[i].b, down[i + 1].a);
  end for;
end Lift;
"""


def looks(n: int, stop: float, monkeypatch) -> tuple[list, lmoc.Result]:
    """Run n windows; the form of each look, its matrix, the scaled one, its tableau and margin, the tableau's rows."""
    seen, look = [], LocalPlaces.see

    def recorded(self, place):
        look(self, place)
        dense, watched = self.form.dense, self._judge.watched
        scaled = dense(self.sizes.scaled(place.matrix))
        seen.append((self.form, dense(place.matrix), scaled, place.table.copy(), place.head[3], watched))

    with monkeypatch.context() as patched:
        patched.setattr(LocalPlaces, "see", recorded)
        run = lmoc.compile(WINDOWS, parameters={"N": n}).simulate(stop=stop, points=31)
    return seen, run


def test_blocks_are_windows_and_say_what_the_whole_matrix_says(monkeypatch):
    """Twelve windows through their first singular position, at 0.72 s; (13/3 + 12)·θ'' = -(13/2 + 12)·g·cos θ."""
    seen, run = looks(12, 1.0, monkeypatch)
    assert len(seen) > 10
    for form, matrix, scaled, table, margin, watched in seen:
        assert form.sizes == 12 * [6]
        rows = len(matrix)
        dependent, states = matrix[:, :rows], matrix[:, rows:]
        assert table == pytest.approx(np.linalg.solve(dependent, states)[watched], rel=1e-7, abs=1e-9)
        assert margin >= rank_margin(scaled) * (1 - 1e-9)
    assert [n.message.split(" was")[0] for n in run.notes if n.code == "N0633"] == ["a singular position"]
    ratio = (13 / 2 + 12) / (13 / 3 + 12) * 9.81
    exact = solve_ivp(lambda t, z: [z[1], -ratio * np.cos(z[0])], (0, 1), [np.pi / 2, -1], "DOP853", run.time,
                      rtol=1e-12, atol=1e-12).y[0]  # fmt: skip
    assert np.abs(run["first.phi"] - exact).max() < 1e-6
    assert all(np.abs(run[f"foot[{k}].phi"] - run["first.phi"]).max() < 1e-11 for k in range(1, 13))


def test_margin_is_that_of_one_window_however_many_there_are(monkeypatch):
    """The whole matrix comes nearer to dependence the more windows there are in a row; none of them does."""
    (_, _, few, _, margin, _), (_, _, many, _, of_many, _) = (looks(n, 1e-3, monkeypatch)[0][0] for n in (4, 24))
    assert rank_margin(many) < 0.3 * rank_margin(few)
    assert of_many == pytest.approx(margin, rel=0.2)


def test_an_interruption_within_a_step_leaves_the_memory_alone(monkeypatch):
    """What is asked about a place in between is interrupted: its margin is then no number, and nothing is computed."""
    see, judges = LocalPlaces.see, []

    def interrupted(self, place):
        judges[:] = [self._judge]
        if place in self._judge.places[2:]:
            raise KeyboardInterrupt
        see(self, place)

    monkeypatch.setattr(LocalPlaces, "see", interrupted)
    monkeypatch.setattr(LocalRows, "stays_regular", lambda *_: False)
    with pytest.raises(KeyboardInterrupt):
        lmoc.compile(WINDOWS, parameters={"N": 2}).simulate(stop=1e-3)
    (judge,) = judges
    assert np.isnan(judge.margin(judge.places[2]))


def angles_of_a_lift(n: int, times: np.ndarray) -> np.ndarray:
    """Angles of the bars: bar k has its middle at (cos q/2, (k - 1/2)·sin q), two of each."""
    heights = np.sum((np.arange(n) + 0.5) ** 2)

    def slope(t: float, z: np.ndarray) -> list[float]:
        sine, cosine = np.sin(z[0]), np.cos(z[0])
        inertia = 2 * (n / 12 + n / 4 * sine**2 + heights * cosine**2)
        change = 4 * (n / 4 - heights) * sine * cosine
        return [z[1], -(9.81 * n**2 * cosine + change * z[1] ** 2 / 2) / inertia]

    return solve_ivp(slope, (0, times[-1]), [0.5, 0], "DOP853", times, rtol=1e-12, atol=1e-12).y[0]


@pytest.mark.parametrize(("n", "stop", "singular"), [(7, 1.5, True), (30, 0.2, False)])
def test_lifts_of_many_stages(n, stop, singular, tmp_path):
    """Seven stages are flat after 0.7 s and upright after 1.24 s; the highest of thirty moves 30 times as fast."""
    (tmp_path / "lift.lmo").write_text(LIFT)
    run = lmoc.compile(tmp_path / "lift.lmo", parameters={"N": n}).simulate(stop=stop, points=31, rtol=1e-8)
    exact = angles_of_a_lift(n, run.time)
    assert np.abs(run["hinge.phi"] - exact).max() < 1e-7
    assert np.abs(run[f"up[{n}].y"] - (n - 1) * np.sin(exact)).max() < 1e-6
    assert len([note for note in run.notes if note.code == "N0633"]) == singular
    assert run.stats["steps"] < 100


def closed_chain(n: int) -> tuple[str, np.ndarray]:
    """A chain of n bars that hangs between two fixed points in an arc of half a circle: its text, and its angles."""
    directions = (np.arange(n) + 0.5) * np.pi / n - np.pi / 2
    span = float(np.cos(directions).sum()) / n
    starts = ", ".join(map(repr, directions.tolist()))
    turns = ", ".join(map(repr, np.diff(directions, prepend=0.0, append=0.0).tolist()))
    text = f"""
model Chain "Bars between two fixed points"
  import Planar.*;
  inner World world;
  Ground left, right(x = {span!r});
  Revolute pin[{n + 1}](phi(start = {{{turns}}}));
  Bar bar[{n}](each l = {1 / n!r}, each m = {1 / n!r}, theta(start = {{{starts}}}));
equation
  connect(left.frame, pin[1].a);
  for i in 1:{n} loop
    connect(pin[i].b, bar[i].a);
    connect(bar[i].b, pin[i + 1].a);
  end for;
  connect(pin[{n + 1}].b, right.frame);
end Chain;
"""
    return text, directions


def angles_of_a_closed_chain(start: np.ndarray, times: np.ndarray) -> np.ndarray:
    """Angles (times, n) by Lagrange's equations of all angles, with two multipliers at the closed end."""
    n = len(start)
    share = (np.tril(np.ones((n, n)), -1) + np.eye(n) / 2) / n  # of each bar's motion in the middle of another
    inertia = share.T @ share / n

    def slope(t: float, z: np.ndarray) -> np.ndarray:
        angle, rate = np.split(z, 2)
        apart, sine, cosine = angle[:, None] - angle, np.sin(angle), np.cos(angle)
        closing = np.stack([-sine, cosine]) / n
        mass = inertia * np.cos(apart) + np.eye(n) / 12 / n**3
        right = -9.81 * cosine * share.sum(axis=0) / n - inertia * np.sin(apart) @ rate**2
        whole = np.block([[mass, closing.T], [closing, np.zeros((2, 2))]])
        ends = np.stack([cosine, sine]) @ rate**2 / n
        return np.concatenate([rate, np.linalg.solve(whole, np.concatenate([right, ends]))[:n]])

    begin = np.concatenate([start, np.zeros(n)])
    return solve_ivp(slope, (0, times[-1]), begin, "DOP853", times, rtol=1e-10, atol=1e-10).y[:n].T


def test_a_long_closed_chain_is_judged_by_its_closure(monkeypatch):
    """Most rows of its one loop determine the next bar's end whatever the position; two close it."""
    text, directions = closed_chain(60)
    margins, look = [], LocalPlaces.see

    def recorded(self, place):
        look(self, place)
        margins.append((self.form.sizes, place.head[3]))

    monkeypatch.setattr(LocalPlaces, "see", recorded)
    dae = lmoc.compile_text(text)
    run = dae.simulate(stop=0.15, points=6, rtol=1e-8)
    assert len(dae.states) == 2 * 58
    exact = angles_of_a_closed_chain(directions, run.time)
    assert max(np.abs(run[f"bar[{k + 1}].theta"] - exact[:, k]).max() for k in range(60)) < 1e-7
    assert all(sizes == [2] and margin > 0.3 for sizes, margin in margins)
