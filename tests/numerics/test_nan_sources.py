"""Where a value is lost, one of the risks of its shape is lost too."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import lmoc
from lmoc.expression.dag import function, if_, lift, rebuild, slot
from lmoc.expression.evaluate import evaluate
from lmoc.expression.functions import BINARY, LOGICAL, UNARY
from lmoc.ir.program import Apply
from lmoc.numerics.failures.nan_sources import nan_sources, risks

LEAVES = st.one_of(st.integers(0, 2).map(slot), st.sampled_from([-2.0, -1.0, 0.0, 0.5, 2.0, 3.0]).map(lift))


def grown(children):
    return st.one_of(
        st.tuples(st.sampled_from(sorted(UNARY - LOGICAL)), children).map(lambda c: rebuild(c[0], c[1:])),
        st.tuples(st.sampled_from(sorted(BINARY - LOGICAL)), children, children).map(lambda c: rebuild(c[0], c[1:])),
        st.tuples(children, children, children).map(lambda c: if_(function("lt", c[0], c[1]), c[1], c[2])),
    )


SHAPES = st.recursive(LEAVES, grown, max_leaves=8)
VALUES = st.lists(st.sampled_from([-3.0, -1.0, -0.5, 0.0, 0.5, 1.0, 2.0]), min_size=3, max_size=3)


def value_and_risks(shape, values):
    lost = [evaluate(risk, lambda k, _, c=c: np.float64(values[c[k]]), 0.0) for risk, c in risks(shape)]
    return evaluate(shape, lambda k, _: np.float64(values[k]), 0.0), lost


@given(SHAPES, VALUES)
def test_no_value_is_lost_without_a_risk(shape, values):
    value, lost = value_and_risks(shape, values)
    assert math.isfinite(value) or shape.is_const or not np.isfinite(lost).all()


# one shape for every way of losing a value, at arguments where it does: a random one may reach none of them
LOST = [
    (slot(0) / slot(1), (1.0, 0.0)),
    (function("sqrt", slot(0)), (-1.0, 0.0)),
    (function("log", slot(0)), (-1.0, 0.0)),
    (function("log10", slot(0)), (0.0, 0.0)),
    (function("asin", slot(0)), (2.0, 0.0)),
    (function("acos", slot(0)), (-2.0, 0.0)),
    (function("pow", slot(0), slot(1)), (-1.0, 0.5)),
    (function("mod", slot(0), slot(1)), (1.0, 0.0)),
    (function("rem", slot(0), slot(1)), (1.0, 0.0)),
    (function("div_integer", slot(0), slot(1)), (1.0, 0.0)),
    (function("sin", slot(0) / slot(1)) * 2.0 + slot(0), (1.0, 0.0)),
]


@pytest.mark.parametrize("shape, values", LOST, ids=lambda v: repr(v) if not isinstance(v, tuple) else "")
def test_every_way_of_losing_a_value_is_a_risk(shape, values):
    value, lost = value_and_risks(shape, values)
    assert not math.isfinite(value) and not np.isfinite(lost).all()


def test_sums_and_products_need_no_look():
    assert risks(slot(0) * slot(1) - slot(2) ** 2 + function("sin", slot(0)) / 4.0) == ()


def test_a_quotient_is_judged_by_its_divisor_alone():
    ((risk, columns),) = risks(slot(0) / slot(1))
    assert columns == [1]
    assert evaluate(risk, lambda k, _: np.float64(0.0)) == pytest.approx(np.inf)


def test_only_what_the_risks_read_is_computed():
    inertia = Apply(slot(0) / slot(1), np.array([[2, 1]]), np.array([3]))
    force = Apply(slot(0) * slot(1), np.array([[0, 1]]), np.array([2]))
    steps, watched, count = nan_sources((force, inertia), 4)
    assert len(steps) == 1 and watched.tolist() == [4] and count == 5


def test_nonlinear_equations_beside_the_motion_that_lose_their_solution_are_told():
    """y² = 1 - t has one up to t = 1; whoever asks for y later gets NaN, and the run says so."""
    dae = lmoc.compile_text("model M Real x(start=1, fixed=true), y(start=1); equation der(x) = -1; y^2 = x; end M;")
    run = dae.simulate(stop=3, points=31)
    (said,) = run.notes
    assert said.code == "W0537" and "for y have no solution" in said.message and said.span is not None
    assert run["y"][run.time < 0.99] == pytest.approx(np.sqrt(1 - run.time[run.time < 0.99]))
    assert np.isnan(run["y"][run.time > 1.01]).all()
    assert not dae.simulate(stop=0.9).notes
    assert [n.code for n in dae.simulate(stop=3, points=31, keep=["x"]).notes] == ["W0537"]


def test_a_solution_that_comes_back_is_found_again(monkeypatch):
    """Without one, all ways are tried again only now and then, but a solution nearby is always seen."""
    from lmoc.numerics.solve.newton import Newton

    searches = []
    patient = Newton.solve
    monkeypatch.setattr(Newton, "solve", lambda self, *a: searches.append(self.patient) or patient(self, *a))
    text = "model M Real x(start=0, fixed=true), y(start=1); equation der(x) = cos(time); y^2 = 0.8 - x; end M;"
    run = lmoc.compile_text(text).simulate(stop=4, points=41)
    searches.clear()
    y, exact = run["y"], 0.8 - run["x"]
    there = exact > 0.05
    assert np.abs(y[there]) == pytest.approx(np.sqrt(exact[there]), rel=1e-6)
    assert np.isnan(y[exact < -0.01]).all() and sum(searches) < 0.2 * len(run.time)
