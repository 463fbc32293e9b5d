"""The processor time of laws: an event against a restart of the bare integrator, a stop against springs, and steps.

    python -m benchmarks.laws [events] [springs] [steps]          all three without arguments; tables in docs/laws.md
"""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable

import numpy as np

import lmoc
from benchmarks.common import table

BALL = """model Ball "a ball that bounces without loss, on a stop or on a spring"
  parameter Real k = 0 "stiffness of the spring";
  Fixed floor;
  Mass ball(m = 1, g = -9.81, q(start = 1, fixed = true), v(start = 0, fixed = true));
  PART
equation
  connect(floor.flange, stop.b);
  connect(stop.a, ball.flange);
end Ball;"""
ON_STOP = BALL.replace("PART", "Cable stop(L = 0, e = 1) \"floor.q ≤ ball.q\";")
ON_SPRING = BALL.replace("PART", "ElasticCable stop(k = k, d0 = 0);")
PILE = """model Pile "masses dropped onto each other and a floor"
  parameter Integer N = 10;
  Fixed floor; Mass m[N](each m = 1, each g = -9.81); Stop s[N](each L = 0.1);
equation
  connect(floor.flange, s[1].a); connect(s[1].b, m[1].flange);
  for i in 2:N loop connect(m[i-1].flange, s[i].a); connect(s[i].b, m[i].flange); end for;
initial equation
  for i in 1:N loop m[i].q = 0.15*i; m[i].v = 0; end for;
end Pile;"""
GRAVITY, HEIGHT = 9.81, 1.0
FALL = math.sqrt(2 * HEIGHT / GRAVITY)  # s, until the ball arrives …
SPEED = GRAVITY * FALL  # … with this velocity


def best(function: Callable[[], object], repeat: int) -> float:
    """Return the shortest processor time of a few calls, s."""
    times = []
    for _ in range(repeat):
        begin = time.process_time()
        function()
        times.append(time.process_time() - begin)
    return min(times)


def height(t: float) -> float:
    """Return where the ball on the stop is."""
    since = (t + FALL) % (2 * FALL) - FALL
    return HEIGHT - GRAVITY * since**2 / 2


def events() -> list[tuple[str, float, float]]:
    """Return (what, µs an event, in restarts of the bare integrator)."""
    dae, spans = lmoc.compile_text(ON_STOP), (20.5 * 2 * FALL, 120.5 * 2 * FALL)
    few, many = (best(lambda stop=stop: dae.simulate(stop=stop, points=2, energy=False), 7) for stop in spans)
    event, restart, scipy = (many - few) / 100, _restart(dae), _by_hand()
    rows = [("restart of the bare DOP853", restart), ("event of a law", event), ("event in SciPy, by hand", scipy)]
    return [(what, seconds * 1e6, seconds / restart) for what, seconds in rows]


def _restart(dae: lmoc.DAE) -> float:
    """Return the seconds that lmoc's DOP853 takes to begin and to make one flight, without laws."""
    from lmoc.messages.diagnostics import Report
    from lmoc.numerics.laws.switching import all_open
    from lmoc.numerics.problem.base import Problem
    from lmoc.numerics.run.simulate import Simulator
    from lmoc.numerics.signals.signals import bind_signals
    from lmoc.numerics.steps import dop853, loop

    reduced, report = dae.prepare().reduced, Report()
    signals = {**bind_signals(reduced.flat, None, report), **all_open(reduced.switched)}
    plan, system = Simulator(reduced).system(signals, False, report)
    system.prepare(plan.base(reduced.values, signals), signals)
    x, none = np.array([0.0, SPEED]), np.zeros(0)

    def flights() -> None:
        for _ in range(100):
            problem = Problem(system, 0.0, x, 2 * FALL, none, 1e-6, np.full(2, 1e-9), lambda first, states: None)
            loop.integrate(problem, dop853.begin(problem))

    return best(flights, 7) / 100


def _by_hand() -> float:
    """Return the seconds that an event takes with SciPy's DOP853 and a loop of restarts."""
    from scipy.integrate import solve_ivp

    def floor(t, y):
        return y[0]

    floor.terminal, floor.direction = True, -1

    def bounces() -> None:
        x = [HEIGHT, 0.0]
        for _ in range(50):
            found = solve_ivp(lambda t, y: [y[1], -GRAVITY], (0, 9), x, method="DOP853", rtol=1e-6, events=floor)
            x = [0.0, -found.y_events[0][0][1]]

    return best(bounces, 5) / 50


def springs(stiffnesses=tuple(10.0**n for n in range(3, 10))) -> list[tuple[str, float, float, float, int]]:
    """Return (what, error of the height at 2 s, that of theory, ms, evaluations)."""
    stop, spring = lmoc.compile_text(ON_STOP), lmoc.compile_text(ON_SPRING)
    rows = [_row("the law", stop, 0.0, {})]
    for k in stiffnesses:
        lost = 2 * math.pi * math.sqrt(1.0 / k)  # s, in two contacts of half a period each, to first order
        rows.append(_row(f"k = {k:.0e} N/m", spring, abs(height(2.0 - lost) - height(2.0)), {"k": k}))
    return rows


def _row(what: str, dae: lmoc.DAE, theory: float, parameters: dict) -> tuple[str, float, float, float, int]:
    def run():
        return dae.simulate(stop=2, points=2, rtol=1e-8, parameters=parameters)

    found = run()
    error = abs(float(found["ball.q"][-1]) - height(2.0))
    return what, error, theory, best(run, 5) * 1e3, int(found.stats["evaluations"])


def steps(counts=(5, 10, 20)) -> list[tuple[int, int, float, float, float]]:
    """Return (masses, events, ms from event to event, ms in 1000 steps, their difference at the end in m)."""
    rows, dae = [], lmoc.compile_text(PILE)
    for n in counts:
        own = {"stop": 1.0, "points": 2, "parameters": {"N": n}}
        exact, moreau = dae.simulate(**own), dae.simulate(**own, solver="moreau", step=1e-3)
        off = max(abs(float(exact[f"m[{i}].q"][-1] - moreau[f"m[{i}].q"][-1])) for i in range(1, n + 1))
        ways: tuple[dict, ...] = ({}, {"solver": "moreau", "step": 1e-3})
        seconds = [best(lambda more=more, own=own: dae.simulate(**own, **more), 3) for more in ways]
        rows.append((n, len(exact.events), *(1e3 * s for s in seconds), off))
    return rows


def main() -> None:
    begin, wanted = time.perf_counter(), sys.argv[1:] or ["events", "springs", "steps"]
    if "events" in wanted:
        table("An event of a bouncing ball", ["", "µs", "restarts"], events())
    if "springs" in wanted:
        heads = ["", "error/m", "theory", "ms", "evaluations"]
        table("A stop against springs: two bounces, rtol 1e-8", heads, springs())
    if "steps" in wanted:
        heads = ["masses", "events", "event-driven/ms", "moreau/ms", "apart/m"]
        table("Masses dropped onto each other, 1 s", heads, steps())
    print(f"\n{time.perf_counter() - begin:.0f} s")


if __name__ == "__main__":
    main()
