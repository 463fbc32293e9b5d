"""What is asked of a scene in an episode, for one environment or many: actions, starts, and where it ends."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, Protocol

import gymnasium
import numpy as np

from lmoc.ir.flat import FlatDAE
from lmoc.live.scene import Live
from lmoc.view.drawing import Drawing

Range = tuple[float, float]


class Scene(Protocol):
    """The scene that is stepped: a `DAE`."""

    flat: FlatDAE
    states: list[str]

    def live(self, *, inputs: Mapping[str, float], **options: Any) -> Live: ...

    def draw(self) -> Drawing: ...


class Task:
    """What is asked of a scene.

    Attributes
    ----------
    dt : s, for which an action is held
    inputs, low, high : names of inputs, and the ranges of the numbers that an action holds
    names : of the observations
    bounds : {variable: (low, high)}
    horizon : s
    action, observation : spaces
    """

    def __init__(
        self,
        dae: Scene,
        actions: Mapping[str, Range],
        observations: Sequence[str] | None,
        step: float,
        bounds: Mapping[str, Range] | None,
        start: Mapping[str, Range] | None,
        horizon: float | None,
        parameters: Mapping[str, float] | None,
        rtol: float | None,
    ) -> None:
        if not 0 < step < math.inf:
            raise ValueError(f"a step of {step!r} s is not possible")
        self.dt, self.inputs = float(step), tuple(actions)
        self.names = tuple(dae.states if observations is None else observations)
        self.bounds, self._drawn = dict(bounds or {}), dict(start or {})
        given = dae.flat.experiment.stop if horizon is None else horizon
        self.horizon = math.inf if given is None else float(given)
        self.low, self.high = np.array([actions[n] for n in self.inputs], np.float64).reshape(-1, 2).T
        self.action = gymnasium.spaces.Box(self.low.astype(np.float32), self.high.astype(np.float32))
        self.observation = gymnasium.spaces.Box(-np.inf, np.inf, (len(self.names),), np.float64)
        self._dae, self._options = dae, {"parameters": parameters, "rtol": rtol}

    def scene(self) -> Live:
        """Return the scene at its start, with the actions nearest to zero."""
        rest = np.clip(0.0, self.low, self.high).tolist()
        return self._dae.live(inputs=dict(zip(self.inputs, rest, strict=True)), **self._options)

    def begin(self, live: Live, random: np.random.Generator, initial: Mapping[str, float]) -> None:
        """Begin an episode of a scene; `initial` is in place of what is drawn."""
        live.rewind()
        drawn = {name: float(random.uniform(*ends)) for name, ends in self._drawn.items()}
        for name, value in (drawn | dict(initial)).items():
            live.set(name, value)
