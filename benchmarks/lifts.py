"""Scissor lifts of N stages, and columns of N tensegrities: what a scene costs over its size.

    python -m benchmarks.lifts [--stages 10,20,40,100] [--cells 10,40,160]

Seconds of the processor, of one thread, to compile, for a first and for a warm run at rtol 1e-8. A lift has N closed
loops and one degree of freedom; its error is that of the foot against the equation of one angle. A column has 2N free
bars that springs hold, and nothing to compare with but its energy.
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Callable

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np  # noqa: E402

from benchmarks.common import save, table  # noqa: E402

_ANGLE, _CARRIED, _STOP = 0.5, 0.5, 1.0  # rad at the start, share of the weight that the cylinder carries there, s

LIFT = f"""model Lift
  import Planar.*;
  parameter Integer n = 2;
  parameter Real force = 0;
  inner World world; Ground ground;
  Bar a[n](each l = 1, each m = 1, each theta(start = {_ANGLE}));
  Bar b[n](each l = 1, each m = 1, each theta(start = {np.pi - _ANGLE}));
  Link ca[n](each rx = 0.5, each ry = 0), cb[n](each rx = 0.5, each ry = 0);
  Revolute middle[n], hinge, foot, left[n - 1], right[n - 1];
  Prismatic slide(useFlange = true, s(start = {np.cos(_ANGLE)}, fixed = true), v(start = 0, fixed = true));
  .Force push(f = force);
equation
  connect(ground.frame, hinge.a); connect(hinge.b, a[1].a);
  connect(ground.frame, slide.a); connect(slide.b, foot.a); connect(foot.b, b[1].a);
  connect(push.flange, slide.flange);
  for i in 1:n loop
    connect(a[i].a, ca[i].a); connect(ca[i].b, middle[i].a);
    connect(b[i].a, cb[i].a); connect(cb[i].b, middle[i].b);
  end for;
  for i in 1:n - 1 loop
    connect(a[i].b, right[i].a); connect(right[i].b, b[i + 1].a);
    connect(b[i].b, left[i].a); connect(left[i].b, a[i + 1].a);
  end for;
end Lift;
"""

COLUMN = """model Column
  import Planar.*;
  parameter Integer n = 2;
  inner World world; Anchor p(x = 0, y = 0), q(x = 1, y = 0);
  Bar s[n](each l = 1.5, each m = 1, x(start = zeros(n)), y(start = {0.9*i - 0.8 for i in 1:n}),
    each theta(start = 0.85));
  Bar t[n](each l = 1.5, each m = 1, x(start = ones(n)), y(start = {0.9*i - 0.8 for i in 1:n}),
    each theta(start = 2.29));
  PointOf ps[n], qs[n](each rx = 1.5), pt[n], qt[n](each rx = 1.5);
  SpringDamper v[2*n](each k = 500, each c = 5, each d0 = 0.3), w[2*n](each k = 500, each c = 5, each d0 = 0.8);
  SpringDamper h[2*n](each k = 500, each c = 5, each d0 = 0.6);
equation
  for i in 1:n loop
    connect(s[i].a, ps[i].frame); connect(s[i].a, qs[i].frame);
    connect(t[i].a, pt[i].frame); connect(t[i].a, qt[i].frame);
    connect(ps[i].point, h[2*i - 1].a); connect(pt[i].point, h[2*i - 1].b);
    connect(qs[i].point, h[2*i].a); connect(qt[i].point, h[2*i].b);
    connect(ps[i].point, w[2*i - 1].a); connect(qt[i].point, w[2*i - 1].b);
    connect(pt[i].point, w[2*i].a); connect(qs[i].point, w[2*i].b);
  end for;
  connect(p.point, v[1].a); connect(ps[1].point, v[1].b);
  connect(q.point, v[2].a); connect(pt[1].point, v[2].b);
  for i in 2:n loop
    connect(qt[i - 1].point, v[2*i - 1].a); connect(ps[i].point, v[2*i - 1].b);
    connect(qs[i - 1].point, v[2*i].a); connect(pt[i].point, v[2*i].b);
  end for;
end Column;
"""


def force_of(n: int) -> float:
    """Return what the cylinder pushes with."""
    return float(-_CARRIED * 9.81 * n * n / np.tan(_ANGLE))


def foot(n: int, times: np.ndarray) -> np.ndarray:
    """Return where the foot is, from the angle of the bars."""
    from scipy.integrate import solve_ivp

    heights = ((np.arange(n) + 0.5) ** 2).sum()

    def slope(t: float, z: np.ndarray) -> list[float]:
        sine, cosine = np.sin(z[0]), np.cos(z[0])
        inertia = n * sine * sine / 2 + 2 * heights * cosine * cosine + n / 6
        change = (n - 4 * heights) * sine * cosine  # of the inertia with the angle
        moment = -9.81 * n * n * cosine - force_of(n) * sine
        return [z[1], (moment - change * z[1] ** 2 / 2) / inertia]

    done = solve_ivp(slope, (0, times[-1]), [_ANGLE, 0], "DOP853", times, rtol=1e-13, atol=1e-13)
    return np.cos(done.y[0])


def one_size(text: str, n: int, values: dict[str, float], error: Callable) -> dict[str, float]:
    """Return what a scene of a size costs."""
    import lmoc

    begin = time.process_time()
    dae = lmoc.compile_text(text, parameters={"n": n, **values})
    dae.prepare()
    found, run = {"size": n, "compile": time.process_time() - begin}, None
    for name in ("first", "warm"):
        begin = time.process_time()
        run = dae.simulate(stop=_STOP, rtol=1e-8)
        found[name] = time.process_time() - begin
    whole = found["compile"] + found["first"]
    return found | {"ms a piece": 1e3 * whole / n, "steps": run.stats["steps"], "error": error(run)}


def main() -> None:
    """Print both tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--stages", default="10,20,40,100")
    parser.add_argument("--cells", default="10,40,160")
    arguments = parser.parse_args()
    one_size(LIFT, 2, {}, lambda run: 0.0)  # what Python imports is no stage's
    lifts = [
        one_size(LIFT, n, {"force": force_of(n)}, lambda run, n=n: np.abs(run["slide.s"] - foot(n, run.time)).max())
        for n in map(int, arguments.stages.split(","))
    ]
    columns = [one_size(COLUMN, n, {}, lambda run: run.energy.balance) for n in map(int, arguments.cells.split(","))]
    for name, own in (("scissor lifts, error of the foot", lifts), ("tensegrities, error of the energy", columns)):
        table(f"{name}: seconds of the processor", list(own[0]), [list(f.values()) for f in own])
    save("lifts", [*lifts, *columns])


if __name__ == "__main__":
    main()
