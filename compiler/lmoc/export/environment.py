"""A scene as an environment of Gymnasium: for controllers that learn, or that are tried out in a loop."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Protocol

import gymnasium
import numpy as np

from lmoc.ir.flat import FlatDAE
from lmoc.live import Live
from lmoc.messages.diagnostics import SimulationError
from lmoc.view.drawing import Drawing

Range = tuple[float, float]
Values = Mapping[str, float]


class Scene(Protocol):
    """The scene that is stepped: a `DAE`."""

    flat: FlatDAE
    states: list[str]

    def live(self, *, inputs: Values, **options: Any) -> Live: ...

    def draw(self) -> Drawing: ...


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

    Notes
    -----
    The actions are clipped to their ranges. `step` returns what Gymnasium asks for: observation, reward, terminated,
    truncated, info; a run that fails ends the episode, and `info["error"]` says why.
    """

    metadata: dict[str, Any] = {"render_modes": ["svg"], "render_fps": 50}

    def __init__(
        self,
        dae: Scene,
        actions: Mapping[str, Range],
        observations: Sequence[str] | None = None,
        step: float = 0.02,
        reward: Callable[[Values, bool], float] | None = None,
        bounds: Mapping[str, Range] | None = None,
        start: Mapping[str, Range] | None = None,
        horizon: float | None = None,
        parameters: Mapping[str, float] | None = None,
        rtol: float | None = None,
        render_mode: str | None = None,
    ) -> None:
        if not 0 < step < math.inf:
            raise ValueError(f"a step of {step!r} s is not possible")
        self.dae, self.dt, self.render_mode = dae, float(step), render_mode
        self.inputs, self.names = tuple(actions), tuple(dae.states if observations is None else observations)
        self.bounds, self._drawn = dict(bounds or {}), dict(start or {})
        self._reward = reward
        given = dae.flat.experiment.stop if horizon is None else horizon
        self.horizon = math.inf if given is None else float(given)
        self._parameters, self._rtol = parameters, rtol
        low, high = np.array([actions[n] for n in self.inputs], np.float64).reshape(-1, 2).T
        self.action_space = gymnasium.spaces.Box(low.astype(np.float32), high.astype(np.float32))
        shape = (len(self.names),)
        self.observation_space = gymnasium.spaces.Box(-np.inf, np.inf, shape, np.float64)
        self._ranges = list(zip(self.inputs, low.tolist(), high.tolist(), strict=True))
        self._limits = list(self.bounds.items())
        self._first: Live | None = None
        self.live: Live | None = None

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Begin an episode; `options` may have {"initial": {name: value}} in place of what is drawn."""
        super().reset(seed=seed)
        drawn = {name: float(self.np_random.uniform(*ends)) for name, ends in self._drawn.items()}
        drawn |= (options or {}).get("initial", {})
        if self._first is None:
            start = {name: min(max(0.0, low), high) for name, low, high in self._ranges}
            self._first = self.dae.live(inputs=start, parameters=self._parameters, rtol=self._rtol)
        self.live = self._first.copy()
        for name, value in drawn.items():
            self.live.set(name, value)
        return self.live.values(self.names), {"time": self.live.time}

    def step(self, action: Sequence[float] | np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Hold an action for one step."""
        live = self.live
        if live is None:
            raise gymnasium.error.ResetNeeded("call reset first")
        given = np.asarray(action, np.float64).reshape(-1).tolist()
        held = {  # numpy would take longer to clip a few numbers
            name: low if value < low else high if value > high else value
            for (name, low, high), value in zip(self._ranges, given, strict=True)
        }
        for name, value in held.items():
            live.inputs[name] = value
        target = live.time + self.dt
        info: dict[str, Any] = {}
        try:
            live.advance(self.dt)
        except SimulationError as error:
            info["error"] = str(error)
        seen = live.values(self.names)
        ended = "error" in info or live.time < target - 1e-9 * self.dt or self._outside(live)
        reward = 1.0 if self._reward is None else float(self._reward(self._values(seen, held), ended))
        info["time"] = live.time
        truncated = not ended and live.time >= self.horizon - 1e-9 * self.dt
        return seen, reward, ended, truncated, info

    def render(self) -> str | None:
        """Return the scene at its start as SVG, where `render_mode` is "svg"."""
        return self.dae.draw().svg if self.render_mode == "svg" else None

    def _values(self, seen: np.ndarray, held: Values) -> dict[str, float]:
        return dict(zip(self.names, seen.tolist(), strict=True)) | dict(held)

    def _outside(self, live: Live) -> bool:
        return any(not low <= live[name] <= high for name, (low, high) in self._limits)
