"""The ways of evaluating a program, and of flattening a scene, give the same numbers on every model."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from oracles import models
from oracles.by_numpy import VectorSystem

import lmoc
from lmoc.ir.flat import FlatDAE, Sums
from lmoc.ir.program import Solve, walk
from lmoc.messages.diagnostics import Report
from lmoc.numerics.evaluate.engine_system import EngineSystem
from lmoc.numerics.plan.plan import Plan
from lmoc.numerics.problem.base import Problem
from lmoc.numerics.problem.system import System
from lmoc.numerics.run.simulate import Simulator
from lmoc.numerics.signals.signals import bind_signals
from lmoc.numerics.start.initialization import seed_blocks
from lmoc.numerics.start.targets import targets
from lmoc.numerics.steps.choice import integrate
from lmoc.structure.laws.reduce import reduce_with_laws

ROOT = Path(__file__).parents[2] / "models"
MODELS = [p for p in sorted(ROOT.glob("*/*.lmo")) if p.stem != "h26_andrews"]  # the same as planar/andrews
# 0.2 s are many turns of a linkage, and friction by signs as written chatters
NOT_LONG = [p for p in MODELS if p.parent.name not in ("classic", "failures")]
# blocks, laws and events, whose values follow from those before them; the stiff one takes 10⁵ explicit steps by numpy
FOLLOWED = [p for p in NOT_LONG if p.parent.name in ("hard", "laws", "planar") and p.stem != "h28_prothero_robinson"]
FAST = {"andrews": 0.003}  # s, and in 0.03 s others do what this one does then
STEP = 1e-3  # s, of scenes whose equations have kinks
SMALL = {"N": 20}  # the large scenes, short


def compiled(path: Path) -> lmoc.DAE:
    return models.compiled(path, **(SMALL if path.parent.name == "bench" else {}))


def systems(dae: lmoc.DAE) -> tuple[Plan, dict[str, System]]:
    """The engine and numpy on the program of a scene, ready to be called; its relations as written."""
    report, prepared = Report(), dae.prepare()
    signals = bind_signals(prepared.reduced.flat, None, report)
    plan, _ = Simulator(prepared.reduced).system(signals, True, report)
    found: dict[str, System] = {"numpy": VectorSystem(plan), "engine": EngineSystem(plan)}
    for system in found.values():
        system.prepare(seeded(plan, prepared.values, signals), signals)
    return plan, found


def seeded(plan: Plan, values: np.ndarray, signals: dict) -> np.ndarray:
    """The registers that do not change, and where Newton's method begins."""
    base = plan.base(values, signals)
    seed_blocks(plan, base, targets(plan, values, {}, Report()), plan.reduced.guess)
    return base


def derivatives(system: System, t: float, x: np.ndarray) -> np.ndarray:
    out = np.empty(system.n)
    system.rhs(t, x, out)
    return out


def assert_close(a: np.ndarray, b: np.ndarray, tolerance: float = 1e-12) -> None:
    scale = np.max(np.abs(b), initial=1e-300)
    np.testing.assert_allclose(a / scale, b / scale, rtol=0, atol=tolerance)


def assert_entries_close(a: np.ndarray, b: np.ndarray, terms: np.ndarray | float) -> None:
    """Every entry for itself: to 1e-11 of its own size, and to the rounding of the terms that it is the sum of."""
    assert np.isfinite(a).all() and np.isfinite(b).all()
    missed = np.abs(a - b) > 1e-11 * np.abs(b) + 1e-13 * terms
    assert not missed.any(), (a[missed], b[missed])


def points(dae: lmoc.DAE, plan: Plan, count: int) -> list[np.ndarray]:
    """Random states; near the start where nonlinear blocks have solutions only in places."""
    random = np.random.default_rng(1)
    if all(not isinstance(s, Solve) or s.linear for s in walk(plan.program)):
        return [random.uniform(-0.5, 0.5, len(plan.states)) for _ in range(count)]
    names = [plan.reduced.register_name(int(r)) for r in plan.states]
    run = dae.simulate(times=[0.0, 1e-6])
    start = np.array([run[name][0] if name in dae.states else 0.0 for name in names])
    return [start + random.uniform(-1e-3, 1e-3, len(start)) for _ in range(count)]


@pytest.mark.parametrize("path", MODELS, ids=lambda p: f"{p.parent.name}/{p.stem}")
def test_the_engine_and_numpy_agree_and_so_do_shapes_and_scalars(path: Path) -> None:
    dae = compiled(path)
    plan, found = systems(dae)
    assert_engine_and_numpy_agree(dae, plan, found)
    assert_shapes_and_scalars_agree(dae, plan, found["numpy"])


def assert_engine_and_numpy_agree(dae: lmoc.DAE, plan: Plan, found: dict[str, System]) -> None:
    for t, x in zip((0.0, 0.37), points(dae, plan, 2), strict=True):
        reference = derivatives(found["numpy"], t, x)
        jacobian = found["numpy"].jacobian(t, x) if len(x) else np.zeros((0, 0))
        for system in found.values():
            assert_entries_close(derivatives(system, t, x), reference, np.abs(jacobian) @ np.abs(x))
            if len(x):
                row = np.maximum(np.abs(jacobian).max(axis=1, keepdims=True), 0.1 * np.abs(jacobian).max())
                assert_entries_close(system.jacobian(t, x), jacobian, row)


def one_row_a_group(flat: FlatDAE) -> FlatDAE:
    """The same model as a tool without shapes would flatten it."""
    groups = [replace(g, slots=g.slots[i : i + 1]) for g in flat.groups for i in range(g.rows)]
    s = flat.sums
    return replace(flat, groups=tuple(groups), sums=Sums(s.start, s.index, s.sign, s.spans, s.span_of))


def assert_shapes_and_scalars_agree(dae: lmoc.DAE, plan: Plan, by_numpy: System) -> None:
    prepared = dae.prepare()
    named = all(prepared.flat.find(s) is not None for s in dae.states)  # else a law has made states of its own
    scalar = reduce_with_laws(one_row_a_group(prepared.flat), prepared.values, dae.states if named else None)
    assert sorted(scalar.state_names) == sorted(dae.states)
    report = Report()
    signals = bind_signals(scalar.flat, None, report)
    other, system = Simulator(scalar).system(signals, True, report)
    system.prepare(seeded(other, prepared.values, signals), signals)
    names = [plan.reduced.register_name(int(r)) for r in plan.states]
    place = {scalar.register_name(int(r)): k for k, r in enumerate(other.states)}
    order = [place[name] for name in names]
    (x,) = points(dae, plan, 1)
    y = np.empty(len(x))
    y[order] = x
    reference = derivatives(by_numpy, 0.21, x)
    jacobian = by_numpy.jacobian(0.21, x) if len(x) else np.zeros((0, 0))
    assert_entries_close(derivatives(system, 0.21, y)[order], reference, np.abs(jacobian) @ np.abs(x))
    if len(x):
        row = np.maximum(np.abs(jacobian).max(axis=1, keepdims=True), 0.1 * np.abs(jacobian).max())
        assert_entries_close(system.jacobian(0.21, y)[np.ix_(order, order)], jacobian, row)


def trajectory(
    system: System, plan: Plan, x0: np.ndarray, grid: np.ndarray, rtol: float, step: float | None = None
) -> np.ndarray:
    rows = [x0[None]]
    atol, end = np.full(len(x0), rtol * 1e-3), float(grid[-1])
    begin, times = float(grid[0]), grid[1:]
    problem = Problem(
        system, begin, x0, end, times, rtol, atol, lambda _, states: rows.append(states.copy()), step=step
    )  # fmt: skip
    outcome = integrate(problem, "dop853" if step is None else "rk4")
    assert not outcome.status.failed
    return np.concatenate(rows)


@pytest.mark.parametrize("path", FOLLOWED, ids=lambda p: f"{p.parent.name}/{p.stem}")
def test_trajectories_agree(path: Path) -> None:
    dae = compiled(path)
    plan, found = systems(dae)
    x0 = points(dae, plan, 1)[0] / 5
    implicit = any(isinstance(s, Solve) and not s.linear for s in walk(plan.program))
    if implicit:  # its blocks have solutions in places only
        x0 = points(dae, plan, 1)[0]
    rtol, grid = 1e-7, np.linspace(0, min(FAST.get(path.stem, 0.03), dae.flat.experiment.stop or 0.03), 5)
    if not len(x0):
        return
    # where a kink rejects a step is rounding, and what the steps then are; of equal ones rounding is all that differs
    step = STEP if any("event(" in str(g.right) for g in plan.reduced.flat.groups) else None
    reference = trajectory(found.pop("numpy"), plan, x0, grid, rtol, step)
    for system in found.values():
        assert_close(trajectory(system, plan, x0, grid, rtol, step), reference, 10 * rtol if step is None else 1e-10)
