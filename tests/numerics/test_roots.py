"""Roots within steps: all of them, in their order, located to the last digits of time."""

import numpy as np
import pytest

from lmoc.engine.roots import locate
from lmoc.numerics.problem.base import Integration
from lmoc.numerics.problem.roots import Roots
from lmoc.numerics.problem.status import Status
from lmoc.numerics.steps.roots import RootFinder

DIGITS = 1e-15  # of the time: how far a root may be off, where the function itself is exact


class Ruler(Integration):
    """An integration of x' = 1 from 0, whose steps end at given times and whose dense output is exact."""

    def __init__(self, ends) -> None:
        self.ends = list(ends)
        self.t = self.before = 0.0
        self.x = np.zeros(1)

    def step(self) -> Status:
        self.before, self.t = self.t, self.ends.pop(0)
        self.x = np.array([self.t])
        return Status.OK

    def interpolate(self, times):
        return np.array(times)[:, None]

    def jump(self, x) -> None:
        raise AssertionError("a ruler is not moved")


def roots_of(*functions, ends=(1.0,), signs=None, until=np.inf):
    """Return [(time, functions that vanish there)] of all roots, in the order in which they are reported."""
    found = []

    def reached(t, x, which, signs):
        assert x == pytest.approx([t])
        found.append((t, tuple(np.flatnonzero(which).tolist())))
        return t >= until

    def values(times, x):
        return np.stack([f(x[:, 0]) for f in functions], axis=1)

    run = Ruler(ends)
    known = np.zeros(len(functions)) if signs is None else np.array(signs, float)
    finder = RootFinder(Roots(values, known, reached), run.t, run.x)
    while run.ends:
        run.step()
        if finder.first(run, run.t) is not None:
            break
    return found


def assert_roots(found, expected, tolerance=DIGITS):
    assert [which for _, which in found] == [which for _, which in expected]
    np.testing.assert_allclose([t for t, _ in found], [t for t, _ in expected], rtol=tolerance, atol=0)


@pytest.mark.parametrize("length", [0.3, 1e-2, 1e-4, 1e-6])
def test_a_hop_is_seen_that_is_over_in_a_small_part_of_a_step(length):
    """It begins where the step does, and all samples behind it are as before it."""
    found = roots_of(lambda t: t * (length - t), signs=[-1])
    assert len(found) == 2 and found[0][0] < 1e-3 * length
    assert found[1][0] == pytest.approx(length, rel=1e-12)


def test_a_dip_between_samples_is_seen_wherever_it_is():
    """Also beside the ends of the step, where the samples are closer; with a third power of time in it."""
    for place in np.linspace(0.005, 0.995, 67).tolist():
        found = roots_of(lambda t, a=place: (t - a) ** 2 * (1 + 0.3 * t) - 4e-6, signs=[1])
        assert len(found) == 2, place
        assert [t for t, _ in found] == pytest.approx([place - 0.002, place + 0.002], abs=5e-4)


def test_all_roots_of_a_step_in_order():
    found = roots_of(lambda t: t - 0.2, lambda t: t - 0.7, lambda t: 0.5 - t, lambda t: np.cos(np.pi * t / 1.8))
    assert_roots(found, [(0.2, (0,)), (0.5, (2,)), (0.7, (1,)), (0.9, (3,))])


def test_roots_of_one_function_that_comes_back():
    assert_roots(roots_of(lambda t: (t - 0.3) * (t - 0.6)), [(0.3, (0,)), (0.6, (0,))])


def test_functions_that_vanish_together_are_one_root():
    assert_roots(roots_of(lambda t: t - 0.4, lambda t: 3 * (0.4 - t), lambda t: t - 0.6), [(0.4, (0, 1)), (0.6, (2,))])


@pytest.mark.parametrize("case", range(20))
def test_roots_of_cubics_a_quarter_of_a_step_apart(case):
    choose = np.random.default_rng(case)
    gaps = 0.25 + 0.05 * choose.random(3)
    places = (np.cumsum(gaps) - 0.2) * 0.99
    sign = choose.choice([-1.0, 1.0])
    found = roots_of(lambda t: sign * (t - places[0]) * (t - places[1]) * (t - places[2]))
    assert [which for _, which in found] == [(0,)] * 3
    np.testing.assert_allclose([t for t, _ in found], places, rtol=0, atol=DIGITS)  # of a step of length 1


def test_a_function_that_is_zero_at_the_start_has_no_root_there():
    assert roots_of(lambda t: t) == []
    assert roots_of(lambda t: -t) == []
    assert_roots(roots_of(lambda t: t * (0.5 - t)), [(0.5, (0,))])


def test_a_function_against_its_known_sign_has_a_root_at_once():
    assert_roots(roots_of(lambda t: t - 2.0, signs=[1]), [(0.0, (0,))])
    ((time, which),) = roots_of(lambda t: -t, signs=[1])
    assert which == (0,)
    assert 0 <= time < 1e-15


def test_a_triple_root_is_one_root():
    assert_roots(roots_of(lambda t: (t - 0.4) ** 3), [(0.4, (0,))])


def test_a_triple_root_in_rounding():
    """Multiplied out, the function is rounding within the cube root of it, 5e-6: the root is only known to that."""
    found = roots_of(lambda t: t**3 - 1.2 * t**2 + 0.48 * t - 0.064)
    assert len(found) % 2 == 1
    assert all(abs(t - 0.4) < 2e-5 for t, _ in found)


def test_a_double_root_is_none():
    assert roots_of(lambda t: (t - 0.4) ** 2) == []
    assert roots_of(lambda t: -((t - 0.4) ** 2)) == []


def test_a_short_dip_below_zero_has_two_roots():
    def function(t):
        return (t - 0.399) * (t - 0.401)

    assert_roots(roots_of(function), [(0.399, (0,)), (0.401, (0,))])


def test_a_root_at_the_end_of_a_step_is_found_once():
    assert_roots(roots_of(lambda t: t - 0.5, ends=(0.5, 1.0)), [(0.5, (0,))])
    assert_roots(roots_of(lambda t: np.where(t == 0.5, 0.0, t - 0.5), ends=(0.25, 0.5, 0.75)), [(0.5, (0,))])


def test_signs_are_known_from_step_to_step():
    found = roots_of(lambda t: np.sin(np.pi * t), ends=np.arange(0.4, 5.0, 0.4))
    assert_roots(found, [(k, (0,)) for k in range(1, 5)])


def test_an_oscillation_within_a_step_is_resolved():
    """A step may be long where the states are at rest: samples become closer until they follow the function.

    They stay as close after each root: five samples of the rest of the step would miss ten of these.
    """
    found = roots_of(lambda t: np.cos(20 * np.pi * t))
    assert_roots(found, [((k + 0.5) / 20, (0,)) for k in range(20)])


def test_the_first_accepted_root_ends_the_integration():
    found = roots_of(lambda t: t - 0.2, lambda t: t - 0.3, lambda t: t - 0.4, until=0.25)
    assert_roots(found, [(0.2, (0,)), (0.3, (1,))])


@pytest.mark.parametrize("power", [1, 3, 7, 15])
def test_a_crossing_is_located_from_above(power):
    """The end of the bracket at which the function is below zero: there its sign has changed."""

    def curve(t):
        return (0.7 - t) ** power

    t = locate(curve, 0.0, 1.0, curve(0.0), curve(1.0))
    assert curve(t) < 0
    assert 0.7 < t <= 0.7 * (1 + DIGITS)


@pytest.mark.parametrize("function", [np.cos, lambda t: 2.0 - np.exp(0.5 * t), lambda t: 1.0 / t - 0.6])
def test_a_smooth_crossing_takes_three_calls(function):
    calls = []

    def curve(t):
        calls.append(len(t))
        return function(t)

    t = locate(curve, 1.0, 2.0, function(1.0), function(2.0))
    assert function(t) <= 0 < function(t * (1 - DIGITS))
    assert len(calls) <= 3


def test_what_a_function_raises_within_a_step_is_raised():
    def function(t):
        if len(t) == 14:
            raise ZeroDivisionError
        return t - 0.3

    with pytest.raises(ZeroDivisionError):
        roots_of(function)


@pytest.mark.parametrize("solver", ["auto", "dop853", "taylor", "gauss", "cvode"])
def test_a_window_beside_the_end_of_a_long_step(solver):
    """A step of the Taylor series ends a little before the place where the function turns below zero."""
    import lmoc

    text = """model Turns
  Real q(start = 0, fixed = true), v(start = 1, fixed = true); Integer n(start = 0, fixed = true);
equation
  der(q) = v; der(v) = -q; when q < -0.999 then n = pre(n) + 1; end when;
end Turns;"""
    run = lmoc.compile_text(text).simulate(stop=20, points=2, rtol=1e-9, solver=solver)
    assert [e.time for e in run.events] == pytest.approx([np.pi * (2 * k + 1) + np.arcsin(0.999) for k in range(3)])


@pytest.mark.parametrize("rate", [200.0, 1003.0, 9001.0])
def test_a_function_that_oscillates_often_in_a_step_is_followed_in_parts_of_it(rate):
    found = roots_of(lambda t: np.sin(rate * t) - 0.5, signs=[-1.0])
    half = np.arange(2 * int(rate / np.pi) + 4)
    places = np.where(half % 2 == 0, half * np.pi + np.pi / 6, half * np.pi - np.pi / 6) / rate
    places = places[places < 1]
    np.testing.assert_allclose([t for t, _ in found], places, rtol=1e-12)


def test_a_jump_that_no_part_of_a_step_follows_is_located():
    found = roots_of(lambda t: np.where(t < 0.71234, 1.0, -1.0))
    assert_roots(found, [(0.71234, (0,))], 1e-14)


@pytest.mark.parametrize("ulps", [1, 3, 20, 900])
def test_a_step_of_a_few_units_of_the_last_digit_ends(ulps):
    """What a function does between them is rounding; where it has changed its sign at the end, it has crossed zero."""
    end = 1.0 + ulps * 2.0**-52
    assert roots_of(lambda t: 1.0 + 1e-3 * np.sin(1e20 * t), ends=(1.0, end), signs=[1.0]) == []
    found = roots_of(lambda t: np.where(t < end, 1.0, -1.0) + 1e-3 * np.sin(1e20 * t), ends=(1.0, end), signs=[1.0])
    assert_roots(found, [(end, (0,))])
