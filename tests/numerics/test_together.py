"""Variables of mechanisms at all output times at once: the same as followed from one time to the next."""

import numpy as np
import pytest
from oracles.models import compiled

import lmoc
from lmoc.ir.flat import Kind
from lmoc.numerics.evaluate.observed import Observed
from lmoc.numerics.observe.slices import Slice
from lmoc.numerics.solve.together import Together


def one_by_one(self, base, signals, solved):
    """Nothing is found at many times at once."""

    def evaluate(times, states, guesses):
        return np.full((len(times), len(self.out)), np.nan), np.zeros(len(times), bool), guesses

    return evaluate


@pytest.mark.parametrize(
    ("scene", "points"),
    [
        *((f"classic/{name}", n) for name in ("andrews", "car_axis") for n in (3, 40)),
        *((f"planar/{name}", n) for name in ("four_bar", "slider_crank") for n in (3,)),
        ("planar/slider_crank", 400),
    ],
)
def test_variables_are_those_that_are_followed(scene, points, monkeypatch):
    dae = compiled(scene)
    variables = np.flatnonzero(dae.flat.kind >= Kind.INPUT)
    run = dae.simulate(points=points, rtol=1e-7)
    tried: list[float] = []
    fill = Together.fill

    def counted(self, w, times):
        good = fill(self, w, times)
        tried.append(good.mean())
        return good

    with monkeypatch.context() as patch:
        patch.setattr(Together, "fill", counted)
        found = run.values(variables)
    assert min(tried) > 0.9, "hardly any time is left to be followed"
    monkeypatch.setattr(Slice, "bind_together", one_by_one)
    np.testing.assert_allclose(found, run.values(variables), rtol=1e-9, atol=1e-9 * np.abs(np.nan_to_num(found)).max())


def test_guesses_that_lead_elsewhere_do_not_count():
    """cos(x) = u has two solutions in a turn: from a guess beside the other one, x is not what the motion has."""
    dae = lmoc.compile_text("model M Real u(start = 0.2, fixed = true), x(start = 1.3); equation der(u) = 0.1; "
                            "cos(x) + 0.05*x = u; end M;")  # fmt: skip
    run = dae.simulate(stop=1, points=11, rtol=1e-9)
    followed = run["x"]
    plan = run.trajectory.segments[0].observer.plan
    register = plan.reduced.register_of[dae.flat.find("x")]
    part = Slice(plan, register)
    evaluate = part.bind_together(run.trajectory.segments[0].observer.base, {})
    states = run.trajectory.segments[0].table
    values, good, solutions = evaluate(run.time, states, followed[:, None] + 0.02)
    assert good.all() and np.abs(values[:, 0] - followed).max() < 1e-12
    assert np.array_equal(solutions, values)
    _, good, _ = evaluate(run.time, states, np.full((11, 1), 0.02))
    assert not good.any()


@pytest.mark.parametrize("scene", ["classic/andrews", "planar/four_bar", "planar/pendulum_cartesian"])
def test_solutions_by_the_engine_are_those_of_numpy(scene, monkeypatch):
    run = compiled(scene).simulate(rtol=1e-8, points=101)
    variables, called = np.arange(len(run.flat.kind)), []
    solve = Observed.__call__

    def counted(*arguments):
        called.append(solve(*arguments))
        return called[-1]

    monkeypatch.setattr(Observed, "__call__", counted)
    in_c = [segment.observer(variables, segment.time, segment.table) for segment in run.trajectory.segments]
    assert called and not any(found is None for found in called)
    monkeypatch.setattr(Observed, "__call__", lambda *arguments: None)
    by_numpy = [segment.observer(variables, segment.time, segment.table) for segment in run.trajectory.segments]
    for one, other in zip(in_c, by_numpy, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-10, atol=1e-11 * np.nanmax(np.abs(other)))
