"""The ways of evaluating a program, and of flattening a scene, give the same numbers on every model."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import lmoc
from lmoc.diagnostics import Report
from lmoc.numerics.casadi_system import can_lower
from lmoc.numerics.integrators import Problem
from lmoc.numerics.integrators.choice import integrator
from lmoc.numerics.native.c_code import Unsupported
from lmoc.numerics.native.compiler import find_compiler
from lmoc.numerics.plan import Plan
from lmoc.numerics.signals import bind_signals
from lmoc.numerics.simulate import Simulator
from lmoc.numerics.system import CasadiSystem, System, VectorSystem
from lmoc.semantics.flat import FlatDAE, Sums
from lmoc.structure.reduce import reduce

ROOT = Path(__file__).parent.parent / "models"
MODELS = sorted(ROOT.glob("*/*.lmo"))
NOT_LONG = [p for p in MODELS if p.parent.name != "classic"]  # 0.2 s are many turns of a linkage
SMALL = {"N": 20}  # the large scenes, short


def compiled(path: Path) -> lmoc.DAE:
    return lmoc.compile(path, parameters=SMALL if path.parent.name == "bench" else None)


def systems(dae: lmoc.DAE) -> tuple[Plan, dict[str, System]]:
    """Every way in which the program of a scene can be evaluated here, ready to be called."""
    report = Report()
    signals = bind_signals(dae.flat, None, report)
    plan, _ = Simulator(dae.reduced).system(signals, True, report)
    found: dict[str, System] = {"numpy": VectorSystem(plan)}
    if can_lower(plan.program):
        found["casadi"] = CasadiSystem(plan)
    if find_compiler():
        from lmoc.numerics.native.system import NativeSystem

        try:
            found["C"] = NativeSystem(plan)
        except Unsupported:
            pass
    for system in found.values():
        system.prepare(plan.base(dae.values, signals), signals)
    return plan, found


def derivatives(system: System, t: float, x: np.ndarray) -> np.ndarray:
    out = np.empty(system.n)
    system.rhs(t, x, out)
    return out


def assert_close(a: np.ndarray, b: np.ndarray, tolerance: float = 1e-12) -> None:
    scale = np.max(np.abs(b), initial=1e-300)
    np.testing.assert_allclose(a / scale, b / scale, rtol=0, atol=tolerance)


@pytest.mark.parametrize("path", MODELS, ids=lambda p: f"{p.parent.name}/{p.stem}")
def test_casadi_numpy_and_c_agree(path: Path) -> None:
    plan, found = systems(compiled(path))
    random = np.random.default_rng(1)
    for t in (0.0, 0.37):
        x = random.uniform(-0.5, 0.5, len(plan.states))
        reference = derivatives(found["numpy"], t, x)
        jacobian = found["numpy"].jacobian(t, x) if len(x) else None
        for system in found.values():
            assert_close(derivatives(system, t, x), reference)
            if jacobian is not None:
                assert_close(system.jacobian(t, x), jacobian)


def one_row_a_group(flat: FlatDAE) -> FlatDAE:
    """The same model as a tool without shapes would flatten it."""
    groups = [replace(g, slots=g.slots[i : i + 1]) for g in flat.groups for i in range(g.rows)]
    s = flat.sums
    return replace(
        flat, groups=tuple(groups), sums=Sums(s.start, s.index, s.sign, s.spans, s.span_of)
    )


@pytest.mark.parametrize("path", MODELS, ids=lambda p: f"{p.parent.name}/{p.stem}")
def test_shapes_and_scalars_agree(path: Path) -> None:
    dae = compiled(path)
    plan, found = systems(dae)
    scalar = reduce(one_row_a_group(dae.flat), dae.values, dae.states)
    assert sorted(scalar.state_names) == sorted(dae.states)
    report = Report()
    signals = bind_signals(scalar.flat, None, report)
    other, system = Simulator(scalar).system(signals, True, report)
    system.prepare(other.base(dae.values, signals), signals)
    names = [dae.reduced.register_name(int(r)) for r in plan.states]
    place = {scalar.register_name(int(r)): k for k, r in enumerate(other.states)}
    order = [place[name] for name in names]
    x = np.random.default_rng(2).uniform(-0.5, 0.5, len(names))
    y = np.empty(len(x))
    y[order] = x
    assert_close(derivatives(system, 0.21, y)[order], derivatives(found["numpy"], 0.21, x))


def trajectory(system: System, plan: Plan, x0: np.ndarray, grid: np.ndarray, rtol: float) -> np.ndarray:
    rows = [x0[None]]
    problem = Problem(
        system, x0, grid, rtol, np.full(len(x0), rtol * 1e-3), lambda _, states: rows.append(states.copy())
    )
    outcome = integrator("dop853")(problem)
    assert not outcome.failure
    return np.concatenate(rows)


@pytest.mark.parametrize("path", NOT_LONG, ids=lambda p: f"{p.parent.name}/{p.stem}")
def test_trajectories_agree(path: Path) -> None:
    dae = compiled(path)
    rtol, grid = 1e-7, np.linspace(0, 0.2, 5)
    plan, found = systems(dae)
    x0 = np.random.default_rng(3).uniform(-0.1, 0.1, len(plan.states))
    if not len(x0):
        return
    reference = trajectory(found.pop("numpy"), plan, x0, grid, rtol)
    for system in found.values():
        assert_close(trajectory(system, plan, x0, grid, rtol), reference, 10 * rtol)
