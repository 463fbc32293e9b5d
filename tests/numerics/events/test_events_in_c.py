"""Segments that events end, in C one after the other, and one by one in Python: the same bits."""

from __future__ import annotations

import pytest
from oracles.in_c import WAYS, both_ways

import lmoc
from lmoc.numerics.run import segments

BALL = """Real h(start = 1, fixed = true), v(start = 0, fixed = true); equation der(h) = v; der(v) = -9.81;"""
SCENES = {
    "a ball": f"{BALL} when h < 0 then reinit(v, -0.9*pre(v)); end when;",
    "a thermostat": """Real T(start = 15, fixed = true); Boolean on(start = true, fixed = true); equation
        der(T) = (if on then 30 else 0) - (T - 10); on = T < 19 or pre(on) and T < 21;""",
    "a sampled controller": """Real x(start = 0, fixed = true), v(start = 0, fixed = true);
        discrete Real u(start = 0, fixed = true), I(start = 0, fixed = true); equation der(x) = v; der(v) = u - 2*v - x;
        when sample(0, 0.1) then I = pre(I) + 0.1*(1 - x); u = 4*(1 - x) + 2*I; end when;""",
    "crossings at ticks": """Real x(start = 0, fixed = true), y(start = 0, fixed = true);
        Integer a(start = 0, fixed = true), b(start = 0, fixed = true), c(start = 0, fixed = true); equation
        der(x) = 1; der(y) = a - b; when {x > 0.5, x > 1, x > 1.5, x > 1.5} then a = pre(a) + 1; end when;
        when sample(0, 0.25) then b = pre(a) + pre(c); end when; when change(a) then c = pre(c) + 1; end when;""",
    "whole parts": """Real x(start = 0.3, fixed = true), y(start = 0, fixed = true); Integer n(start = 0, fixed = true);
        equation der(x) = 3 - y; der(y) = floor(x) + 0.1*n; when mod(x, 1) > 0.5 then n = pre(n) + 1; end when;""",
}


def bits(run: lmoc.Run) -> tuple[object, ...]:
    """Return all that a run has found."""
    trajectory = run.trajectory
    arrays = [(s.time, s.table, s.observer.base, s.largest) for s in trajectory.segments]
    parts = [[None if a is None else a.tobytes() for a in own] for own in arrays]
    counts = {k: v for k, v in trajectory.stats.items() if not k.endswith("seconds")}
    return parts, run.events, counts, dict(run.end), trajectory.crossing.tobytes(), [str(n) for n in run.notes]


@pytest.mark.parametrize("name", SCENES)
def test_bits_are_those_of_segments_one_by_one(name, monkeypatch):
    dae = lmoc.compile_text(f"model M {SCENES[name]} end M;")
    together, one_by_one, passed = both_ways(lambda: dae.simulate(stop=3, points=31), bits, monkeypatch)
    assert passed >= max(3, len(together[0]) - 5)  # C has gone through nearly all of them
    assert one_by_one == together


def test_what_cannot_be_done_there_is_told_as_ever(monkeypatch):
    """A `reinit` of what follows from two states, at an instant that C has come to."""
    dae = lmoc.compile_text("""model M Real h(start = 1, fixed = true), v(start = 0, fixed = true), y;
        Integer n(start = 0, fixed = true); equation der(h) = v; der(v) = -9.81; y = h*v;
        when h < 0 then reinit(v, -0.9*pre(v)); n = pre(n) + 1; end when;
        when n > 3 then reinit(y, 1); end when; end M;""")
    told = []
    for along in WAYS:
        monkeypatch.setattr(segments._Run, "_through_segments", along)
        with pytest.raises(lmoc.SimulationError, match="cannot be given a new value by reinit") as failed:
            dae.simulate(stop=5)
        told.append((str(failed.value), failed.value.time, failed.value.partial.events))
    assert told[0] == told[1] and len(told[0][2]) == 3
