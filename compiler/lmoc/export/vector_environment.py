"""Many scenes side by side as a vectorized environment of Gymnasium."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from lmoc.export.episodes import Range, Scene, Task
from lmoc.live.together import Together

Values = dict[str, np.ndarray]


class VectorEnvironment(VectorEnv):
    """Copies of one scene, each in an episode of its own, which are stepped at once.

    Where the scene is smooth one call of the engine moves all of them; each has the bits that it has alone, as an
    `Environment` with a seed of its own.

    Parameters
    ----------
    dae, actions, observations, step, bounds, start, horizon, parameters, rtol : as of `Environment`
    count : of the scenes
    reward : of ({observation or action: (count,)}, (count,) whether the episodes have ended); 1 a step by default
    autoreset_mode : when an episode that is over begins anew: "NextStep" (what the action of the next step is, does not
        matter there), "SameStep" (the last observation is in `info["final_obs"]`) or "Disabled" (by `reset`)

    Notes
    -----
    `reset(seed=s)` gives the scenes the seeds s, s + 1, …; `options` may have {"initial": {name: value}} and, of type
    bool, {"reset_mask": (count,)}, the scenes that begin anew.
    """

    def __init__(
        self,
        dae: Scene,
        count: int,
        actions: Mapping[str, Range],
        observations: Sequence[str] | None = None,
        step: float = 0.02,
        reward: Callable[[Values, np.ndarray], np.ndarray] | None = None,
        bounds: Mapping[str, Range] | None = None,
        start: Mapping[str, Range] | None = None,
        horizon: float | None = None,
        parameters: Mapping[str, float] | None = None,
        rtol: float | None = None,
        autoreset_mode: str | AutoresetMode = AutoresetMode.NEXT_STEP,
    ) -> None:
        if count < 1:
            raise ValueError(f"{count!r} scenes are not possible")
        self.num_envs, self.autoreset_mode, self._reward = int(count), AutoresetMode(autoreset_mode), reward
        self.metadata = {"autoreset_mode": self.autoreset_mode, "render_modes": []}
        task = self._task = Task(dae, actions, observations, step, bounds, start, horizon, parameters, rtol)
        self.single_action_space, self.single_observation_space = task.action, task.observation
        self.action_space = batch_space(task.action, self.num_envs)
        self.observation_space = batch_space(task.observation, self.num_envs)
        first = task.scene()
        self._scenes = Together([first, *(first.copy() for _ in range(self.num_envs - 1))], task.inputs)
        self._random = [np.random.default_rng() for _ in range(self.num_envs)]
        self._over: np.ndarray | None = None  # (count,) episodes; None before the first ones
        self._bounded = tuple(task.bounds)
        self._least, self._most = np.array(list(task.bounds.values()), np.float64).reshape(-1, 2).T

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Begin episodes."""
        given = dict(options or {})
        every = np.ones(self.num_envs, bool)
        chosen = np.asarray(given.get("reset_mask", every))
        if chosen.shape != every.shape or chosen.dtype != bool:
            raise ValueError(f"reset_mask is an array of {self.num_envs} of type bool, not {given['reset_mask']!r}")
        self._sow(seed, chosen)
        self._begin(chosen, given.get("initial", {}))
        self._over = ~chosen if self._over is None else self._over & ~chosen
        return self._scenes.values(self._task.names), self._times(chosen)

    def step(
        self, actions: np.ndarray | Sequence[Sequence[float]]
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Hold actions (count, inputs) for one step."""
        if self._over is None or (self.autoreset_mode is AutoresetMode.DISABLED and self._over.any()):
            raise gymnasium.error.ResetNeeded("call reset first")
        task, scenes = self._task, self._scenes
        given = np.asarray(actions, np.float64).reshape(self.num_envs, len(task.inputs))
        held = np.minimum(np.maximum(given, task.low), task.high)
        begin = self._over if self._over.any() else None
        if begin is not None:
            self._begin(begin, {})
        targets = scenes.times + task.dt
        errors = scenes.advance(held, task.dt, begin)
        seen = scenes.values(task.names)
        ended = (scenes.times < targets - 1e-9 * task.dt) | self._outside()
        rewards = np.ones(self.num_envs)
        if self._reward is not None:
            values = dict(zip((*task.names, *task.inputs), (*seen.T, *held.T), strict=True))
            rewards = np.array(np.broadcast_to(self._reward(values, ended), ended.shape), np.float64)
        truncated = ~ended & (scenes.times >= task.horizon - 1e-9 * task.dt)
        if begin is not None:
            rewards[begin], ended[begin], truncated[begin] = 0, False, False
        infos = self._times(np.ones(self.num_envs, bool))
        for k, error in errors.items():
            infos = self._add_info(infos, {"error": str(error)}, k)
        self._over = ended | truncated
        if self.autoreset_mode is AutoresetMode.SAME_STEP and self._over.any():
            seen, infos = self._begin_at_once(seen, infos)
        return seen, rewards, ended, truncated, infos

    def _begin_at_once(self, seen: np.ndarray, infos: dict[str, Any]) -> tuple[np.ndarray, dict[str, Any]]:
        """Begin the episodes that are over, and show what they have come to beside."""
        over = self._over
        assert over is not None
        for k in np.flatnonzero(over).tolist():
            final = {name: infos[name][k] for name in infos if not name.startswith("_") and infos[f"_{name}"][k]}
            infos = self._add_info(infos, {"final_obs": seen[k].copy(), "final_info": final}, k)
        self._begin(over, {})
        self._over = np.zeros(self.num_envs, bool)
        return self._scenes.values(self._task.names), infos | self._times(np.ones(self.num_envs, bool))

    def _sow(self, seed: int | Sequence[int | None] | None, chosen: np.ndarray) -> None:
        """Give the scenes their random numbers."""
        seeds = [seed + k for k in range(self.num_envs)] if isinstance(seed, int) else seed
        if seeds is None:
            return
        if len(seeds) != self.num_envs:
            raise ValueError(f"{len(seeds)} seeds for {self.num_envs} scenes")
        for k in np.flatnonzero(chosen).tolist():
            if seeds[k] is not None:
                self._random[k], _ = gymnasium.utils.seeding.np_random(seeds[k])

    def _begin(self, chosen: np.ndarray, initial: Mapping[str, float]) -> None:
        for k in np.flatnonzero(chosen).tolist():
            self._task.begin(self._scenes[k], self._random[k], initial)
            self._scenes.changed(k)

    def _outside(self) -> np.ndarray:
        if not self._bounded:
            return np.zeros(self.num_envs, bool)
        found = self._scenes.values(self._bounded)
        inside = (self._least <= found) & (found <= self._most)
        return np.array([not row.all() for row in inside])

    def _times(self, chosen: np.ndarray) -> dict[str, Any]:
        return {"time": np.where(chosen, self._scenes.times, 0.0), "_time": chosen.copy()}
