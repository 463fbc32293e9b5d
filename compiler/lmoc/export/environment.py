"""A scene as an environment of Gymnasium: for controllers that learn, or that are tried out in a loop."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import gymnasium
import numpy as np

from lmoc.export.episodes import Range, Scene, Task
from lmoc.live.scene import Live
from lmoc.messages.diagnostics import SimulationError


class Environment(gymnasium.Env):
    """A scene that is stepped by actions at its inputs.

    Parameters
    ----------
    dae : of `lmoc.compile`
    actions : {input: (low, high)}, the numbers that an action holds, in this order
    observations : names of variables that are seen; by default the states
    step : s, for which an action is held
    reward : of (values of the observations and actions, whether the episode has ended); 1 a step by default
    bounds : {variable: (low, high)}: the episode has ended where one is left, or where the model says `terminate`
    start : {state: (low, high)}: start values are drawn between these; others are those of the model
    horizon : s, after which an episode is cut off; the model's StopTime by default
    parameters, rtol : as in `DAE.simulate`

    Attributes
    ----------
    live : the scene as it stands; None before the first episode

    Notes
    -----
    The actions are clipped to their ranges. `step` returns what Gymnasium asks for: observation, reward, terminated,
    truncated, info; a run that fails ends the episode, and `info["error"]` says why. Many of them side by side are a
    `VectorEnvironment`.
    """

    metadata: dict[str, Any] = {"render_modes": ["svg"], "render_fps": 50}

    def __init__(
        self,
        dae: Scene,
        actions: Mapping[str, Range],
        observations: Sequence[str] | None = None,
        step: float = 0.02,
        reward: Callable[[dict[str, float], bool], float] | None = None,
        bounds: Mapping[str, Range] | None = None,
        start: Mapping[str, Range] | None = None,
        horizon: float | None = None,
        parameters: Mapping[str, float] | None = None,
        rtol: float | None = None,
        render_mode: str | None = None,
    ) -> None:
        self.dae, self.render_mode, self._reward = dae, render_mode, reward
        task = self._task = Task(dae, actions, observations, step, bounds, start, horizon, parameters, rtol)
        self.action_space, self.observation_space = task.action, task.observation
        self._ranges = list(zip(task.inputs, task.low.tolist(), task.high.tolist(), strict=True))
        self._limits = list(task.bounds.items())
        self.live: Live | None = None

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Begin an episode; `options` may have {"initial": {name: value}} in place of what is drawn."""
        super().reset(seed=seed)
        if self.live is None:
            self.live = self._task.scene()
        self._task.begin(self.live, self.np_random, (options or {}).get("initial", {}))
        return self.live.values(self._task.names), {"time": self.live.time}

    def step(self, action: Sequence[float] | np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Hold an action for one step."""
        live, task = self.live, self._task
        if live is None:
            raise gymnasium.error.ResetNeeded("call reset first")
        given = np.asarray(action, np.float64).reshape(-1).tolist()
        held = {  # numpy would take longer to clip a few numbers
            name: low if value < low else high if value > high else value
            for (name, low, high), value in zip(self._ranges, given, strict=True)
        }
        target = live.time + task.dt
        info: dict[str, Any] = {}
        try:
            live.advance(task.dt, held)
        except SimulationError as error:
            info["error"] = str(error)
        seen = live.values(task.names)
        ended = "error" in info or live.time < target - 1e-9 * task.dt or self._outside(live)
        reward = 1.0
        if self._reward is not None:
            reward = float(self._reward(dict(zip(task.names, seen.tolist(), strict=True)) | held, ended))
        info["time"] = live.time
        truncated = not ended and live.time >= task.horizon - 1e-9 * task.dt
        return seen, reward, ended, truncated, info

    def render(self) -> str | None:
        """Return the scene at its start as SVG, where `render_mode` is "svg"."""
        return self.dae.draw().svg if self.render_mode == "svg" else None

    def _outside(self, live: Live) -> bool:
        return any(not low <= live[name] <= high for name, (low, high) in self._limits)
