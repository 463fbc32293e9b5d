"""How each tool runs a scene: lmoc from its model, general integrators from the equations by hand.

A maker returns for a scene and a tolerance a call that makes one whole run and returns the signals at the output times.
"""

from __future__ import annotations

import contextlib
import os
import shutil
import tempfile
from collections.abc import Callable

import numpy as np

from benchmarks import translate
from benchmarks.common import buffered
from benchmarks.frontier.scenes import PENDULUM, POINTS, Scene

Call = Callable[[], np.ndarray]  # -> (POINTS, signals)
Maker = Callable[[Scene, float], Call]


class NotExpressed(Exception):
    """A tool has no such scene here; the text says why."""


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


def solved_by_scipy(rhs: Callable, scene: Scene, rtol: float, method: str = "DOP853") -> Call:
    """Return a run of a right-hand side ``(t, x) -> rate`` by `solve_ivp`, from the scene's start."""
    from scipy.integrate import solve_ivp

    _, start, stop = scene.hand()
    times, columns = scene.times(), scene.columns()

    def call() -> np.ndarray:
        done = solve_ivp(rhs, (0, stop), start, method, times, rtol=rtol, atol=absolute(rtol))
        if not done.success:
            raise RuntimeError(done.message)
        return done.y[columns].T

    return call


def scipy_with(method: str) -> Maker:
    """`solve_ivp`, with casadi's buffer interface as the right-hand side."""

    def make(scene: Scene, rtol: float) -> Call:
        return solved_by_scipy(buffered(compiled(scene), len(scene.hand()[1])), scene, rtol, method)

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


def rumoca_bdf(scene: Scene, rtol: float) -> Call:
    """rumoca on the same text, which is Modelica."""
    if scene.model != PENDULUM:
        raise NotExpressed("the scene uses lmoc's library")
    import rumoca as rm

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
