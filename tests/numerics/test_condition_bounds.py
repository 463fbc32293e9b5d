"""Certificates of steps: bounds are on the safe side, and certified runs are those that are looked at in full."""

import numpy as np
import pytest
from conftest import ROOT

import lmoc
from lmoc.numerics.coordinates import watch
from lmoc.numerics.coordinates.tableau import rank_margin
from lmoc.numerics.steps import loop
from lmoc.numerics.steps.loop import Loop

SCENES = ["classic/andrews", "classic/car_axis", "planar/four_bar", "planar/slider_crank"]


def certified_looks(scene: str, monkeypatch) -> list[tuple]:
    """Run a scene; what has been seen at the end of each step whose bounds have been looked at."""
    seen: list[tuple] = []
    judge = watch.CoordinateWatch._is_certain

    def recorded(self, place):
        if self._bounds is not None:
            begin = self.accepted.matrix * self._sizes.factor
            seen.append((self._bounds, place, begin, self.constraints.watched, ~self.barred))
        return judge(self, place)

    monkeypatch.setattr(watch.CoordinateWatch, "_is_certain", recorded)
    monkeypatch.setattr(watch.CoordinateWatch, "enter", lambda *_: None)
    lmoc.compile(ROOT / f"models/{scene}.lmo").simulate(rtol=1e-7)
    return seen


@pytest.mark.parametrize("scene", SCENES)
def test_bounds_are_those_of_the_whole_matrix(scene, monkeypatch):
    seen = certified_looks(scene, monkeypatch)
    assert len(seen) > 10
    for (worst, sign, least, change, _, grown), place, begin, watched, counted in seen:
        exact, rows = rank_margin(place.scaled), len(place.matrix)
        assert 0.85 * exact <= least <= exact * (1 + 1e-9)
        assert change == pytest.approx(np.linalg.norm(place.scaled - begin), rel=1e-9, abs=1e-14)
        dependent, states = place.matrix[:, :rows], place.matrix[:, rows:]
        assert sign == np.sign(np.linalg.det(dependent))
        np.testing.assert_allclose(
            place.found.plain, np.linalg.solve(dependent, states)[watched], rtol=1e-8, atol=1e-10
        )
        assert worst == pytest.approx(place.found.worst(counted), rel=1e-9)
        assert grown <= 0


@pytest.mark.parametrize("solver", ["dop853", "taylor"])
@pytest.mark.parametrize("scene", [*SCENES, "planar/pendulum_cartesian"])
def test_steps_judged_in_c_are_those_judged_in_python(scene, solver, monkeypatch):
    dae = lmoc.compile(ROOT / f"models/{scene}.lmo")
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
    dae = lmoc.compile(ROOT / "models/planar/four_bar.lmo")
    whole = dae.simulate(stop=1, points=500, **options)
    monkeypatch.setattr(loop, "_BATCH", 40)  # numbers, so that a step has more output than that
    run = dae.simulate(stop=1, points=500, **options)
    assert np.array_equal(run.end.x, whole.end.x)
    for name in dae.states:
        np.testing.assert_allclose(run[name], whole[name], rtol=0, atol=1e-13 * np.abs(whole[name]).max())


@pytest.mark.parametrize("scene", SCENES)
def test_a_certified_run_is_the_one_that_is_looked_at_in_full(scene, monkeypatch):
    dae = lmoc.compile(ROOT / f"models/{scene}.lmo")
    run = dae.simulate(points=50, rtol=1e-7, solver="dop853")
    monkeypatch.setattr(watch, "parts_of", lambda *_: None)
    other = dae.simulate(points=50, rtol=1e-7, solver="dop853")
    assert run.coordinates == other.coordinates
    for name in dae.states:
        np.testing.assert_allclose(run[name], other[name], rtol=1e-6, atol=1e-6 * np.abs(other[name]).max())
