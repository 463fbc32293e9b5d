"""How methods fail: each failure as numbers of runs, with the commands that show them, and what helps.

    python -m benchmarks.stability          all failures as text; `make charts` writes them to docs/stability.md
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np

from benchmarks.common import ROOT

FOLDER = "models/failures"


@dataclass(frozen=True)
class Failure:
    """One way in which methods fail.

    Attributes
    ----------
    commands : that show it
    seen : what they show, with its numbers
    remedy : what lmoc does or offers, with its numbers
    numbers : the same, for tests
    """

    title: str
    commands: tuple[str, ...]
    seen: str
    remedy: str
    numbers: dict[str, float]


@cache
def model(name: str):
    import lmoc

    return lmoc.compile(ROOT / name)


def own(name: str):
    return model(f"{FOLDER}/{name}.lmo")


def damping_of_bdf(symplectic: float | None = None) -> Failure:
    """The run of Gauss's method ends at `symplectic`, s: its error does not grow."""
    lost = {}
    for solver in ("cvode", "auto", "gauss"):
        run = own("oscillator").simulate(solver=solver, stop=symplectic if solver == "gauss" else None)
        lost[solver] = abs(1 - float(run["H"][-1]))
    return Failure(
        "BDF damps what is undamped",
        (f"lmoc run {FOLDER}/oscillator.lmo --solver cvode",),
        f"After 500 periods at the default tolerance of 1e-6 BDF has lost {lost['cvode']:.1%} of the energy.",
        f"`auto` begins with DOP853 and refines its steps: {lost['auto']:.0e}. `--solver gauss` is symplectic at its "
        f"constant step: {lost['gauss']:.0e}.",
        lost,
    )


def long_runs(stop: float = 62832.0) -> Failure:
    numbers = {}
    runs = {"dop853": {"solver": "dop853"}, "auto": {}, "gauss": {"solver": "gauss", "step": 0.7}}
    for name, options in runs.items():
        run = own("oscillator").simulate(stop=stop, points=201, **options)
        H = run["H"]
        numbers[f"{name} steps"] = float(run.stats["steps"])
        numbers[name] = float(np.abs(H - 1).max())
        numbers[f"{name} early"] = float(np.abs(H[:50] - 1).max())
    steps = f"{numbers['dop853 steps']:,.0f}".replace(",", " ")
    return Failure(
        "Errors of steps add up over long runs",
        (f"lmoc run {FOLDER}/oscillator.lmo --stop 62832 --solver dop853",
         f"lmoc run {FOLDER}/oscillator.lmo --stop 62832 --solver gauss --step 0.7"),
        f"Over 10⁴ periods DOP853 at 1e-6 is wrong by {numbers['dop853']:.1e} of the energy: the tolerance is one of a "
        f"step, and there are {steps} of them.",
        f"`auto` divides the tolerance by the steps that the motion remembers: {numbers['auto']:.1e}. With steps of "
        f"equal length Gauss collocation does not drift at all: {numbers['gauss']:.0e}, and "
        f"{numbers['gauss early']:.0e} in the first quarter of the run.",
        numbers,
    )  # fmt: skip


def beyond_the_stability_limit() -> Failure:
    largest = {}
    for solver in ("rk4", "verlet", "midpoint"):
        run = own("oscillator").simulate(stop=290, solver=solver, step=2.9, points=101)  # at the ends of the steps
        largest[solver] = float(np.abs(run["x"]).max())
    return Failure(
        "Steps beyond the limit of stability",
        (f"lmoc run {FOLDER}/oscillator.lmo --stop 290 --solver rk4 --step 2.9",),
        f"RK4 is stable up to h·ω = 2.83, Verlet up to 2. At 2.9 an amplitude of 1 becomes {largest['rk4']:.0e} and "
        f"{largest['verlet']:.0e} within 100 steps.",
        f"The implicit midpoint rule is stable at any step ({largest['midpoint']:.2f}), though its phase is wrong. "
        "Methods that choose their steps keep below the limit by themselves.",
        largest,
    )


def ringing() -> Failure:
    numbers = {}
    for solver in ("midpoint", "generalized-alpha", "radau"):
        options = {} if solver == "radau" else {"step": 0.05}
        run = own("relaxation").simulate(solver=solver, initial={"x": 2.0}, points=41, **options)
        late = run.time > 1.0
        numbers[solver] = float(np.abs(run["x"] - np.cos(run.time))[late].max())
    return Failure(
        "A-stable is not L-stable: a transient rings on",
        (f"lmoc run {FOLDER}/relaxation.lmo --init x=2 --solver midpoint --step 0.05",),
        "A start beside the slow motion must relax in 0.1 ms. At steps of 50 ms the implicit midpoint rule only turns "
        f"its sign at each step: the error after 1 s is still {numbers['midpoint']:.1f}.",
        f"Methods with damping at infinity forget it: generalized α {numbers['generalized-alpha']:.0e}, Radau "
        f"{numbers['radau']:.0e}. `auto` takes BDF here.",
        numbers,
    )  # fmt: skip


def stiffness() -> Failure:
    numbers = {s: float(own("relaxation").simulate(solver=s).stats["evaluations"]) for s in ("dop853", "auto")}
    return Failure(
        "Explicit methods on stiff scenes",
        (f"lmoc run {FOLDER}/relaxation.lmo --solver dop853",),
        "The motion is cos(t), but the steps of an explicit method are as short as the time constant of 10 µs: DOP853 "
        f"takes {numbers['dop853']:.0f} evaluations for 2 s.",
        f"`auto` notices it within some steps and goes on with BDF: {numbers['auto']:.0f} evaluations. A mode that "
        "swings is followed, or stepped over by Radau where it is below the tolerance.",
        numbers,
    )  # fmt: skip


def order_reduction() -> Failure:
    numbers = {}
    for k in (1.0, 1e5):
        errors = []
        for step in (0.5, 0.25):
            run = own("relaxation").simulate(solver="gauss", step=step, parameters={"k": k}, times=[1.0, 2.0])
            errors.append(float(np.abs(run["x"] - np.cos(run.time)).max()))
        numbers[f"order at k = {k:g}"] = float(np.log2(errors[0] / errors[1]))
    mild, stiff = numbers.values()
    return Failure(
        "Stiffness reduces the order (Prothero and Robinson)",
        (f"lmoc run {FOLDER}/relaxation.lmo --solver gauss --step 0.5 --set k=1",
         f"lmoc run {FOLDER}/relaxation.lmo --solver gauss --step 0.5 --set k=1e5"),
        f"Half the step divides the error of Gauss collocation of order 8 by 2^{mild:.1f} at k = 1, and by "
        f"2^{stiff:.1f} at k = 1e5, where only the order of its stages counts.",
        "`auto` takes BDF for a fast relaxation, which has no stages; the chart of a scene shows the order that is "
        "left.",
        numbers,
    )  # fmt: skip


def stiff_limit_of_laws() -> Failure:
    numbers = {}
    for k in (1e4, 1e8):
        run = own("penalty").simulate(parameters={"k": k})
        numbers[f"apart at k = {k:g}"] = float(np.abs(run["law"] - run["spring"]).max())
        numbers[f"evaluations at k = {k:g}"] = float(run.stats["evaluations"])
    ball = own("penalty").simulate(rtol=1e-9)
    exact = np.sqrt(2 / 9.81) * np.array([1, 3, 5, 7])
    numbers["instants of the law"] = float(np.abs([e.time for e in ball.events] - exact).max())
    return Failure(
        "A stiff spring in place of a contact",
        (f"lmoc run {FOLDER}/penalty.lmo --set k=1e4", f"lmoc run {FOLDER}/penalty.lmo"),
        f"With k = 1e4 N/m the ball is {numbers['apart at k = 10000']:.2f} m from where it belongs after four bounces; "
        f"with 1e8 still {numbers['apart at k = 1e+08']:.1e} m, at {numbers['evaluations at k = 1e+08']:.0f} "
        f"evaluations instead of {numbers['evaluations at k = 10000']:.0f}.",
        "A law (`Stop`) has no stiffness: its impacts are at their instants within "
        f"{numbers['instants of the law']:.0e} s.",
        numbers,
    )


def chatter() -> Failure:
    from lmoc.messages.diagnostics import SimulationError

    begin = time.thread_time()
    try:
        own("sign_friction").simulate()
        raise AssertionError("a friction written with sign() must chatter")
    except SimulationError as failure:
        stopped, words = float(failure.time), str(failure)
    spent = time.thread_time() - begin
    stuck = model("models/laws/h16_stick_slip.lmo").simulate()
    numbers = {"stopped": stopped, "seconds": spent, "told": float("line 6" in words)}
    numbers["events"] = float(len(stuck.events))
    return Failure(
        "Friction with a hidden sign chatters",
        (f"lmoc run {FOLDER}/sign_friction.lmo", "lmoc run models/laws/h16_stick_slip.lmo"),
        "`sign(v)` has no value that lets the mass stick: the run switches back and forth and is ended at "
        f"{stopped:.1e} s with the line of the condition, instead of going on with steps of no length.",
        f"`DryFriction` sticks and slips as modes of a law: {numbers['events']:.0f} events in the stick-slip scene.",
        numbers,
    )  # fmt: skip


def creep() -> Failure:
    run = own("creep").simulate()
    numbers = {"smooth": float(run["creeping"][-1]), "dry": float(run["sticking"][-1])}
    return Failure(
        "Smoothed friction creeps",
        (f"lmoc run {FOLDER}/creep.lmo",),
        f"With tanh(v/0.001) a pull of half the limit moves a mass {numbers['smooth'] * 100:.1f} cm in 100 s.",
        f"With `DryFriction` it moves {numbers['dry']:g} m.",
        numbers,
    )


def aliasing() -> Failure:
    numbers = {
        "at periods": float(np.abs(own("kapitza").simulate(solver="rk4", step=0.01)["phi"]).max()),
        "auto": float(np.abs(own("kapitza").simulate()["phi"]).max()),
    }
    return Failure(
        "Fast forcing is aliased (Kapitza's pendulum)",
        (f"lmoc run {FOLDER}/kapitza.lmo --solver rk4 --step 0.01",),
        "Steps as long as a period of the pivot see it at two phases only: the pendulum, which stands on its head in "
        f"truth, leaves the upright by {numbers['at periods']:.1f} rad.",
        f"Methods that estimate their error resolve the forcing; it stays within {numbers['auto']:.2f} rad. A picture "
        "or a table whose output times are too coarse for the motion is told.",
        numbers,
    )  # fmt: skip


def a_pulse_stepped_over() -> Failure:
    numbers = {
        "rk4": float(own("pulse").simulate(solver="rk4", step=0.9)["v"][-1]),
        "auto": float(own("pulse").simulate(points=11)["v"][-1]),
    }
    return Failure(
        "A short pulse is stepped over",
        (f"lmoc run {FOLDER}/pulse.lmo --solver rk4 --step 0.9",),
        f"Steps of 0.9 s see a push of 10 ms at one instant or at none: v = {numbers['rk4']:.2g} instead of 1.772.",
        f"Functions of time are looked at before the run, and bound the steps: v = {numbers['auto']:.4f} with any "
        "solver that chooses its steps. What is shorter than a 130 000th of a run needs `--max-step`.",
        numbers,
    )


def zeno() -> Failure:
    run = model("models/laws/h19_bouncing_ball.lmo").simulate()
    rests = [e.time for e in run.events if e.kind == "accumulation"]
    numbers = {"rests": float(rests[0]), "events": float(len(run.events))}
    return Failure(
        "Infinitely many impacts (Zeno)",
        ("lmoc run models/laws/h19_bouncing_ball.lmo",),
        "A bouncing ball makes infinitely many impacts in a finite time; a loop over events would never come to its "
        "end.",
        f"The instant at which they accumulate follows from the last ones: the ball rests from {numbers['rests']:.4f} "
        f"s on, after {numbers['events']:.0f} events.",
        numbers,
    )  # fmt: skip


def drift() -> Failure:
    numbers = {}
    for rtol in (1e-4, 1e-6):
        numbers[f"{rtol:g}"] = float(np.abs(own("drift").simulate(rtol=rtol, solver="cvode")["drift"]).max())
    run = model("models/hard/h01_cartesian_pendulum.lmo").simulate(stop=100)
    numbers["reduced"] = _off_the_circle(run)
    return Failure(
        "Index reduction by hand drifts",
        (f"lmoc run {FOLDER}/drift.lmo --solver cvode", "lmoc run models/hard/h01_cartesian_pendulum.lmo --stop 100"),
        "With the constraint differentiated twice nothing holds the length any more: after 100 s the rod is longer or "
        f"shorter by {numbers['1e-06']:.1%} at 1e-6, and by {numbers['0.0001']:.0%} at 1e-4.",
        f"lmoc keeps the constraint itself and solves for one coordinate: {numbers['reduced']:.0e}.",
        numbers,
    )


def formulations() -> Failure:
    from lmoc.messages.diagnostics import SimulationError

    dae, numbers = model("models/planar/four_bar.lmo"), {}
    for name in ("index1", "projected", "reduced"):
        numbers[name] = dae.simulate(formulation=name, stop=20, rtol=1e-4).residual[0]
    try:
        dae.simulate(formulation="index3", stop=20, rtol=1e-4)
        numbers["index3"] = 20.0
    except SimulationError as failure:
        numbers["index3"] = float(failure.time)
    return Failure(
        "Closed loops at index 3 and at index 1",
        ("lmoc run models/planar/four_bar.lmo --stop 20 --rtol 1e-4 --formulation index3",
         "lmoc run models/planar/four_bar.lmo --stop 20 --rtol 1e-4 --formulation index1"),
        f"BDF on the closures as they stand (index 3) ends at {numbers['index3']:.2g} s of 20 s: rounding in them is "
        f"divided by the square of the step. Differentiated twice (index 1) they drift by {numbers['index1']:.1e} m.",
        f"Projected after each step they hold to {numbers['projected']:.0e}; in minimal coordinates, the default, to "
        f"{numbers['reduced']:.0e}.",
        numbers,
    )  # fmt: skip


def _off_the_circle(run) -> float:
    square = run["x"] ** 2 + run["y"] ** 2
    return float(np.abs(np.sqrt(square / square[0]) - 1).max())


def small_amplitudes() -> Failure:
    exact = lambda run: 1e-9 * np.cos(2 * run.time)  # noqa: E731
    numbers = {}
    for name, options in (("absolute", {"atol": 1e-9}), ("default", {})):
        run = own("nanometre").simulate(solver="dop853", **options)
        numbers[name] = float(np.abs(run["x"] - exact(run)).max() / 1e-9)
    return Failure(
        "An absolute tolerance as large as the motion",
        (f"lmoc run {FOLDER}/nanometre.lmo --atol 1e-9 --solver dop853",),
        f"An oscillation of a nanometre with an absolute tolerance of 1e-9 is wrong by {numbers['absolute']:.0%}.",
        f"Without `--atol` it follows the size of the motion: {numbers['default']:.0e}.",
        numbers,
    )


def chaos() -> Failure:
    dae = model("models/planar/double_pendulum.lmo")
    fine = {tol: dae.simulate(stop=40, rtol=tol, solver="dop853", points=401) for tol in (1e-8, 1e-10, 1e-12)}
    name = fine[1e-8].states[0]
    trusted = {}
    for tol in (1e-8, 1e-10):
        apart = np.abs(fine[tol][name] - fine[1e-12][name])
        trusted[f"{tol:g}"] = float(fine[tol].time[np.argmax(apart > 0.01)]) if (apart > 0.01).any() else 40.0
    return Failure(
        "Chaos: digits are lost at a constant rate",
        ("lmoc chart models/planar/double_pendulum.lmo --stop 40 --quick",),
        f"The double pendulum at 1e-8 is right to 0.01 rad until {trusted['1e-08']:.0f} s, at 1e-10 until "
        f"{trusted['1e-10']:.0f} s: a hundredth of the tolerance buys some seconds.",
        "No method helps. The chart says how far its two references agree, and recommends no more digits than they "
        "have.",
        trusted,
    )


def bifurcation() -> Failure:
    import lmoc
    from lmoc.messages.diagnostics import SimulationError

    dae = lmoc.compile(ROOT / FOLDER / "isosceles.lmo")
    try:
        run = dae.simulate(stop=2.0)
        numbers, words = {"reached": float(run.time[-1]), "energy": float(run.energy.balance)}, "goes through"
    except SimulationError as failure:
        numbers, words = {"reached": float(failure.time), "energy": 0.0}, str(failure)
    return Failure(
        "Two branches meet (bifurcation)",
        (f"lmoc run {FOLDER}/isosceles.lmo --stop 2",),
        "A slider crank with a rod as long as its crank can fold: there the mechanism could go on in two ways, and an "
        "integrator that divides by a small pivot takes either, or neither.",
        f"The rank of all constraints is watched at each step: the run {words.rstrip('.')}."
        if words != "goes through"
        else "The run goes on along the branch that momentum continues; the energy balance is "
             f"{numbers['energy']:.0e}.",
        numbers,
    )


ALL: tuple[Callable[[], Failure], ...] = (
    damping_of_bdf, long_runs, drift, formulations, beyond_the_stability_limit, stiffness, ringing, order_reduction,
    stiff_limit_of_laws, chatter, creep, aliasing, a_pulse_stepped_over, zeno, bifurcation, small_amplitudes, chaos,
)  # fmt: skip


def main() -> None:
    for make in ALL:
        failure = make()
        print(f"\n{failure.title}\n  {failure.seen}\n  {failure.remedy}")


if __name__ == "__main__":
    main()
