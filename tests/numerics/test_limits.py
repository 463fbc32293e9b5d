"""The shared numbers of numerics: what is half of each, and five times as much, is on two sides of it.

The numbers stand here by themselves, so that each test notices a factor of ten.
"""

import numpy as np
import pytest

import lmoc
from lmoc.numerics.coordinates.equilibration import Equilibration, equilibrated
from lmoc.numerics.laws.complementarity import FREE, UPPER
from lmoc.numerics.laws.cones import Friction, solve_with_cones
from lmoc.numerics.observe.recorder import _is_same

OSCILLATOR = """model Oscillator
  Real x(start = 1, fixed = true), v(start = 0, fixed = true);
equation
  der(x) = v; der(v) = -x;
end Oscillator;"""


@pytest.fixture(scope="module")
def oscillator():
    return lmoc.compile_text(OSCILLATOR)


@pytest.mark.parametrize("remainder, steps", [(5e-10, 10), (5e-9, 11)])
def test_a_remainder_before_the_end_is_a_step_of_its_own(oscillator, remainder, steps):
    """NO_STEP."""
    run = oscillator.simulate(stop=0.01 * (10 + remainder), solver="rk4", step=0.01, points=2)
    assert run.stats["steps"] == steps


def test_no_tolerance_is_finer_than_rounding(oscillator):
    """FINEST."""
    with pytest.raises(lmoc.ModelError, match="E0541"):
        oscillator.simulate(stop=1, rtol=5e-15)
    assert oscillator.simulate(stop=1, solver="dop853", rtol=2e-14)["x"][-1] == pytest.approx(np.cos(1), abs=1e-13)


@pytest.mark.parametrize("apart, same", [(5e-15, True), (5e-14, False), (-5e-15, False)])
def test_an_output_time_just_before_an_event_is_that_of_the_event(apart, same):
    """LOCATED."""
    assert _is_same(1.0 - apart, 1.0) is same


def test_what_rounding_leaves_of_a_zero_does_not_grow():
    """Rows and columns are equilibrated anew where an entry has grown; how large a rounding error is is chance."""
    own = Equilibration((1, 2), np.array([0, 0]), np.array([0, 1]), np.ones(2))
    for small, kept in ((1e-17, False), (1e-13, True), (1e-6, False)):
        before = own.scales
        own.grow(np.array([1.0, small]))
        assert (own.scales is not None) is kept and own.scales is (before if kept else None)
        own.factors()


@pytest.mark.parametrize("share, counts", [(5e-9, False), (5e-8, True)])
def test_entries_that_errors_have_left_do_not_count(share, counts):
    """no_entry: a column of them is none, and keeps the factor 1; no coordinate that could depend by it is chosen."""
    size = np.array([1.0, share, 1.0, share])
    _, columns, shares = equilibrated((2, 2), np.arange(4, dtype=np.int32), size, np.ones(2))
    assert bool(columns[1] != 1.0) is counts
    assert shares[1] == (share if counts else 1.0)


@pytest.mark.parametrize("first, bound", [("a + b - c", 1e-10), ("5e-11", 1e-10), ("2e-8", 1e-8)])
def test_no_coordinate_depends_by_what_errors_have_left(first, bound):
    """A body turns nearly across its first axis: Q[4] = 0 at half a turn, where Q[1] cannot take its place.

    It is 6e-17, 1e-11 or 4e-9 of the others.
    """
    run = lmoc.compile_text(f"""model Turn
      parameter Real a = 0.1, b = 0.2, c = 0.3;
      Real Q[4](start = {{0, 0, 0, 1}}), w[3] = {{{first}, 3, 4}};
    initial equation
      Q[1] = 0; Q[2] = 0; Q[3] = 0;
    equation
      w = 2*[Q[4], Q[3], -Q[2], -Q[1]; -Q[3], Q[4], Q[1], -Q[2]; Q[2], -Q[1], Q[4], -Q[3]]*der(Q);
      Q*Q = 1;
    end Turn;""").simulate(stop=4, points=50)
    half = 2.5 * run.time
    truth = [0 * half, 0.6 * np.sin(half), 0.8 * np.sin(half), np.cos(half)]
    assert np.abs([run[f"Q[{k}]"] for k in range(1, 5)] - np.array(truth)).max() < bound
    assert len(run.coordinates) > 1


@pytest.mark.parametrize("short, side", [(5e-10, UPPER), (5e-9, FREE)])
def test_a_friction_slides_at_its_limit(short, side):
    """AT_LIMIT: a slope that it holds with all of its force but that share."""
    push = 0.5 * (1.0 - short)
    friction = Friction(np.array([1]), np.array([0]), np.array([0.5]))
    found = solve_with_cones(np.eye(2), np.array([-1.0, -push]), np.zeros(2), np.full(2, np.inf), friction)
    assert found.x == pytest.approx([1.0, push], rel=1e-12) and found.side[1] == side
