"""A scene as an environment of Gymnasium, and a regulator that holds a pole up."""

from pathlib import Path

import numpy as np
import pytest

import lmoc

gymnasium = pytest.importorskip("gymnasium")
CART = Path(__file__).parents[2] / "models" / "planar" / "cart_pole.lmo"


@pytest.fixture(scope="module")
def cart():
    return lmoc.compile(CART)


def test_gymnasiums_own_checks_pass(cart):
    from gymnasium.utils.env_checker import check_env

    env = lmoc.Environment(cart, {"F": (-20, 20)}, ("x", "phi"), start={"pin.phi": (1.4, 1.7)}, horizon=1)
    check_env(env, skip_render_check=True)


def test_a_regulator_balances_the_pole(cart):
    control = pytest.importorskip("control")
    up = next(e for e in cart.equilibria() if abs(e["pin.phi"] - np.pi / 2) < 1e-6)
    linear = cart.linearize(at=up)
    assert any(linear.eigenvalues.real > 1)  # it falls by itself
    system = linear.to_control()
    gain = control.lqr(system, np.eye(4), np.eye(1))[0]
    env = lmoc.Environment(cart, {"F": (-50, 50)}, linear.states, step=0.01, start={"pin.phi": (1.45, 1.7)}, horizon=10)
    rest = np.array([float(up.get(name, 0.0)) if name != "rail.s" else 0.0 for name in linear.states])
    seen, _ = env.reset(seed=3)
    assert abs(seen[linear.states.index("pin.phi")] - np.pi / 2) > 0.01
    ended = truncated = False
    while not (ended or truncated):
        seen, reward, ended, truncated, info = env.step(-gain @ (seen - rest))
        assert reward == 1.0
    assert not ended and info["time"] == pytest.approx(10)
    assert np.abs(seen - rest).max() < 1e-2


def test_episodes_end_where_bounds_are_left_and_are_repeatable(cart):
    env = lmoc.Environment(cart, {"F": (-20, 20)}, ("phi",), bounds={"phi": (1.2, 1.9)}, start={"pin.phi": (1.5, 1.6)})
    runs = []
    for _ in range(2):
        seen, _ = env.reset(seed=7)
        episode = [seen[0]]
        for _ in range(200):
            seen, _, ended, _, _ = env.step([0.0])
            episode.append(seen[0])
            if ended:
                break
        assert ended and not 1.2 <= episode[-1] <= 1.9 and 1.2 <= episode[-2] <= 1.9
        runs.append(episode)
    assert runs[0] == runs[1]


def test_terminate_ends_an_episode():
    text = """model Fall
      Mass mass(m = 1, g = -9.81, q(start = 1, fixed = true), v(start = 0, fixed = true));
      input Real u(unit = "N") = 0;
      Force force(f = u);
    equation
      connect(force.flange, mass.flange);
      when mass.q < 0 then
        terminate("it is down");
      end when;
    end Fall;"""
    env = lmoc.Environment(lmoc.compile_text(text), {"u": (-1, 1)}, ("mass.q",), step=0.1, horizon=10)
    env.reset(seed=1)
    ended, steps = False, 0
    while not ended:
        seen, _, ended, truncated, info = env.step([0.0])
        steps += 1
        assert not truncated and steps < 20
    assert info["time"] == pytest.approx(np.sqrt(2 / 9.81), rel=1e-5) and seen[0] == pytest.approx(0, abs=1e-6)


def test_a_step_before_a_start_is_refused(cart):
    with pytest.raises(gymnasium.error.ResetNeeded):
        lmoc.Environment(cart, {"F": (-1, 1)}).step([0.0])
    with pytest.raises(ValueError, match="not possible"):
        lmoc.Environment(cart, {"F": (-1, 1)}, step=0)


def test_a_run_that_fails_ends_the_episode_and_says_why():
    """x' = x² + u from 1 is infinite at t = 1 s."""
    text = "model Escape input Real u = 0; Real x(start = 1, fixed = true); equation der(x) = x^2 + u; end Escape;"
    env = lmoc.Environment(lmoc.compile_text(text), {"u": (-1, 1)}, step=0.6, horizon=10)
    env.reset(seed=1)
    assert env.step([0.0])[2:4] == (False, False)
    _, _, ended, truncated, info = env.step([0.0])
    assert ended and not truncated and "t = 1 s" in info["error"]
