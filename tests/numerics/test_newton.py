"""Newton's method for blocks: slow ways to a solution are followed to the end, ways to nowhere are given up."""

import numpy as np
import pytest

import lmoc
from lmoc.numerics.solve.newton import Newton, Retries, iterate, vanishes


def solved(f, slope, guess: float) -> tuple[float, int]:
    """The solution of one equation in one unknown, and how often it was evaluated."""
    at = [0.0]
    calls = []

    def residual(u: np.ndarray) -> np.ndarray:
        calls.append(1)
        at[0] = float(u[0, 0])
        with np.errstate(over="ignore"):
            return np.array([[f(at[0])]])

    found = Newton((1, 1)).solve(residual, lambda u: np.array([[[slope(float(u[0, 0]))]]]), np.array([[guess]]))
    return float(found[0, 0]), len(calls)


@pytest.mark.parametrize("guess", [-3.0, 1.0, 30.0])
def test_long_ways(guess):
    assert solved(lambda x: np.exp(x) - 2, np.exp, guess)[0] == pytest.approx(np.log(2), abs=1e-10)
    assert solved(lambda x: np.arctan(x - 5), lambda x: 1 / (1 + (x - 5) ** 2), guess)[0] == pytest.approx(5, abs=1e-8)


@pytest.mark.parametrize("power", [2, 3])
def test_multiple_roots(power):
    found, _ = solved(lambda x: (x - 1) ** power, lambda x: power * (x - 1) ** (power - 1), 4.0)
    assert found == pytest.approx(1, abs=1e-6)


@pytest.mark.parametrize("beyond", [1.0001, 1.5, 3.0])
def test_no_solution_is_soon_known(beyond):
    found, calls = solved(lambda x: np.sin(x) - beyond, np.cos, 0.2)
    assert np.isnan(found) and calls < 2000


def test_a_search_that_begins_far_behind_its_first_residual_is_not_given_up():
    """One step from beside the flat place of a cube leads far away; from there a third of the way is left each time."""
    u, good, _ = iterate(lambda u: 42 * u**3 - 3, lambda u: 126 * u[..., None] ** 2, np.array([[1e-4]]), 50)
    assert good.all() and u == pytest.approx(np.cbrt(3 / 42))


def counted(f, slope):
    """Newton's method for one equation in a parameter, as a function of the parameter, and the number of residuals."""
    newton, calls = Newton((1, 1)), [0]

    def at(p: float) -> float:
        place = [0.0]

        def residual(u):
            calls[0] += 1
            place[0] = u[0, 0]
            return f(u, p)

        return float(newton.solve(residual, lambda u: slope(u, p)[..., None], np.zeros((1, 1)))[0, 0])

    return at, calls


def test_a_flat_guess_is_left_to_both_sides():
    at, _ = counted(lambda u, p: u**3 - p, lambda u, p: 3 * u**2)
    assert at(8.0) == pytest.approx(2.0)


def test_solutions_beyond_a_fold_are_sought_ever_more_rarely():
    at, _ = counted(lambda u, p: u**2 - 1 + p, lambda u, p: 2 * u)  # flat at its guess
    assert np.isnan(at(0.75))  # ±0.5: both sides lead elsewhere
    at, calls = counted(lambda u, p: np.exp(u) - 3 * u - 2 + p, lambda u, p: np.exp(u) - 3)
    assert np.isfinite([at(p) for p in np.linspace(0, 2, 9)]).all()
    before = calls[0]
    assert np.isnan(at(2.4))
    first, before = calls[0] - before, calls[0]
    assert all(np.isnan(at(2.4 - k * 1e-3)) for k in range(40))
    assert calls[0] - before < 40 * 0.6 * first
    assert at(1.9) == pytest.approx(at(1.9 + 1e-12), rel=1e-6)  # and go on where there are some


@pytest.mark.parametrize("failed", range(1, 5))
def test_retries_become_rarer_until_one_succeeds(failed):
    retries, now = Retries(), 100
    for _ in range(failed):
        while not retries.due(now):
            now += 1
        retries.note(False, now)
    pause = next(k for k in range(10**6) if retries.due(now + k))
    assert pause == 25 * 4 ** (failed - 1)
    assert retries.due(0)  # where counting has begun anew
    retries.note(True, now)
    assert retries.due(now)


def test_what_has_overflowed_is_no_solution() -> None:
    """An exponential that overflows far below zero: infinity is not small beside infinity."""
    steep = np.array([[[np.inf]]])
    assert not vanishes(steep, np.array([[np.inf]]), np.array([[-250.0]])).any()
    run = lmoc.compile_text("""model M Real i(start = 0, fixed = true); Real v; equation 2e-3*der(i) = 10*sin(time) - v;
      i = smooth(1, if v < -100 then -0.1*exp(-(v + 100)/0.03) else 1e-3*v); end M;""").simulate(stop=1, points=11)
    assert run["v"] == pytest.approx(10 * np.sin(run.time), abs=1e-4)
