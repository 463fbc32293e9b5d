"""Newton's method for blocks: slow ways to a solution are followed to the end, ways to nowhere are given up."""

import numpy as np
import pytest

from lmoc.numerics.evaluate.newton import Newton, iterate


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
