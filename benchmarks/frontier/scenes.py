"""The scenes on which tools are compared: a model for lmoc, and the same equations by hand for the others."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from benchmarks import by_hand
from benchmarks.common import ROOT

POINTS = 501

PENDULUM = """
model Pendulum
  Real phi(start = 1.5, fixed = true), w(start = 0, fixed = true);
equation
  der(phi) = w;
  der(w) = -9.81*sin(phi);
  annotation(experiment(StopTime = 2000));
end Pendulum;
"""


@dataclass(frozen=True)
class Scene:
    """A scene: a file below `models` or a text, its equations by hand, and which states lmoc's signals are.

    Attributes
    ----------
    equations : returns the function ``(t, x) -> rate``, the start and the stop time
    signals : {variable of the model: state of the equations by hand}; the error is theirs
    exact : the signals (times, m) in closed form, where there is one
    """

    name: str
    model: str
    equations: Callable
    signals: dict[str, int]
    exact: Callable[[np.ndarray], np.ndarray] | None = None
    cache: dict = field(default_factory=dict, compare=False)

    def once(self, key: str, make: Callable[[], object]):
        if key not in self.cache:
            self.cache[key] = make()
        return self.cache[key]

    def hand(self):
        """Return the function ``(t, x) -> rate``, the start and the stop time."""
        return self.once("hand", self.equations)

    def dae(self):
        import lmoc

        text = "\n" in self.model
        return self.once(
            "dae", lambda: lmoc.compile_text(self.model) if text else lmoc.compile(ROOT / "models" / self.model)
        )

    def times(self) -> np.ndarray:
        return np.linspace(0, self.hand()[2], POINTS)

    def columns(self) -> list[int]:
        return list(self.signals.values())


def swing(times: np.ndarray) -> np.ndarray:
    """Angle and rate of the pendulum in Jacobi's functions: sin(phi/2) = k sn(K - w t)."""
    from scipy.special import ellipj, ellipk

    k, w = np.sin(0.75), np.sqrt(9.81)
    quarter = ellipk(k**2)
    sn, cn, _, _ = ellipj(np.remainder(quarter - w * times, 4 * quarter), k**2)
    return np.column_stack([2 * np.arcsin(k * sn), -2 * k * w * cn])


def deviation(values: np.ndarray, exact: np.ndarray) -> float:
    """Return the largest deviation of a signal, in units of its largest value."""
    return float((np.abs(values - exact).max(axis=0) / np.abs(exact).max(axis=0)).max())


_ANGLES = ("beta", "Theta", "gamma", "phi", "delta", "Omega", "epsilon")
SCENES = {
    scene.name: scene
    for scene in (
        Scene("pendulum, 2000 s", PENDULUM, by_hand.pendulum, {"phi": 0, "w": 1}, swing),
        Scene("Pleiades", "classic/pleiades.lmo", by_hand.pleiades,
              {f"{c}[{i + 1}]": 7 * k + i for k, c in enumerate("xy") for i in range(7)}),
        Scene("Andrews", "classic/andrews.lmo", by_hand.andrews, {a: k for k, a in enumerate(_ANGLES)}),
        Scene("car axis", "classic/car_axis.lmo", by_hand.car_axis, {"xl": 0, "yl": 1, "xr": 2, "yr": 3}),
        Scene("string of 100 masses", "hard/h14_plucked_string.lmo", by_hand.plucked_string,
              {"q1": 0, "q30": 29, "q50": 49, "q100": 99, "v30": 129, "v100": 199}),
        Scene("quarter car", "notes/ex05_suspension.lmo", by_hand.quarter_car,
              {"q1": 0, "q2": 1, "v_q1": 2, "v_q2": 3}),
        Scene("chain of 5 bars", "planar/chain.lmo", by_hand.chain_of_bars,
              {f"bar[{i + 1}].a.theta": i for i in range(5)}),
    )
}  # fmt: skip
