"""lmoc and other tools on six scenes: the time that an error of 1e-6 and of 1e-9 costs.

All peers integrate the same equations, written by hand (`by_hand`): SciPy evaluates them as C where a compiler is,
casadi in its virtual machine, heyoka and diffsol compile them. lmoc has the scene. Each method is run over tolerances
until it is as exact as asked for; then the fastest that are exact enough take turns, and the shortest processor time of
each counts.
The error is the largest deviation of a signal from the reference at 501 output times, in units of its largest value.
"""

from __future__ import annotations

import contextlib
import math
import os
import shutil
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from benchmarks import by_hand, translate
from benchmarks.common import ROOT, buffered, save, table

POINTS = 501
TARGETS = (1e-6, 1e-9)
RTOLS = tuple(10.0 ** -(k / 2) for k in range(9, 27))  # 3e-5 to 1e-13
SLOW = 2.0  # s: a method that takes as long is not tried at tighter tolerances
KEPT = ROOT / "docs" / "charts" / "peers.json"

Call = Callable[[], np.ndarray]  # -> (POINTS, signals)
Maker = Callable[["Scene", float], Call]

PENDULUM = """
model Pendulum
  Real phi(start = 1.5, fixed = true), w(start = 0, fixed = true);
equation
  der(phi) = w;
  der(w) = -9.81*sin(phi);
  annotation(experiment(StopTime = 2000));
end Pendulum;
"""


SECTION = """\
## Against other tools

![Time over error of each tool on six scenes](charts/peers.png)

Six scenes at equal error: milliseconds of the processor for a warm run of 501 output times, by each tool's fastest
method whose error is at most the one in the second column; in brackets the milliseconds on the clock from the scene or
the equations to the result. lmoc reads the scene; the others have its equations by hand. SciPy and lmoc evaluate
them as C, casadi in its virtual machine, heyoka and diffsol as machine code of their own.

{table}

lmoc does not lead where the last column is above one: what it takes there is Python between steps and at the
beginning of each run, and reading angles and places that are no states, which have to be solved for at each output
time. The others have them as states.

`python -m benchmarks.peers --scenes` measures this with what is installed of SciPy, casadi, heyoka and diffsol; here on
an {processor} with {cores} cores. Tolerances go down to 1e-13 for lmoc and heyoka, to 1e-12 for the others; a dash
stands where that was not enough.
"""


@dataclass(frozen=True)
class Scene:
    """A scene: a file below `models` or a text, its equations by hand, and which states lmoc's signals are."""

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
        """The function ``(t, x) -> rate``, the start and the stop time."""
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


ANGLES = ("beta", "Theta", "gamma", "phi", "delta", "Omega", "epsilon")
SCENES = (
    Scene("pendulum, 2000 s", PENDULUM, by_hand.pendulum, {"phi": 0, "w": 1}, lambda t: swing(t)),
    Scene("Pleiades", "classic/pleiades.lmo", by_hand.pleiades,
          {f"{c}[{i + 1}]": 7 * k + i for k, c in enumerate("xy") for i in range(7)}),
    Scene("Andrews", "classic/andrews.lmo", by_hand.andrews, {a: k for k, a in enumerate(ANGLES)}),
    Scene("car axis", "classic/car_axis.lmo", by_hand.car_axis, {"xl": 0, "yl": 1, "xr": 2, "yr": 3}),
    Scene("string of 100 masses", "hard/h14_plucked_string.lmo", by_hand.plucked_string,
          {"q1": 0, "q30": 29, "q50": 49, "q100": 99, "v30": 129, "v100": 199}),
    Scene("quarter car", "notes/ex05_suspension.lmo", by_hand.quarter_car, {"q1": 0, "q2": 1, "v_q1": 2, "v_q2": 3}),
)  # fmt: skip


def lmoc_with(solver: str) -> Maker:
    """Whole `simulate` calls, with the signals read."""

    def make(scene: Scene, rtol: float) -> Call:
        dae = scene.dae()

        def call() -> np.ndarray:
            run = dae.simulate(rtol=rtol, solver=solver, points=POINTS, energy=False)
            return np.column_stack([run[name] for name in scene.signals])

        return call

    return make


def compiled(scene: Scene):
    """The equations by hand as C where a compiler is, else in casadi's virtual machine."""
    import casadi as ca

    function = scene.hand()[0]
    if shutil.which("gcc") is None or os.environ.get("LMOC_CC") == "":
        return function
    jit = {"flags": ["-O2"], "cleanup": False}
    options = {"jit": True, "compiler": "shell", "jit_options": jit, "jit_cleanup": False}

    def make():
        inputs = function.sx_in()
        with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):  # casadi leaves its files where it is
            return ca.Function("ode", inputs, [function(*inputs)], options)

    return scene.once("compiled", make)


def absolute(rtol: float) -> float:
    """Absolute tolerance of the peers, above what rounding leaves of the smallest states."""
    return max(rtol * 1e-3, 1e-15)


def scipy_with(method: str) -> Maker:
    """`solve_ivp`, with casadi's buffer interface as the right-hand side."""

    def make(scene: Scene, rtol: float) -> Call:
        from scipy.integrate import solve_ivp

        _, start, stop = scene.hand()
        rhs = buffered(compiled(scene), len(start))
        times, columns = scene.times(), scene.columns()

        def call() -> np.ndarray:
            done = solve_ivp(rhs, (0, stop), start, method, times, rtol=rtol, atol=absolute(rtol))
            if not done.success:
                raise RuntimeError(done.message)
            return done.y[columns].T

        return call

    return make


def casadi_with(multistep: str) -> Maker:
    """casadi's `cvodes` on the equations by hand."""

    def make(scene: Scene, rtol: float) -> Call:
        import casadi as ca

        function, start, _ = scene.hand()
        t, x = function.sx_in()
        options = {"reltol": rtol, "abstol": absolute(rtol), "max_num_steps": 10**8}
        options["linear_multistep_method"] = multistep
        if multistep == "adams":
            options["nonlinear_solver_iteration"] = "functional"
        times, columns = scene.times(), scene.columns()
        ode = {"t": t, "x": x, "ode": function(t, x)}
        solver = ca.integrator("scene", "cvodes", ode, 0, times, options)
        return lambda: np.array(solver(x0=start)["xf"])[columns].T

    return make


def heyoka_taylor(scene: Scene, rtol: float) -> Call:
    """heyoka's adaptive Taylor integrator; large systems in its compact mode."""
    import heyoka as hy

    function, start, _ = scene.hand()
    system = scene.once("heyoka", lambda: translate.heyoka_system(function))
    compact = function.n_instructions() > 300
    integrator = hy.taylor_adaptive(system, start.copy(), tol=rtol, compact_mode=compact)
    times, columns = scene.times(), scene.columns()

    def call() -> np.ndarray:
        integrator.time = 0.0
        integrator.state[:] = start
        *_, states = integrator.propagate_grid(times)
        return states[:, columns]

    return call


def diffsol_with(method: str) -> Maker:
    """diffsol on the equations in DiffSL."""

    def make(scene: Scene, rtol: float) -> Call:
        import pydiffsol as ds

        function, start, _ = scene.hand()
        code = scene.once("diffsl", lambda: translate.diffsl(function, start))
        ode = scene.once(method, lambda: ds.Ode(code, ode_solver=getattr(ds, method)))
        times, columns = scene.times(), scene.columns()

        def call() -> np.ndarray:
            ode.rtol, ode.atol = rtol, absolute(rtol)
            return np.asarray(ode.solve_dense(np.zeros(0), times).ys)[columns].T

        return call

    return make


class NotExpressed(Exception):
    """A tool has no such scene here."""


MUJOCO = """
<mujoco><option timestep="{step}" integrator="RK4" gravity="0 0 -9.81"/><worldbody><body>
  <joint name="pin" type="hinge" axis="0 1 0" damping="0"/>
  <inertial pos="0 0 -1" mass="1" diaginertia="1e-12 1e-12 1e-12"/></body></worldbody></mujoco>"""


def mujoco_rk4(scene: Scene, rtol: float) -> Call:
    """MuJoCo's Runge–Kutta method with steps of equal length, of the pendulum; no other of the scenes is of bodies."""
    import mujoco

    if scene.model != PENDULUM:
        raise NotExpressed("only the pendulum is a scene of rigid bodies in a tree")
    times = scene.times()
    each = math.ceil((times[1] - times[0]) / (0.3 * rtol**0.25))  # steps between two outputs
    model = mujoco.MjModel.from_xml_string(MUJOCO.format(step=(times[1] - times[0]) / each))
    data = mujoco.MjData(model)

    def call() -> np.ndarray:
        mujoco.mj_resetData(model, data)
        data.qpos[0] = scene.hand()[1][0]
        values = np.empty((len(times), 2))
        for k in range(len(times)):
            if k:
                mujoco.mj_step(model, data, nstep=each)
            values[k] = data.qpos[0], data.qvel[0]
        return values

    return call


def rumoca_bdf(scene: Scene, rtol: float) -> Call:
    """rumoca on the same text, which is Modelica; the other scenes use lmoc's library."""
    import rumoca as rm

    if scene.model != PENDULUM:
        raise NotExpressed("the scene uses lmoc's library")
    model = scene.once("rumoca", lambda: rm.Session().loads(PENDULUM, model="Pendulum"))
    times = scene.times()
    config = rm.SimConfig(rtol=rtol, atol=absolute(rtol), dt=times[1] - times[0])

    def call() -> np.ndarray:
        result = model.simulate(config=config, t=(0, times[-1]))
        values = np.column_stack([np.asarray(result[name]) for name in scene.signals])
        if len(values) != len(times):
            raise RuntimeError(f"{len(values)} output times in place of {len(times)}")
        return values

    return call


def contenders() -> Iterator[tuple[str, str, Maker]]:
    """Tool, method and how a run is made."""
    for solver in ("taylor", "dop853", "auto", "adams"):
        yield "lmoc", solver, lmoc_with(solver)
    for method in ("DOP853", "LSODA"):
        yield "scipy", method, scipy_with(method)
    for multistep in ("adams", "bdf"):
        yield "casadi", f"cvodes {multistep}", casadi_with(multistep)
    yield "heyoka", "Taylor", heyoka_taylor
    for method in ("tsit45", "bdf"):
        yield "diffsol", method, diffsol_with(method)
    yield "mujoco", "RK4", mujoco_rk4
    yield "rumoca", "BDF", rumoca_bdf


@dataclass(frozen=True)
class Candidate:
    """A method at a tolerance with the error and the first processor time of its run."""

    tool: str
    method: str
    rtol: float
    error: float
    seconds: float
    make: Maker = field(repr=False)
    call: Call = field(repr=False)


def reference(scene: Scene) -> tuple[np.ndarray, float]:
    """Signals in closed form, else by lmoc's Taylor series at 1e-14, and the deviation of a second way to them.

    The second way is the Taylor series, else SciPy's DOP853 at 1e-12 on the equations by hand.
    """
    series = lmoc_with("taylor")(scene, 1e-14)()
    if scene.exact is not None:
        exact = scene.exact(scene.times())
        return exact, deviation(series, exact)
    return series, deviation(scipy_with("DOP853")(scene, 1e-12)(), series)


def swing(times: np.ndarray) -> np.ndarray:
    """Angle and rate of the pendulum in Jacobi's functions: sin(phi/2) = k sn(K - w t)."""
    from scipy.special import ellipj, ellipk

    k, w = np.sin(0.75), np.sqrt(9.81)
    quarter = ellipk(k**2)
    sn, cn, _, _ = ellipj(np.remainder(quarter - w * times, 4 * quarter), k**2)
    return np.column_stack([2 * np.arcsin(k * sn), -2 * k * w * cn])


def deviation(values: np.ndarray, exact: np.ndarray) -> float:
    return float((np.abs(values - exact).max(axis=0) / np.abs(exact).max(axis=0)).max())


def from_nothing(scene: Scene, c: Candidate) -> float:
    """Seconds on the clock from the scene or the equations to a result, in a process that has the tool loaded.

    Code that lmoc keeps on disk is there; heyoka's memory of what it has compiled is emptied.
    """
    if c.tool == "heyoka":
        import heyoka as hy

        hy.llvm_state.clear_memcache()
    begin = time.perf_counter()
    c.make(replace(scene, cache={}), c.rtol)()
    return time.perf_counter() - begin


def timed(call: Call) -> tuple[np.ndarray, float]:
    begin = time.process_time()
    values = call()
    return values, time.process_time() - begin


def scan(scene: Scene, tool: str, method: str, make: Maker, exact: np.ndarray, before: list[Candidate]):
    """Runs of a method at tighter and tighter tolerances, until its error is below the smallest target.

    A method that takes more than three times as long as another of its tool, which is no less exact, is left.
    """
    found: list[Candidate] = []
    for rtol in RTOLS:
        if rtol < 1e-12 and tool not in ("lmoc", "heyoka"):  # rounding in the others is near, and steps become many
            break
        call = make(scene, rtol)
        values, seconds = timed(call)
        if seconds < 0.5:  # the first call may have made code
            seconds = min(seconds, timed(call)[1])
        if not np.isfinite(values).all():
            break
        error = deviation(values, exact)
        found.append(Candidate(tool, method, rtol, error, seconds, make, call))
        behind = any(c.tool == tool and c.error <= error and 3 * c.seconds < seconds for c in before)
        if error < min(TARGETS) or seconds > SLOW or behind:
            break
    return found


def race(candidates: list[Candidate], target: float, repeat: int) -> dict[str, tuple[Candidate, float]]:
    """For each tool the fastest run with an error of at most the target: those that lead take turns."""
    best: dict[str, tuple[Candidate, float]] = {}
    leading: list[Candidate] = []
    for tool in dict.fromkeys(c.tool for c in candidates):
        leading += sorted((c for c in candidates if c.tool == tool and c.error <= target), key=lambda c: c.seconds)[:2]
    for turn in range(repeat):
        for c in leading:
            if turn > 1 and turn * c.seconds > SLOW:  # long runs scatter little
                continue
            seconds = timed(c.call)[1]
            if c.tool not in best or seconds < best[c.tool][1]:
                best[c.tool] = c, seconds
    return best


def compare(scene: Scene, repeat: int) -> tuple[list[dict[str, object]], list[dict[str, object]]]:
    """Rows of one scene, one a tool and target, with the ratio to lmoc; and all runs, from which curves are drawn."""
    lmoc_with("auto")(scene, 1e-6)()
    time.sleep(4)  # the compiler works beside the first run
    exact, uncertainty = reference(scene)
    print(f"{scene.name}: references agree to {uncertainty:.0e}", flush=True)
    candidates: list[Candidate] = []
    absent: dict[str, str] = {}
    for tool, method, make in contenders():
        if tool in absent:
            continue
        try:
            found = scan(scene, tool, method, make, exact, candidates)
            candidates += found
            least = min((c.error for c in found), default=np.nan)
            print(f"  {tool} {method}: {len(found)} tolerances, error down to {least:.1e}", flush=True)
        except NotExpressed as reason:
            print(f"  {tool}: {reason}")
        except ModuleNotFoundError:
            absent[tool] = "not installed"
            print(f"  {tool}: not installed")
        except Exception as error:  # a rival's failure is a result too
            if tool == "lmoc":
                print(f"  lmoc {method}: {error}")
            else:
                print(f"  {tool} {method}: {type(error).__name__}: {str(error)[:120]}")
    rows: list[dict[str, object]] = []
    for target in TARGETS:
        best = race(candidates, target, repeat)
        for tool, (c, seconds) in best.items():
            rows.append({"scene": scene.name, "target": target, "tool": tool, "method": c.method, "rtol": c.rtol,
                         "error": c.error, "ms": seconds * 1e3, "ratio": seconds / best["lmoc"][1],
                         "from nothing ms": from_nothing(scene, c) * 1e3})  # fmt: skip
    table(scene.name, list(rows[0]), [list(r.values()) for r in rows])
    return rows, [{"scene": scene.name, "tool": c.tool, "error": c.error, "ms": c.seconds * 1e3} for c in candidates]


def page(data: dict) -> str:
    """The section of `docs/accuracy.md` from what `compare_all` has kept."""
    rows, machine_ = data["figures"]["rows"], data["machine"]
    tools = list(dict.fromkeys(r["tool"] for r in rows))
    head = ["scene", "error", *tools, "lmoc / fastest other"]
    lines = ["| " + " | ".join(head) + " |", "|" + " --- |" * len(head)]
    for scene, target in dict.fromkeys((r["scene"], r["target"]) for r in rows):
        here = {r["tool"]: r for r in rows if (r["scene"], r["target"]) == (scene, target)}
        cells = [_cell(here[t]) if t in here else "–" for t in tools]
        others = [r["ms"] for t, r in here.items() if t != "lmoc"]
        ratio = here["lmoc"]["ms"] / min(others) if others and "lmoc" in here else None
        lines.append(
            "| "
            + " | ".join(
                [scene, f"{target:.0e}", *cells, "–" if ratio is None else f"{ratio:.{0 if ratio >= 10 else 1}f}"]
            )
            + " |"
        )
    return SECTION.format(table="\n".join(lines), **machine_)


def draw(data: dict, path: Path) -> None:
    """Draw time over error, one panel a scene, one curve a tool: its runs that no other of its own is better than."""
    import matplotlib
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    from lmoc.report.plots import COLOURS, STYLE, head

    runs = data["figures"]["runs"]
    scenes, tools = (list(dict.fromkeys(r[key] for r in runs)) for key in ("scene", "tool"))
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(9, 5.8), dpi=150, layout="constrained")
        FigureCanvasAgg(figure)
        axes = figure.subplots(2, -(-len(scenes) // 2), sharex=True, squeeze=False).ravel()
        for axis, scene in zip(axes, scenes, strict=False):
            axis.set_xscale("log")
            axis.set_yscale("log")
            for k, tool in enumerate(tools):
                best = envelope([(r["error"], r["ms"]) for r in runs if (r["scene"], r["tool"]) == (scene, tool)])
                if best:
                    width = 2.2 if tool == "lmoc" else 1.2
                    axis.plot(*zip(*best, strict=True), color=COLOURS[k], marker="o", markersize=3, linewidth=width)
            axis.set_title(scene, fontsize=9)
            axis.set_xlim(1e-3, 1e-11)
        for axis in axes[len(scenes) :]:
            axis.set_visible(False)
        handles = [axes[0].plot([], [], color=COLOURS[k], label=tool)[0] for k, tool in enumerate(tools)]
        figure.legend(handles=handles, loc="upper right", ncols=len(tools), frameon=False, borderaxespad=0.2,
                      handlelength=1.2, columnspacing=1.2)  # fmt: skip
        figure.supylabel("milliseconds of a warm run", fontsize=9)
        figure.supxlabel("error: largest deviation, relative to each signal's largest value", fontsize=9)
        head(figure, "Six scenes by lmoc and by other tools")
        figure.savefig(path)


def envelope(points: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    """Return the points than which no other has both a smaller error and a shorter time, the largest error first."""
    best: list[tuple[float, float]] = []
    for error, seconds in sorted(points):
        if not best or seconds < best[-1][1]:
            best.append((error, seconds))
    return best[::-1]


def _cell(row: dict) -> str:
    ms, first = (f"{row[k]:.3g}" if row[k] < 1000 else f"{row[k]:.0f}" for k in ("ms", "from nothing ms"))
    return f"{ms} {row['method']} ({first})"


def compare_all(repeat: int, names: list[str]) -> None:
    """Compare all scenes, or those named; all together are kept for the page beside its pictures.

    Raises
    ------
    SystemExit
        For a name that no scene has.
    """
    unknown = set(names) - {scene.name for scene in SCENES}
    if unknown:
        raise SystemExit(f"no scene {', '.join(sorted(unknown))}; there are: {', '.join(s.name for s in SCENES)}")
    found = [compare(scene, repeat) for scene in SCENES if not names or scene.name in names]
    rows, runs = ([item for part in parts for item in part] for parts in zip(*found, strict=True))
    path = save("frontier", {"rows": rows, "runs": runs})
    if not names:
        shutil.copy(path, KEPT)
