"""One tool in a process of its own: scans its methods over tolerances, and makes warm runs when it is its turn."""

from __future__ import annotations

import multiprocessing
import site
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from multiprocessing.connection import Connection
from typing import Any

import numpy as np

from benchmarks.frontier.bodies import exudyn_with, mujoco_rk4, pinocchio_aba, sympy_lagrange
from benchmarks.frontier.scenes import SCENES, Scene, deviation
from benchmarks.frontier.tools import (
    Call,
    Maker,
    NotExpressed,
    casadi_with,
    diffsol_with,
    heyoka_taylor,
    lmoc_with,
    rumoca_bdf,
    scipy_with,
)

RTOLS = tuple(10.0 ** -(k / 2) for k in range(9, 27))  # 3e-5 to 1e-13
SLOW = 2.0  # s: a method that takes as long is not tried at tighter tolerances, nor one that takes …
FAR, SHORT = 100.0, 0.2  # … so many times as long as lmoc's fastest, and so many seconds
TURN = 0.02  # s of a turn: runs that are shorter are repeated, after one that warms the caches
ANSWER = 240.0  # s after which a tool is given up

TOOLS: dict[str, dict[str, Maker]] = {
    "lmoc": {name: lmoc_with(name) for name in ("taylor", "dop853", "auto", "adams")},
    "scipy": {name: scipy_with(name) for name in ("DOP853", "LSODA")},
    "casadi": {f"cvodes {name}": casadi_with(name) for name in ("adams", "bdf")},
    "heyoka": {"Taylor": heyoka_taylor},
    "diffsol": {name: diffsol_with(name) for name in ("tsit45", "bdf")},
    "mujoco": {"RK4": mujoco_rk4},
    "exudyn": {"RK44": exudyn_with("RK44", 4), "RK67": exudyn_with("RK67", 6)},
    "pinocchio": {"aba, DOP853": pinocchio_aba},
    "sympy": {"Lagrange, DOP853": sympy_lagrange},
    "rumoca": {"BDF": rumoca_bdf},
}


@dataclass(frozen=True)
class Candidate:
    """A method at a tolerance with the error and the first processor time of its run."""

    tool: str
    method: str
    rtol: float
    error: float
    seconds: float


class Worker:
    """A tool's process, and one scene in it.

    Parameters
    ----------
    packages : folders with packages of another environment, in which tools may be installed
    """

    def __init__(self, tool: str, scene: str, packages: Sequence[str]) -> None:
        context = multiprocessing.get_context("spawn")
        self.tool = tool
        self._pipe, other = context.Pipe()
        self._process = context.Process(target=serve, args=(other, tool, scene, tuple(packages)), daemon=True)
        self._process.start()
        other.close()

    def ask(self, what: str, *arguments: object) -> Any:
        """Return the answer to a request.

        Raises
        ------
        RuntimeError
            The tool has died, or does not answer.
        """
        self._pipe.send((what, *arguments))
        try:
            if not self._pipe.poll(ANSWER):
                raise RuntimeError(f"no answer in {ANSWER:.0f} s")
            return self._pipe.recv()
        except EOFError:
            raise RuntimeError("the process has died") from None

    def close(self) -> None:
        self._process.terminate()
        self._process.join()
        self._pipe.close()


def serve(pipe: Connection, tool: str, name: str, packages: Sequence[str]) -> None:
    """Answer requests about one tool and one scene until the pipe closes."""
    for folder in packages:
        site.addsitedir(folder)
    scene, calls = SCENES[name], {}
    while True:
        try:
            what, *arguments = pipe.recv()
        except EOFError:
            return
        if what == "scan":
            pipe.send(list(_scan(scene, tool, *arguments, calls)))
        elif what == "turn":
            pipe.send(turn(calls[tuple(arguments)]))
        else:
            pipe.send(from_nothing(scene, tool, *arguments))


def _scan(
    scene: Scene, tool: str, exact: np.ndarray, least: float, slow: float, calls: dict[tuple[str, float], Call]
) -> Iterator[Candidate | str]:
    """Yield the runs of all methods at tighter and tighter tolerances, and what there is to say; fills `calls`.

    Parameters
    ----------
    least : the smallest error that is asked for
    slow : s, of a run after which a method is not tried at tighter tolerances
    """
    before: list[Candidate] = []
    if tool == "lmoc":
        lmoc_with("auto")(scene, 1e-6)()
        time.sleep(4)  # the compiler works beside the first run
    for method, make in TOOLS[tool].items():
        found: list[Candidate] = []
        try:
            for one, call in _tried(scene, tool, method, make, exact, (least, slow), before):
                found.append(one)
                calls[method, one.rtol] = call
            smallest = min((c.error for c in found), default=np.nan)
            yield f"{method}: {len(found)} tolerances, error down to {smallest:.1e}"
        except ModuleNotFoundError as missing:
            yield f"not installed ({missing.name})"
            return
        except NotExpressed as reason:
            yield str(reason)
            return
        except Exception as error:  # a tool's failure is a result too
            yield f"{method}: {type(error).__name__}: {str(error)[:120]}"
        before += found
        yield from found


def _tried(
    scene: Scene,
    tool: str,
    method: str,
    make: Maker,
    exact: np.ndarray,
    until: tuple[float, float],
    before: list[Candidate],
) -> Iterator[tuple[Candidate, Call]]:
    """Yield runs of a method until its error is below the least that is asked for, or until it is slow.

    A method that takes more than three times as long as another of its tool, which is no less exact, is left.
    """
    for rtol in RTOLS:
        if rtol < 1e-12 and tool not in ("lmoc", "heyoka"):  # rounding in the others is near, and steps become many
            return
        call = make(scene, rtol)
        values, seconds = timed(call)
        if seconds < 0.5:  # the first call may have made code
            seconds = min(seconds, timed(call)[1])
        if not np.isfinite(values).all():
            return
        error = deviation(values, exact)
        yield Candidate(tool, method, rtol, error, seconds), call
        if error < until[0] or seconds > until[1] or any(c.error <= error and 3 * c.seconds < seconds for c in before):
            return


def timed(call: Call) -> tuple[np.ndarray, float]:
    """Return what a call gives, and the seconds of the processor that it takes."""
    begin = time.process_time()
    values = call()
    return values, time.process_time() - begin


def turn(call: Call) -> float:
    """Return the shortest processor time of some warm runs, one after the other."""
    begin, shortest = time.process_time(), timed(call)[1]
    if shortest < TURN:  # it has warmed the caches, which other tools have used meanwhile
        shortest = np.inf
    while time.process_time() - begin < TURN:
        shortest = min(shortest, timed(call)[1])
    return shortest


def from_nothing(scene: Scene, tool: str, method: str, rtol: float) -> float:
    """Return the seconds on the clock from the scene or the equations to a result, in a process that has the tool.

    Code that lmoc keeps on disk is there; heyoka's memory of what it has compiled is emptied.
    """
    if tool == "heyoka":
        import heyoka as hy

        hy.llvm_state.clear_memcache()
    begin = time.perf_counter()
    TOOLS[tool][method](replace(scene, cache={}), rtol)()
    return time.perf_counter() - begin
