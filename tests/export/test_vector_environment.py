"""Scenes side by side as a vectorized environment: each has the bits that it has alone."""

from pathlib import Path

import numpy as np
import pytest

import lmoc
from lmoc.live.together import Together

gymnasium = pytest.importorskip("gymnasium")
CART = Path(__file__).parents[2] / "models" / "planar" / "cart_pole.lmo"
ASKED = {"actions": {"F": (-20, 20)}, "start": {"pin.phi": (1.4, 1.7), "rail.v": (-1, 1)}}
BALL = """model Ball
  Mass mass(m = 1, g = -9.81, q(start = 1, fixed = true), v(start = 0, fixed = true));
  Stop floor(L = 0, e = 0.8);
  Fixed ground;
  input Real u(unit = "N") = 0;
  Force force(f = u);
equation
  connect(force.flange, mass.flange);
  connect(floor.a, ground.flange);
  connect(floor.b, mass.flange);
end Ball;"""
ESCAPE = "model Escape input Real u = 0; Real x(start = 1, fixed = true); equation der(x) = x^2 + u; end Escape;"


@pytest.fixture(scope="module")
def cart():
    return lmoc.compile(CART)


def _alone(dae, seeds, given, **asked):
    """What single environments see, with episodes that begin anew where they are over."""
    rows = []
    for k, seed in enumerate(seeds):
        env = lmoc.Environment(dae, **asked)
        seen, _ = env.reset(seed=seed)
        row, over = [(seen, 0.0, False, False)], False
        for action in given[:, k]:
            if over:
                seen, _ = env.reset()
                row.append((seen, 0.0, False, False))
                over = False
            else:
                row.append(env.step(action)[:4])
                over = row[-1][2] or row[-1][3]
        rows.append(row)
    return [np.stack([np.asarray([step[i] for step in row]) for row in rows], 1) for i in range(4)]


@pytest.mark.parametrize("observed", [None, ("x", "phi", "pin.a.fx")])
def test_each_scene_has_the_bits_that_it_has_alone(cart, observed):
    asked = ASKED | {"observations": observed, "bounds": {"phi": (1.0, 2.1)}, "horizon": 0.5}
    actions = np.random.default_rng(5).uniform(-30, 30, (60, 3, 1))
    env = lmoc.VectorEnvironment(cart, 3, **asked)
    seen, info = env.reset(seed=11)
    assert info["time"].tolist() == [0, 0, 0]
    found = [(seen, np.zeros(3), np.zeros(3, bool), np.zeros(3, bool))]
    found += [env.step(action)[:4] for action in actions]
    alone = _alone(cart, (11, 12, 13), actions, **asked)
    for own, other in zip(zip(*found, strict=True), alone, strict=True):
        assert np.array_equal(np.array(own), other)
    assert alone[2].any() and alone[3].any()  # some have left the bounds, some have come to the horizon


def test_episodes_begin_anew_at_once_or_by_reset(cart):
    asked = ASKED | {"horizon": 0.1}
    same, later = (lmoc.VectorEnvironment(cart, 2, **asked, autoreset_mode=m) for m in ("SameStep", "Disabled"))
    same.reset(seed=1)
    later.reset(seed=1)
    for _ in range(5):
        seen, _, _, truncated, info = same.step(np.zeros((2, 1)))
        last, _, _, other, _ = later.step(np.zeros((2, 1)))
    assert truncated.all() and other.all()
    assert np.array_equal(np.stack(info["final_obs"]), last) and info["time"].tolist() == [0, 0]
    assert info["final_info"]["time"].tolist() == pytest.approx([0.1, 0.1])
    with pytest.raises(gymnasium.error.ResetNeeded):
        later.step(np.zeros((2, 1)))
    again, _ = later.reset(options={"reset_mask": np.array([True, False])})
    assert np.array_equal(again[0], seen[0]) and np.array_equal(again[1], last[1])
    with pytest.raises(ValueError, match="reset_mask"):
        later.reset(options={"reset_mask": np.array([1, 0])})


def test_scenes_with_laws_go_on_one_by_one():
    dae, actions = lmoc.compile_text(BALL), np.random.default_rng(2).uniform(-3, 3, (12, 2, 1))
    asked = {"actions": {"u": (-2, 2)}, "start": {"mass.q": (0.5, 1.0)}, "step": 0.1, "horizon": 9}
    env = lmoc.VectorEnvironment(dae, 2, **asked)
    found = [env.reset(seed=3)[0], *(env.step(action)[0] for action in actions)]
    assert np.array_equal(np.array(found), _alone(dae, (3, 4), actions, **asked)[0])


def test_a_run_that_fails_ends_its_episode_alone():
    """x' = x² + u from 1 is infinite at t = 1 s, from 0.1 at t = 10 s."""
    env = lmoc.VectorEnvironment(lmoc.compile_text(ESCAPE), 2, {"u": (-1, 1)}, step=0.6, horizon=10)
    env.reset(seed=1)
    env.reset(options={"initial": {"x": 0.1}, "reset_mask": np.array([False, True])})
    env.step(np.zeros((2, 1)))
    seen, _, ended, _, info = env.step(np.zeros((2, 1)))
    assert ended.tolist() == [True, False] and info["_error"].tolist() == [True, False]
    assert "t = 1 s" in info["error"][0] and seen[1, 0] == pytest.approx(1 / (10 - 1.2), rel=1e-5)
    seen, _, ended, _, info = env.step(np.zeros((2, 1)))
    assert not ended.any() and seen[0, 0] == 1.0 and seen[1, 0] == pytest.approx(1 / (10 - 1.8), rel=1e-5)


def test_gymnasiums_wrappers_and_rewards_of_arrays(cart):
    env = lmoc.VectorEnvironment(cart, 4, **ASKED, horizon=0.1, reward=lambda v, ended: -(v["F"] ** 2) - 10 * ended)
    env = gymnasium.wrappers.vector.RecordEpisodeStatistics(env)
    env.reset(seed=0)
    for _ in range(5):
        action = env.action_space.sample()
        _, rewards, _, truncated, info = env.step(action)
        assert rewards == pytest.approx(-action[:, 0].astype(float) ** 2)
    assert truncated.all() and info["episode"]["l"].tolist() == [5] * 4


def test_a_scene_can_be_looked_at_and_changed_between_steps(cart):
    first = cart.live(inputs={"F": 1.0})
    scenes = Together([first, first.copy()], ("F",))
    scenes.advance(np.array([[1.0], [2.0]]), 0.1)
    alone = cart.live(inputs={"F": 1.0})
    alone.advance(0.1, {"F": 2.0})
    assert scenes[1]["pin.phi"] == alone["pin.phi"] and scenes[1].time == 0.1 and scenes[1].inputs["F"] == 2.0
    for live in (scenes[1], alone):
        live.set("pin.omega", 0.3)
    scenes.changed(1)
    scenes.advance(np.array([[1.0], [2.0]]), 0.1)
    alone.advance(0.1)
    assert scenes.values(("pin.phi", "phi"))[1].tolist() == [alone["pin.phi"], alone["phi"]]
    with pytest.raises(lmoc.ModelError, match="finite"):
        scenes.advance(np.array([[1.0], [np.nan]]), 0.1)


def test_a_live_scene_goes_back_to_where_it_was_made(cart):
    live = cart.live(inputs={"F": 1.0})
    live.advance(0.3)
    there, other = live.copy(), live.copy()
    for _ in range(2):
        there.advance(0.2, {"F": 5.0})
        first = there["pin.phi"]
        there.rewind()
        assert there.time == 0.3 and there["pin.phi"] == live["pin.phi"] and there.inputs["F"] == 1.0
    other.inputs["F"] = 5.0
    other.advance(0.2)
    assert other["pin.phi"] == first
