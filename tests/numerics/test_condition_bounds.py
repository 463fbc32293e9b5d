"""The judge of coordinates: what it sees is what numpy sees, and steps judged in C are those judged one by one."""

import numpy as np
import pytest
from oracles.models import compiled

from lmoc.numerics.coordinates.tableau import rank_margin
from lmoc.numerics.coordinates.watch import CoordinateWatch
from lmoc.numerics.steps import loop
from lmoc.numerics.steps.loop import Loop

SCENES = ["classic/andrews", "classic/car_axis", "planar/four_bar", "planar/slider_crank"]


@pytest.mark.parametrize("scene", SCENES)
def test_a_place_is_seen_as_by_numpy(scene, monkeypatch):
    """Its tableau, the sign of its determinant, and its smallest singular value with what that is not below."""
    judge, seen = CoordinateWatch.__call__, 0

    def compared(self, t, x):
        nonlocal seen
        found, place = judge(self, t, x), self.last
        rows, seen = self.constraints.rows, seen + 1
        dependent, states = place.matrix[:, :rows], place.matrix[:, rows:]
        truth = np.linalg.solve(dependent, states)[self.constraints.watched]
        assert place.sign == np.sign(np.linalg.det(dependent))
        np.testing.assert_allclose(place.table, truth, rtol=1e-8, atol=1e-10)
        exact = rank_margin(place.matrix * self.judge.row_factor[:, None] * self.judge.column_factor)
        assert place.head[2] <= exact * (1 + 1e-9) and self.judge.margin(place) == pytest.approx(exact, rel=1e-9)
        return found

    monkeypatch.setattr(CoordinateWatch, "__call__", compared)
    monkeypatch.setattr(CoordinateWatch, "enter", lambda *_: None)
    compiled(scene).simulate(rtol=1e-7)
    assert seen > 10


@pytest.mark.parametrize("solver", ["dop853", "taylor"])
@pytest.mark.parametrize("scene", [*SCENES, "planar/pendulum_cartesian"])
def test_steps_judged_in_c_are_those_judged_in_python(scene, solver, monkeypatch):
    dae = compiled(scene)
    walked, options = 0, {"points": 73, "rtol": 1e-7, "solver": solver}
    walk = Loop.walk

    def counted(*arguments):
        nonlocal walked
        walked += 1
        return walk(*arguments)

    monkeypatch.setattr(Loop, "walk", counted)
    run = dae.simulate(**options)
    assert walked
    monkeypatch.setattr(Loop, "walker", None)
    other = dae.simulate(**options)
    assert [held for _, held in run.coordinates] == [held for _, held in other.coordinates]
    np.testing.assert_allclose(run.end.x, other.end.x, rtol=1e-11)
    assert all(run.stats[count] == other.stats[count] for count in ("steps", "rejected"))
    if len({len(held) for _, held in run.coordinates}) == 1:  # in all coordinates, Python asks for rates where it lands
        assert run.stats["evaluations"] == other.stats["evaluations"]
    for name in dae.states:
        np.testing.assert_allclose(run[name], other[name], rtol=1e-11, atol=1e-11 * np.abs(other[name]).max())


@pytest.mark.parametrize(
    "options", [{"solver": "dop853"}, {"solver": "taylor"}, {"solver": "dop853", "formulation": "projected"}]
)
def test_output_for_which_there_is_no_room_in_a_batch_comes_with_the_next(options, monkeypatch):
    dae = compiled("planar/four_bar")
    whole = dae.simulate(stop=1, points=500, **options)
    monkeypatch.setattr(loop, "_BATCH", 40)  # numbers, so that a step has more output than that
    run = dae.simulate(stop=1, points=500, **options)
    assert np.array_equal(run.end.x, whole.end.x)
    for name in dae.states:
        np.testing.assert_allclose(run[name], whole[name], rtol=0, atol=1e-13 * np.abs(whole[name]).max())


@pytest.mark.parametrize("scene", SCENES)
def test_a_run_judged_in_c_is_the_one_whose_places_are_filled_in_python(scene, monkeypatch):
    dae = compiled(scene)
    run = dae.simulate(points=50, rtol=1e-7, solver="dop853")
    monkeypatch.setattr(CoordinateWatch, "_made_in_c", lambda *_: None)
    other = dae.simulate(points=50, rtol=1e-7, solver="dop853")
    assert run.coordinates == other.coordinates
    for name in dae.states:
        np.testing.assert_allclose(run[name], other[name], rtol=1e-6, atol=1e-6 * np.abs(other[name]).max())
