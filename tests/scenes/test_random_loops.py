"""Random mechanisms with loops, large angles among them, against constraint matrices and multipliers."""

from __future__ import annotations

import numpy as np
import pytest
from oracles.multipliers import RANK, Mechanism

import lmoc
from lmoc.messages.diagnostics import Report
from lmoc.numerics.plan.plan import build_plan
from lmoc.numerics.solve.interpreter import Interpreter


def values_of(dae: lmoc.DAE, known: dict[str, tuple[float, float]]) -> dict[str, float]:
    """Every variable of the flat model, given position and velocity of all coordinates by name."""
    reduced, table = dae.reduced, dae.reduced.registers
    plan = build_plan(reduced, {}, False, Report())
    w = plan.base(reduced.values, {})
    for register in plan.states.tolist():
        name = dae.flat.variable_name(int(table.variable[register]))
        w[register] = known[name][int(table.order[register])]
    Interpreter(plan.full_program, plan.count).run(w, 0.0)
    found = np.append(w, np.nan)[reduced.register_of]  # register -1: undetermined
    return dict(zip(dae.flat.names(), found.tolist(), strict=True))


@pytest.mark.parametrize("seed", range(16))
def test_random_mechanism(seed):
    s = Mechanism(seed)
    chance = np.random.default_rng(seed)
    q, v = s.state(chance.uniform(-1, 1, s.free), chance.uniform(-1, 1, s.free))
    a = s.constraints(q)
    size = np.linalg.svd(a, compute_uv=False)
    rank = np.count_nonzero(size > RANK * size[0])
    assert len(s.ports) - rank == s.free

    dae = lmoc.compile_text(s.text)
    assert len(dae.states) == 2 * s.free
    undetermined = {dae.flat.variable_name(int(i)) for i in dae.reduced.undetermined}
    assert {name for name in undetermined if name.count(".") == 2} == s.undetermined(q)

    exact = s.accelerations(q, v)
    known = dict(zip(s.ports, zip(q, v, strict=True), strict=True))
    for part, port, *_ in s.masses:
        position, rate = ("q", "v") if s.ports[port].endswith("q") else ("theta", "omega")
        known[f"{part}.{position}"] = q[port], v[port]
        known[f"{part}.{rate}"] = v[port], exact[port]
    for part, left, right, _, offset in s.springs:
        extension = "extension" if s.ports[left].endswith("q") else "twist"
        known[f"{part}.{extension}"] = q[right] - q[left] + offset, v[right] - v[left]
    value = values_of(dae, known)
    np.testing.assert_allclose([value[name] for name in s.ports], q, rtol=0, atol=1e-10)
    names = [f"{part}.{'a' if s.ports[port].endswith('q') else 'alpha'}" for part, port, *_ in s.masses]
    found, expected = np.array([value[n] for n in names]), exact[[port for _, port, *_ in s.masses]]
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-10 * max(1.0, np.abs(expected).max()))


def test_the_mechanisms_have_loops_and_large_angles():
    """What the test above is about occurs often enough."""
    many = [Mechanism(seed) for seed in range(40)]
    redundant = [s for s in many if len(s.rows) > len(s.ports) - s.free]
    curved = [s for s in redundant if any(row.arm for row in s.rows)]
    assert len(redundant) > 15 and len(curved) > 8
