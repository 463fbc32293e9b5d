"""A corrupted structure of each kind is noticed by its checker."""

from dataclasses import replace

import numpy as np
import pytest

from lmoc.expression.dag import slot
from lmoc.ir.check import check
from lmoc.ir.check.findings import CorruptStructureError
from lmoc.ir.flat import FlatDAE, Kind
from lmoc.ir.normalized import Normalized
from lmoc.ir.program import Apply, Role, Solve, Total
from lmoc.ir.reduced import Guard, Reduced, StartGuess
from lmoc.messages.diagnostics import Report
from lmoc.messages.source import Source
from lmoc.pipeline import Clock, Scene, flatten, parse
from lmoc.structure.normalize import normalize
from lmoc.structure.reduce import reduce

# a sum over many connections, gears with factors, a nonlinear pair of arms, an input, a law, a linear block
SCENE = """\
model Everything
  parameter Real k = 3;
  input Real f = sin(time);
  Fixed wall(q0 = 1);
  Spring spring[12](each k = k, each d0 = 0.1);
  Mass body(m = 2, q(start = 0.5, fixed = true));
  Force push(f = f);
  Inertia wheel(J = 2);
  Gear gear(N = 3);
  Inertia second(J = 0.5);
  Arm arm(l = 1);
  Arm other(l = 1);
  FixedShaft ground;
  TorsionSpring return(k = 2);
  Mass slider(m = 1);
equation
  for i in 1:12 loop
    connect(wall.flange, spring[i].a);
    connect(spring[i].b, body.flange);
  end for;
  connect(push.flange, body.flange);
  connect(wheel.shaft, gear.a);
  connect(gear.b, second.shaft);
  connect(second.shaft, arm.shaft);
  connect(arm.flange, slider.flange);
  connect(second.shaft, return.a);
  connect(return.b, ground.shaft);
  connect(other.shaft, second.shaft);
  connect(other.flange, slider.flange);
end Everything;
"""


@pytest.fixture(scope="module")
def flat() -> FlatDAE:
    clock = Clock()
    text = SCENE.replace("return", "back")
    return flatten(Scene(parse([Source("everything.lmo", text)], clock)), clock)


@pytest.fixture(scope="module")
def normalized(flat) -> Normalized:
    return normalize(flat, flat.parameter_values(), None, Report())


@pytest.fixture(scope="module")
def reduced(flat) -> Reduced:
    return reduce(flat)


def at(values: np.ndarray, place, value) -> np.ndarray:
    """A copy with other entries."""
    values = values.copy()
    values[place] = value
    return values


def swapped(items: tuple, index: int, **changes) -> tuple:
    """A copy of a tuple of dataclasses with one of them changed."""
    return (*items[:index], replace(items[index], **changes), *items[index + 1 :])


def found(structure: object) -> str:
    with pytest.raises(CorruptStructureError) as caught:
        check(structure)
    return str(caught.value)


def test_what_the_stages_make_is_sound(flat, normalized, reduced):
    for structure in (flat, normalized, reduced):
        check(structure)
    assert flat.sums.rows and flat.initial_groups == () and normalized.sums.rows and len(normalized.derived)
    assert len(normalized.undetermined) and reduced.guards


def test_nothing_else_has_a_checker():
    with pytest.raises(TypeError, match="no checker for int"):
        check(1)


# ------------------------------------------------------------------------------ flat model


def wide(flat: FlatDAE) -> int:
    """A group with two unknown columns and one of parameters."""
    kinds = [set(flat.kind[g.slots[0]].tolist()) for g in flat.groups]
    return next(i for i, k in enumerate(kinds) if {Kind.PARAMETER, Kind.UNKNOWN} <= k)


FLAT = {
    "block begins elsewhere": lambda f: replace(f, blocks=swapped(f.blocks, 3, offset=f.blocks[3].offset + 1)),
    "block of another size": lambda f: replace(f, blocks=swapped(f.blocks, 3, size=f.blocks[3].size + 1)),
    "part of a block": lambda f: replace(f, blocks=swapped(f.blocks, 3, part=len(f.parts))),
    "parent behind its part": lambda f: replace(f, parts=swapped(f.parts, 1, parent=2)),
    "port": lambda f: replace(f, parts=swapped(f.parts, 1, ports=((0, len(f.blocks)),))),
    "slot": lambda f: replace(f, groups=swapped(f.groups, 0, slots=at(f.groups[0].slots, (0, 0), f.count))),
    "negative slot": lambda f: replace(f, groups=swapped(f.groups, 0, slots=at(f.groups[0].slots, (0, 0), -1))),
    "no integers": lambda f: replace(f, groups=swapped(f.groups, 0, slots=f.groups[0].slots.astype(float))),
    "arity": lambda f: replace(f, groups=swapped(f.groups, 0, left=slot(f.groups[0].slots.shape[1]))),
    "derivative of a parameter": lambda f: replace(
        f,
        groups=swapped(
            f.groups, wide(f), left=slot(int(np.argmax(f.kind[f.groups[wide(f)].slots[0]] == Kind.PARAMETER)), 1)
        ),
    ),
    "part of a group": lambda f: replace(f, groups=swapped(f.groups, 0, part=-1)),
    "terms of a sum": lambda f: replace(f, sums=replace(f.sums, index=at(f.sums.index, 0, f.count))),
    "signs": lambda f: replace(f, sums=replace(f.sums, sign=at(f.sums.sign, 0, 2.0))),
    "segments": lambda f: replace(f, sums=replace(f.sums, start=at(f.sums.start, -1, f.sums.start[-1] - 1))),
    "segments out of order": lambda f: replace(f, sums=replace(f.sums, start=at(f.sums.start, 1, f.sums.start[2] + 1))),
    "span of a sum": lambda f: replace(f, sums=replace(f.sums, span_of=at(f.sums.span_of, 0, len(f.sums.spans)))),
    "target": lambda f: replace(f, starts=swapped(f.starts, 0, target=at(f.starts[0].target, 0, -1))),
    "bindings in another order": lambda f: replace(f, bindings=f.bindings[::-1]),
}


@pytest.mark.parametrize("corruption", FLAT)
def test_a_corrupted_flat_model_is_noticed(flat, corruption):
    assert found(FLAT[corruption](flat)).startswith("FlatDAE: ")


def test_a_column_of_several_kinds_is_noticed(flat):
    number = next(i for i, g in enumerate(flat.groups) if g.rows > 2)
    slots = flat.groups[number].slots
    column = int(np.argmax(flat.kind[slots[0]] == Kind.UNKNOWN))
    parameter = int(np.argmax(flat.kind == Kind.PARAMETER))
    groups = swapped(flat.groups, number, slots=at(slots, (1, column), parameter))
    assert f"column {column}: variables of several kinds (at 1)" in found(replace(flat, groups=groups))


# --------------------------------------------------------------------- after elimination


def eliminated(n: Normalized) -> int:
    return int(np.argmax((n.root != np.arange(n.flat.count)) & (n.flat.kind == Kind.UNKNOWN)))


NORMALIZED = {
    "root": lambda n: replace(n, root=at(n.root, 0, n.extended_count)),
    "root that is gone": lambda n: replace(n, root=at(n.root, n.root[eliminated(n)], eliminated(n))),
    "itself, differently": lambda n: replace(n, order=at(n.order, 0, 1)),
    "order": lambda n: replace(n, order=at(n.order, eliminated(n), -1)),
    "factor": lambda n: replace(n, factor=at(n.factor, eliminated(n), -3)),
    "factor that is unknown": lambda n: replace(n, factor=at(n.factor, eliminated(n), eliminated(n))),
    "offset": lambda n: replace(n, offset=at(n.offset, eliminated(n), -2)),
    "derived values": lambda n: replace(n, derived_values=n.derived_values[1:]),
    "derived from itself": lambda n: replace(
        n, derived=swapped(n.derived, 0, slots=at(n.derived[0].slots, (0, 0), n.derived[0].target[0]))
    ),
    "derived out of order": lambda n: replace(n, derived=n.derived[::-1]),
    "eliminated slot": lambda n: replace(
        n, groups=swapped(n.groups, unknown_group(n), slots=at(n.groups[unknown_group(n)].slots, 0, eliminated(n)))
    ),
    "source": lambda n: replace(
        n, groups=swapped(n.groups, 0, source=at(n.groups[0].source, 0, n.flat.equation_count))
    ),
    "arity": lambda n: replace(n, groups=swapped(n.groups, 0, residual=slot(n.groups[0].slots.shape[1]))),
    "sum": lambda n: replace(n, sums=replace(n.sums, index=at(n.sums.index, 0, eliminated(n)))),
    "coefficient": lambda n: replace(n, sums=replace(n.sums, coefficient=at(n.sums.coefficient, 0, np.nan))),
    "undetermined": lambda n: replace(n, undetermined=np.array([n.flat.count])),
}


def unknown_group(n: Normalized) -> int:
    kind = np.append(n.flat.kind, np.full(n.extended_count - n.flat.count, Kind.PARAMETER))
    return next(i for i, g in enumerate(n.groups) if (kind[g.slots[0]] == Kind.UNKNOWN).all())


@pytest.mark.parametrize("corruption", NORMALIZED)
def test_a_corrupted_elimination_is_noticed(normalized, corruption):
    assert found(NORMALIZED[corruption](normalized)).startswith("Normalized: ")


# ------------------------------------------------------------------------- reduced system


def last_apply(r: Reduced) -> int:
    return max(i for i, s in enumerate(r.rhs) if isinstance(s, Apply))


def another(r: Reduced, role: Role) -> int:
    return int(np.argmax(r.registers.role == role))


REDUCED = {
    "role": lambda r: replace(r, registers=replace(r.registers, role=at(r.registers.role, 0, len(Role)))),
    "name": lambda r: replace(r, registers=replace(r.registers, variable=at(r.registers.variable, 0, r.flat.count))),
    "length of the table": lambda r: replace(r, registers=replace(r.registers, order=r.registers.order[1:])),
    "state of another role": lambda r: replace(r, states=at(r.states, 0, another(r, Role.COMPUTED))),
    "states without derivative": lambda r: replace(r, derivatives=r.derivatives[1:]),
    "derivative not computed": lambda r: replace(r, rhs=()),
    "known": lambda r: replace(r, known=r.known[:, 1:]),
    "input": lambda r: replace(r, inputs=at(r.inputs, (0, 0), another(r, Role.COMPUTED))),
    "required": lambda r: replace(r, required_inputs=r.required_inputs[1:]),
    "steps in another order": lambda r: replace(r, rhs=r.rhs[::-1], observe=r.observe[::-1]),
    "step left out": lambda r: replace(r, rhs=r.rhs[1:]),
    "step done twice": lambda r: replace(r, rhs=(*r.rhs, r.rhs[last_apply(r)])),
    "written twice in a step": lambda r: replace(
        r, observe=(*r.observe, Apply(slot(0), np.full((2, 1), r.states[0]), np.full(2, r.registers.count - 1)))
    ),
    "overwritten state": lambda r: replace(
        r, rhs=(*r.rhs, Apply(slot(0), np.array([[r.states[0]]]), r.states[:1].copy()))
    ),
    "register out of range": lambda r: replace(
        r, rhs=(*r.rhs, Apply(slot(0), np.array([[r.registers.count]]), np.array([r.registers.count])))
    ),
    "arity of a step": lambda r: replace(r, rhs=swapped(r.rhs, last_apply(r), shape=slot(99))),
    "derivative in a step": lambda r: replace(r, rhs=swapped(r.rhs, last_apply(r), shape=slot(0, 1))),
    "way back": lambda r: replace(r, register_of=at(r.register_of, 0, r.registers.count)),
    "variable without register": lambda r: replace(r, undetermined=r.undetermined[:0]),
    "guess": lambda r: replace(
        r,
        guess=StartGuess(
            np.zeros(len(r.states) + 1), np.zeros(0, int), np.zeros(0), True, np.zeros(0, int), np.zeros(0)
        ),
    ),
    "guard": lambda r: replace(r, guards=(*r.guards, Guard(lambda values: False, "1 = 2"))),
    "parameter program": lambda r: replace(r, parameter_program=r.parameter_program[1:]),
}


@pytest.mark.parametrize("corruption", REDUCED)
def test_a_corrupted_reduction_is_noticed(reduced, corruption):
    assert found(REDUCED[corruption](reduced)).startswith("Reduced: ")


def solve(**changes) -> Solve:
    """Registers: 0 given, 1 to 3 free; x + w[0] = 0 for x in register 1, the residual in register 2."""
    inner = (Apply(slot(0) + slot(1), np.array([[1, 0]]), np.array([2])),)
    block = Solve(inner, np.array([[1]]), np.array([[2]]), linear=True, constant=True)
    return replace(block, **changes)


TOTAL = Total(np.array([0, 2]), np.array([0, 0]), np.ones(2), np.array([3]))
STEPS = {
    "residual not computed": solve(residuals=np.array([[3]])),
    "unknown given": solve(unknowns=np.array([[0]])),
    "unknown computed inside": solve(inner=(*solve().inner, Apply(slot(0), np.array([[0]]), np.array([1])))),
    "constant, not linear": solve(linear=False),
    "shapes of unknowns and residuals": solve(residuals=np.array([[2, 3]])),
    "guess that is not there": solve(guess=np.array([[3]])),
    "read before it is written": Apply(slot(0), np.array([[3]]), np.array([1])),
    "terms of a total": replace(TOTAL, index=np.array([0, 3])),
    "segments of a total": replace(TOTAL, start=np.array([0, 3])),
    "coefficients of a total": replace(TOTAL, coefficient=np.ones(1)),
}


@pytest.mark.parametrize("corruption", STEPS)
def test_a_corrupted_step_is_noticed(corruption):
    assert findings_of(STEPS[corruption])


def test_sound_steps_pass():
    assert findings_of(solve()) == findings_of(TOTAL) == []


def findings_of(step) -> list[str]:
    from lmoc.ir.check.findings import Findings
    from lmoc.ir.check.program import check_program

    findings = Findings()
    check_program((step,), np.array([True, False, False, False]), "program", findings)
    return findings.found


def test_the_checkers_run_between_the_stages(monkeypatch):
    import lmoc
    from lmoc.structure import reduce as module

    assemble = module.assemble
    monkeypatch.setattr(module, "assemble", lambda solved: replace(assemble(solved), rhs=()))
    with pytest.raises(CorruptStructureError, match="right-hand side does not compute"):
        lmoc.compile_text("model M Mass m(m = 1); end M;")
    monkeypatch.setenv("LMOC_CHECK", "0")
    lmoc.compile_text("model M Mass m(m = 1); end M;")
