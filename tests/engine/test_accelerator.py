"""Compiled tapes: the bits of the interpreter, whatever is computed and whenever they take over."""

from __future__ import annotations

import numpy as np
import pytest
from conftest import ROOT
from oracles.copies import PAIRS, PENDULUMS
from oracles.copies import plan_of as plan_of_copies

import lmoc
from lmoc.engine.accelerator import OPTIONS, Accelerator, TapeAccelerator, c_text, compile_tape
from lmoc.engine.compiler import find_compiler, load_library
from lmoc.engine.kernel import Kernel
from lmoc.engine.series_text import SeriesAccelerator, series_text
from lmoc.expression import dag
from lmoc.expression.dag import slot
from lmoc.expression.functions import BINARY, FUNCTIONS, UNARY
from lmoc.ir.program import Apply, Total
from lmoc.lower.blocks import derivatives_tape, values_tape
from lmoc.lower.chain_rule import ChainRule
from lmoc.lower.series_code import RECURRENCES
from lmoc.lower.tape import Tape
from lmoc.messages.diagnostics import Report
from lmoc.numerics.plan.plan import Plan, build_plan
from lmoc.numerics.signals.signals import bind_signals

pytestmark = pytest.mark.skipif(find_compiler() is None, reason="no C compiler")


def agree(tape: Tape, fillings: list[np.ndarray], registers: int) -> None:
    """The whole memory, bit for bit; what is no number is so in both."""
    one, two, library = Kernel(tape), Kernel(tape), compile_tape(tape)
    assert library is not None
    two.accelerate(library)
    for w in fillings:
        found = []
        for kernel in (one, two):
            kernel.w[: len(w)] = w
            kernel.forget()
            found.append((kernel(0.3), kernel.w[:registers].copy(), kernel.results()))
        assert found[0][0] == found[1][0]
        for mine, theirs in zip(found[0][1:], found[1][1:], strict=True):
            assert np.array_equal(np.isnan(mine), np.isnan(theirs))
            number = ~np.isnan(mine)
            assert mine[number].tobytes() == theirs[number].tobytes()


@pytest.mark.parametrize("rows", [3, 300])
def test_all_functions(rows):
    names, steps = sorted(UNARY | BINARY | {"if"}), []
    for k, name in enumerate(names):
        node = dag.interned(name, tuple(slot(j) for j in range(FUNCTIONS[name].arity)))
        slots = np.column_stack([j * rows + np.arange(rows) for j in range(3)])
        steps.append(Apply(node, slots, (3 + k) * rows + np.arange(rows)))
    count = (3 + len(names)) * rows
    start, index = np.arange(0, count, 7), np.arange(count)
    total = Total(start, index, np.where(index % 2, 1.0, -0.1), count + np.arange(len(start) - 1))
    random = np.random.default_rng(3)
    fillings = [random.normal(size=3 * rows), random.normal(size=3 * rows) * 1e3, np.full(3 * rows, np.nan)]
    fillings.append(random.choice([0.0, -0.0, 1.0, -1.0, np.inf, -np.inf, np.nan, 1e-310], 3 * rows))
    agree(values_tape((*steps, total), count + len(total.out)), fillings, count + len(total.out))


def plan_of(scene: str) -> tuple[Plan, np.ndarray]:
    dae = lmoc.compile(ROOT / f"models/{scene}.lmo", parameters={"N": 10} if scene.startswith("bench") else None)
    prepared, report = dae.prepare(), Report()
    signals = bind_signals(prepared.reduced.flat, None, report)
    plan = build_plan(prepared.reduced, signals, True, report)
    return plan, plan.base(prepared.values, signals)


@pytest.mark.parametrize("scene", ["classic/slider_crank", "bench/lattice", "bench/network"])
def test_scenes_and_their_derivatives(scene):
    plan, base = plan_of(scene)
    random, fillings = np.random.default_rng(5), []
    for size in (0.1, 1.0, np.nan):
        w = base.copy()
        w[plan.states] = size * random.normal(size=len(plan.states))
        fillings.append(w)
    agree(values_tape(plan.program, plan.count), fillings, plan.count)
    rule = ChainRule(plan.program, plan.states, plan.derivatives, plan.count)
    w = random.normal(size=plan.count)
    lost = np.where(random.random(len(w)) < 0.1, np.nan, w)
    agree(derivatives_tape(plan.program, rule, plan.count), [w, lost], plan.count)


@pytest.mark.parametrize("text", [PENDULUMS, PAIRS], ids=["pendulums", "pairs"])
def test_loops_over_copies_with_their_blocks(text):
    plan, base, _ = plan_of_copies(text, 70)
    random, fillings = np.random.default_rng(6), []
    for size in (0.1, np.nan):
        w = base.copy()
        w[plan.states] = 1 + size * random.normal(size=len(plan.states))
        fillings.append(w)
    tape = values_tape(plan.program, plan.count)
    assert "t->functions->rows" in c_text(tape)
    agree(tape, fillings, plan.count)


@pytest.mark.parametrize("solver", ["dop853", "radau"])
def test_what_takes_over_in_the_middle_changes_no_bit(solver, monkeypatch):
    dae = lmoc.compile(ROOT / "models/classic/slider_crank.lmo")
    options = {"points": 40, "rtol": 1e-9, "solver": solver}
    before, asked = dae.simulate(**options), []

    def note(self, evaluations):
        asked.append(evaluations)
        if len(asked) == 3:
            self.library = compile_tape(self.tape)

    monkeypatch.setattr(Accelerator, "note", note)
    after = dae.simulate(**options)
    assert len(asked) == 3 and sum(asked) > 0  # in the middle, and nobody has asked again
    for name in dae.states:
        assert before[name].tobytes() == after[name].tobytes()
    assert before.stats["evaluations"] == after.stats["evaluations"]


def test_only_long_work_is_compiled(monkeypatch):
    plan, _ = plan_of("planar/chain")
    begun: list[Accelerator] = []
    monkeypatch.setattr(Accelerator, "_compile", lambda self: begun.append(self))
    accelerator = TapeAccelerator(values_tape(plan.program, plan.count))
    accelerator.note(1000)
    assert not begun
    for _ in range(3):
        accelerator.note(10**9)
    assert begun == [accelerator]


def test_constants_are_read_so_that_no_compiler_computes_with_them():
    program = (Apply(dag.function("sin", dag.const(0.7)) + slot(0), np.array([[0]]), np.array([1])),)
    text = c_text(values_tape(program, 2))
    assert "0.7" not in text and "0.64" not in text


FUNCTIONS_OF_TIME = """
model M
  parameter Real a = 2, b = 0.3;
  Real x(start = 1, fixed = true), y(start = 0.5, fixed = true);
equation
  der(x) = a*exp(-y)*sin(b*time) - x^3/(1 + y^2) + sqrt(2 + x)*y^1.7;
  der(y) = atan2(x, a + y) - y*tanh(x) + (a*x - 3)/(a + 2);
end M;
"""


@pytest.mark.parametrize("scene", [FUNCTIONS_OF_TIME, "planar/double_pendulum"])
def test_compiled_series_change_no_bit(scene, monkeypatch):
    dae = lmoc.compile_text(scene) if scene is FUNCTIONS_OF_TIME else lmoc.compile(ROOT / f"models/{scene}.lmo")
    name, asked = dae.states[0], []
    options = {"stop": 0.5, "points": 9, "workers": 1, "keep": dae.states}
    runs = {"initial": {name: np.linspace(0.9, 1.1, 6)}, **options}
    before = dae.ensemble(**runs)

    def note(self, sweeps):
        asked.append(sweeps)
        self.library = self._make()

    monkeypatch.setattr(SeriesAccelerator, "note", note)
    dae.ensemble(**runs)
    after = dae.ensemble(**runs)
    assert len(asked) == 1 and asked[0] > 0  # compiled from then on
    assert all(before[own].tobytes() == after[own].tobytes() for own in dae.states)


def test_rows_of_another_width_than_the_engine_has_are_not_compiled():
    code = np.array([list(RECURRENCES).index("add"), 0, 1, 2, 0], np.int32)
    taken = [lanes for lanes in (1, 4) if load_library(series_text(code, lanes), OPTIONS)]
    assert len(taken) == 1  # a compiler has rows of four, or none
