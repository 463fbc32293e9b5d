"""Loops of rigid connections: consistent, contradictory, and such that only rest is possible."""

from __future__ import annotations

import re

import numpy as np
import pytest
from oracles.flat_builder import flat_model
from structure.test_normalize_aliases import reduced, way_back

import lmoc
from lmoc.expression.dag import slot
from lmoc.messages.diagnostics import ModelError, Report
from lmoc.structure.linear.derived import DerivedParameters
from lmoc.structure.normalize import normalize

RODS = """
parameter L1 = 2
parameter L2 = 2
parameter m.m = 1
parameter n.m = 3
input u
var m.q n.q
potential m.flange.q n.flange.q r.a.q r.b.q s.a.q s.b.q
flow m.flange.f n.flange.f r.a.f r.b.f s.a.f s.b.f
m.flange.q = m.q
m.m*der(der(m.q)) = m.flange.f
n.flange.q = n.q
n.m*der(der(n.q)) = n.flange.f
r.b.q = r.a.q + L1
r.a.f = -r.b.f
s.b.q = s.a.q + L2
s.a.f = -s.b.f
connect m.flange.q = r.a.q
connect m.flange.q = s.a.q
connect n.flange.q = r.b.q
connect n.flange.q = s.b.q
sum m.flange.f + r.a.f + s.a.f
sum n.flange.f + r.b.f + s.b.f - u
"""

GEARS = """
parameter a.N = 2
parameter b.N = 2
parameter i.J = 0.1
parameter j.J = 0.4
input u
var i.theta j.theta
potential i.shaft.theta j.shaft.theta a.a.theta a.b.theta b.a.theta b.b.theta
flow i.shaft.tau j.shaft.tau a.a.tau a.b.tau b.a.tau b.b.tau
i.shaft.theta = i.theta
i.J*der(der(i.theta)) = i.shaft.tau
j.shaft.theta = j.theta
j.J*der(der(j.theta)) = j.shaft.tau
a.a.theta = a.N*a.b.theta
a.b.tau = -a.N*a.a.tau
b.a.theta = b.N*b.b.theta
b.b.tau = -b.N*b.a.tau
connect i.shaft.theta = a.a.theta
connect i.shaft.theta = b.a.theta
connect j.shaft.theta = a.b.theta
connect j.shaft.theta = b.b.theta
sum i.shaft.tau + a.a.tau + b.a.tau - u
sum j.shaft.tau + a.b.tau + b.b.tau
"""

PULLEYS = """
parameter b.N = 2
potential p.a.q p.b.q p.c.q b.a.q b.b.q b.c.q
flow p.a.f p.b.f p.c.f b.a.f b.b.f b.c.f
var x y z
p.a.q + p.b.q = 2*p.c.q
p.a.f = p.b.f
p.c.f = -2*p.b.f
b.a.q + b.b.q = b.N*b.c.q
b.a.f = b.b.f
b.c.f = -b.N*b.b.f
connect x = p.a.q
connect x = b.a.q
connect y = p.b.q
connect y = b.b.q
connect z = p.c.q
connect z = b.c.q
der(der(x)) = p.a.f + b.a.f
der(der(y)) = p.b.f + b.b.f
der(der(z)) = p.c.f + b.c.f - 1
"""


def errors(text: str, **changed) -> str:
    with pytest.raises(ModelError) as caught:
        reduced(text, **changed)
    return str(caught.value)


def undetermined(n) -> set[str]:
    return {n.flat.variable_name(int(i)) for i in n.undetermined}


def is_square(n) -> bool:
    unknown = n.flat.kind == 3
    roots = {int(r) for r in n.root[unknown] if r < n.flat.count and n.flat.kind[r] == 3}
    return n.counts["after elimination"] == len(roots)


@pytest.mark.parametrize("text, loop", [(RODS, "rs"), (GEARS, "ab"), (PULLEYS, "pb")])
def test_consistent_loop_loses_one_equation_and_one_reaction(text, loop):
    n = reduced(text)
    (note,) = n.notes
    assert note.code == "N0415" and all(part in note.message for part in loop)
    assert is_square(n)
    ends = {v for v in undetermined(n)}
    assert ends and {v.split(".")[0] for v in ends} == set(loop)
    assert all(v.endswith((".f", ".tau")) for v in ends)


def test_single_rod_has_a_unique_force():
    text = RODS.replace("s.b.q = s.a.q + L2", "s.b.f = 0").replace("connect n.flange.q = s.b.q", "connect n.q = s.b.q")
    n = reduced(text)
    assert n.notes == () and len(n.undetermined) == 0 and is_square(n)


def test_rods_of_different_length_contradict():
    text = errors(RODS, L2=2.5)
    assert "E0411" in text and "r and s" in text and "r.b.q = r.a.q + L1" in text and "s.b.q = s.a.q + L2" in text


def test_roundoff_does_not_make_a_contradiction():
    n = reduced(RODS.replace("parameter L2 = 2", "parameter L2 = L1*0.1*3/0.3"))
    assert len(n.notes) == 1


def test_gears_of_different_ratio_allow_rest_only():
    text = errors(GEARS, **{"b.N": 2.001})
    assert "E0412" in text and "a and b" in text and "only rest" in text


def test_guard_of_a_loop_follows_the_parameters():
    n = reduced(GEARS)
    flat = n.flat
    a, b = (int(flat.find(x)[0]) for x in ("a.N", "b.N"))
    assert all(g.holds(flat.parameter_values({a: 3.0, b: 3.0})) for g in n.guards)
    broken = [g.text for g in n.guards if not g.holds(flat.parameter_values({a: 3.0}))]
    assert broken and "a.N" in broken[0] and "b.N" in broken[0]


def test_guard_of_a_pulley_loop():
    n = reduced(PULLEYS)
    assert all(g.holds(n.values) for g in n.guards)
    assert not all(g.holds(n.flat.parameter_values({0: 3.0})) for g in n.guards)


def test_pulleys_of_different_ratio_are_two_constraints():
    n = reduced(PULLEYS, **{"b.N": 3.0})
    assert n.notes == () and is_square(n)


def test_gear_loop_moves_as_one_pair_would():
    """θ̈1 from the remaining equations, all linear: J1·a + tau_a + tau_b = u, J2·a/2 = 2·(tau_a + tau_b)."""
    n = reduced(GEARS)
    jets: dict[tuple[int, int], int] = {}
    rows = []
    for g in n.groups:
        for row in g.slots.tolist():
            rows.append((g.residual, row))
    from lmoc.expression.calculus import linear_parts
    from lmoc.expression.dag import slots
    from lmoc.expression.evaluate import evaluate

    u, known = int(n.flat.find("u")[0]), n.all_values.copy()
    known[u] = 3.0
    matrix, right = np.zeros((len(rows), len(rows))), np.zeros(len(rows))
    for i, (shape, row) in enumerate(rows):
        unknown = [s for s in slots(shape) if row[s.value[0]] < n.flat.count and n.flat.kind[row[s.value[0]]] == 3]
        coefficients, rest = linear_parts(shape, unknown)
        for leaf, c in coefficients.items():
            j = jets.setdefault((row[leaf.value[0]], leaf.value[1]), len(jets))
            matrix[i, j] = evaluate(c, lambda k, _, row=row: known[row[k]])
        right[i] = -evaluate(rest, lambda k, _, row=row: known[row[k]])
    x = np.linalg.solve(matrix, right)
    root, _, factor, _ = way_back(n, "j.theta")
    alpha2 = factor * x[jets[int(n.flat.find(root)[0]), 2]]
    assert alpha2 == pytest.approx(2 * 3.0 / (4 * 0.1 + 0.4))


WALLS = """
parameter p.q0 = 1
parameter w.q0 = 3
parameter r.L = 2
potential p.q w.q r.a.q r.b.q
flow p.f w.f
var r.f
p.q = p.q0
w.q = w.q0
r.b.q = r.a.q + r.L
connect p.q = r.a.q
connect w.q = r.b.q
r.f = p.f
w.f = -r.f
"""


def test_rod_between_walls():
    n = reduced(WALLS)
    assert n.notes[0].code == "N0415" and undetermined(n) == {"r.f", "p.f", "w.f"} and is_square(n)
    message = errors(WALLS, **{"r.L": 2.5})
    assert "E0411" in message and all(f"{part}" in message.split("\n")[0] for part in "prw")


def test_motion_prescribed_twice():
    text = "input u\nvar q\npotential a.q b.q\na.q = u\nb.q = 1\nconnect q = a.q\nconnect q = b.q"
    assert "E0413" in errors(text)


def test_plain_algebra_with_two_ratios_is_solved():
    n = reduced("var x y z\nx = y\nx = 2*y - 3\nder(z) = x - z")
    assert way_back(n, "x") == ("", 0, 0.0, pytest.approx(3.0))


def test_rack_between_pinions_leaves_the_axle_at_rest():
    """a = -b by a pinion; a pulley between them holds its axle: no loop, but a value."""
    n = reduced("potential p.a p.b p.c\nvar x\np.a + p.b = 2*p.c\np.a = -p.b\np.a = x\nder(x) = x")
    assert way_back(n, "p.c") == ("", 0, 0.0, 0.0) and n.notes == ()


def test_spring_to_the_ground_does_not_hide_a_loop():
    """Its force is k·x: the coordinate stands for a flow, too, and stays a coordinate."""
    text = PULLEYS.replace("der(der(x)) = p.a.f + b.a.f", "der(der(x)) = p.a.f + b.a.f - s.f\ns.f = 3*x")
    n = reduced("flow s.f\n" + text)
    assert len(n.notes) == 1 and is_square(n)


def test_power_of_an_undetermined_force_does_not_hide_it():
    n = reduced(RODS + "\nvar power total\npower = r.b.f*der(n.q)\ntotal = power + m.q**2")
    assert {"r.a.f", "r.b.f", "s.a.f", "s.b.f"} <= undetermined(n) and is_square(n)


def test_constant_equation_that_cannot_hold():
    flat = flat_model("parameter p = 2\nvar x\np = 3\nder(x) = x")
    with pytest.raises(ModelError, match="E0411"):
        normalize(flat, flat.parameter_values(), None, Report())


TRIANGLE = """
parameter r.L = 1
parameter s.L = 2
parameter t.L = 3
parameter o.L = 4
var A.q B.q C.q D.q
potential r.a.q r.b.q s.a.q s.b.q t.a.q t.b.q o.a.q o.b.q
flow A.f B.f C.f D.f r.a.f r.b.f s.a.f s.b.f t.a.f t.b.f o.a.f o.b.f
r.b.q = r.a.q + r.L
r.a.f = -r.b.f
s.b.q = s.a.q + s.L
s.a.f = -s.b.f
t.b.q = t.a.q + t.L
t.a.f = -t.b.f
o.b.q = o.a.q + o.L
o.a.f = -o.b.f
der(der(A.q)) = A.f
der(der(B.q)) = B.f
2*der(der(C.q)) = C.f
3*der(der(D.q)) = D.f
connect A.q = r.a.q
connect A.q = t.a.q
connect B.q = r.b.q
connect B.q = s.a.q
connect C.q = s.b.q
connect C.q = t.b.q
connect C.q = o.a.q
connect D.q = o.b.q
sum A.f + r.a.f + t.a.f
sum B.f + r.b.f + s.a.f
sum C.f + s.b.f + t.b.f + o.a.f
sum D.f + o.b.f
"""


def test_only_the_forces_inside_the_loop_are_undetermined():
    n = reduced(TRIANGLE)
    assert {v.split(".")[0] for v in undetermined(n)} == {"r", "s", "t"} and is_square(n)
    assert {"r", "s", "t"} <= set(n.notes[0].message.replace(",", "").split())
    assert "E0411" in errors(TRIANGLE, **{"t.L": 3.5})


def test_pulleys_that_contradict():
    text = PULLEYS.replace("b.a.q + b.b.q = b.N*b.c.q", "b.a.q + b.b.q = b.N*b.c.q + 1")
    message = errors(text)
    assert "E0411" in message and "p" in message and "b.a.q + b.b.q = b.N*b.c.q + 1" in message


def test_parameters_without_values_are_taken_to_agree():
    n = reduced(GEARS.replace("a.N = 2", "a.N").replace("b.N = 2", "b.N"))
    assert n.notes[0].code == "N0415" and is_square(n)


def test_ten_loops_lose_ten_reactions():
    lines = [line for line in TRIANGLE.split("\n") if line]
    text = "\n".join(re.sub(r"\b([ABCDrsto])\.", rf"\g<1>{k}.", line) for k in range(10) for line in lines)
    n = reduced(text)
    assert len([r for g in n.groups if g.residual.op == "slot" for r in g.source]) == 10 and is_square(n)
    assert n.notes[-1].hint == "7 more constraints are redundant"


def test_a_force_on_a_massless_rod():
    text = "flow p.f r.a.f r.b.f\nvar p.size\np.f = -p.size\np.size = 2\nr.a.f = -r.b.f\nr.b.f = 0\nsum p.f + r.a.f"
    message = errors(text)
    assert "E0416" in message and "nothing takes the force" in message and "p" in message.split("\n")[0]


def test_a_long_rigid_train_of_gears():
    """What is assumed of it is told in few words, though its ratio is a product of a hundred numbers."""
    n = 120
    dae = lmoc.compile_text(f"""
        model Train
          Torque drive(tau = 6);
          Inertia j[{n}](each J = 0.1);
          Gear g[{n} - 1](N = {{if mod(i, 2) == 0 then 0.5 else 2 for i in 1:{n} - 1}});
        equation
          connect(drive.shaft, j[1].shaft);
          for i in 1:{n} - 1 loop
            connect(j[i].shaft, g[i].a);
            connect(g[i].b, j[i + 1].shaft);
          end for;
        end Train;""")
    assert max(len(g.text) for g in dae.reduced.guards) < 3000
    # half of the shafts turn as fast as the first, half of them half as fast
    alpha = 6 / (n / 2 * 0.1 * (1 + 0.25))
    assert dae.simulate(times=[0.0])["j[1].alpha"][0] == pytest.approx(alpha)


def test_sizes_are_kept_up_to_date():
    derived = DerivedParameters(np.array([3.0, -4.0, 0.5]))
    a = derived.define(slot(0) + slot(1), np.array([[0, 1]]))
    derived.define(slot(0) * slot(1), np.stack([a, [2]], axis=1))
    for i in range(100):
        derived.define(slot(0) * (i + 2.0), np.array([[0]]))
    assert derived.sizes(derived.known, np.arange(5)) == pytest.approx([3, 4, 0.5, 7, 3.5])
    every = np.arange(derived.count)
    np.testing.assert_array_equal(derived.sizes(derived.known, every), derived.sizes(derived.known.copy(), every))
