"""The models of the lecture notes, derived by the compiler, against the reference expressions: equal in symbols."""

from functools import cache

import pytest
import sympy as sp
from oracles import models
from oracles.symbolic_truth import NOTES, ROOT, TRUTH, by_hand, equal, matrix, names_of, proportional, read

import lmoc
from lmoc.symbolic.linearize import linearize
from lmoc.symbolic.system import jet_symbol
from lmoc.symbolic.transfer import characteristic_polynomial

LINEAR = [name for name, truth in TRUTH.items() if "linear" in truth]
every_system = pytest.mark.parametrize("name", TRUTH)
every_linear = pytest.mark.parametrize("name", LINEAR)


def compiled(name: str) -> lmoc.DAE:
    return models.compiled(ROOT / "models/notes" / NOTES[name]["file"])


@cache
def derived(name: str):
    """The symbolic system of the model, and its states in the names of the notes."""
    system = compiled(name).symbolic()
    to_notes = {system.outputs[x]: sp.Symbol(x) for x in TRUTH[name]["states"]}
    assert set(to_notes) == set(system.states), "a state is no coordinate of the notes, nor its velocity"
    return system, to_notes


@every_system
def test_first_order_equations(name):
    system, to_notes = derived(name)
    for state, rate in zip(system.states, system.derivatives, strict=True):
        expected = read(name, TRUTH[name]["eom"][f"der({to_notes[state].name})"])
        assert equal(rate.xreplace(to_notes), expected)


@every_system
def test_parameters_are_those_of_the_notes(name):
    system, _ = derived(name)
    assert {p.name for p in system.parameters} <= set(TRUTH[name]["parameters"])


@every_system
def test_equations_of_motion(name):
    """Lagrange's equations of the notes' coordinates, up to a factor each."""
    _, to_notes = derived(name)
    found = compiled(name).equations()
    names = {}
    for q in TRUTH[name]["coordinates"]:
        names |= {q: sp.Symbol(q), "v_" + q: jet_symbol(q, 1), "a_" + q: jet_symbol(q, 2)}
    rename = {
        jet_symbol(e.coordinate.name, n): jet_symbol(to_notes[e.coordinate].name, n)
        for e in found.equations
        for n in range(3)
    }
    for equation in found.equations:
        q = to_notes[equation.coordinate].name
        expected = read(name, TRUTH[name]["second_order"][q].removesuffix(" = 0"), names)
        residual = equation.residual.xreplace(rename)
        highest = jet_symbol(q, equation.order)
        factor = residual.diff(highest) / expected.diff(highest)
        assert not factor.free_symbols & {s for n in range(3) for s in (jet_symbol(q, n),)}
        assert equal(residual, factor * expected)


@every_linear
def test_linear_model(name):
    system, to_notes = derived(name)
    truth = TRUTH[name]
    model = linearize(system, symbolic=True, outputs={y: system.outputs[y] for y in truth["outputs"]})
    order = [list(to_notes.values()).index(sp.Symbol(x)) for x in truth["states"]]
    order = [list(system.states).index(list(to_notes)[i]) for i in order]
    columns = [list(model.inputs).index(u) for u in truth["inputs"]]
    linear = {key: matrix(name, rows) for key, rows in truth["linear"].items()}
    assert equal(model.A.extract(order, order), linear["A"])
    assert equal(model.C.extract(list(range(len(truth["outputs"]))), order), linear["C"])
    if columns:
        assert equal(model.B.extract(order, columns), linear["B"])
        assert equal(model.D.extract(list(range(len(truth["outputs"]))), columns), linear["D"])
    for found, key in ((model.Bd, "Bd"), (model.Dd, "Dd")):
        expected = linear[key]
        assert (found is not None) == any(expected)


@every_linear
def test_characteristic_polynomial(name):
    system, _ = derived(name)
    found = characteristic_polynomial(linearize(system, symbolic=True))
    assert proportional(found, read(name, TRUTH[name]["characteristic"]))


@pytest.mark.parametrize(("name", "pair"), [(n, pair) for n in LINEAR for pair in TRUTH[n]["transfer"]])
def test_transfer_function(name, pair):
    y, _, u = pair.partition("/")
    assert equal(compiled(name).transfer_function(u, y), read(name, TRUTH[name]["transfer"][pair]))


@every_linear
def test_equilibria(name):
    _, to_notes = derived(name)
    found, expected = compiled(name).equilibria(), TRUTH[name]["equilibrium"]
    assert len(found) == 1
    if isinstance(expected, str) or len(expected[0]) < len(TRUTH[name]["states"]):
        assert found[0].free and found[0].conditions
    else:
        by_note = {to_notes[state].name: value for state, value in found[0].values.items()}
        assert all(equal(by_note[state], read(name, text)) for state, text in expected[0].items())


def test_printed_as_in_the_notes():
    printed = {name: compiled(name).equations().lines() for name in ("Ex2", "Ex8", "Ex9", "S7.1s", "Ex4")}
    assert printed["Ex2"] == ["m·q̈ + c·q̇ + k·q = f"]
    assert printed["Ex8"] == ["(J + m·r²)·θ̈ + c·θ̇ + k·r²·θ = r·f + g·m·r"]
    assert printed["Ex9"] == ["(J1·N² + J2)·θ̈1 + c·θ̇1 + k·θ1 = N²·u"]
    assert printed["S7.1s"] == ["m·q̈ + k1·k2/(k1 + k2)·q = f"]
    assert len(printed["Ex4"]) == 2


def test_cubic_spring_stays_factored():
    (line,) = compiled("S3.1-cubic").equations().lines()
    assert line == "m·q̈2 + k·(q2 + L - d0)³ = f"


def test_large_angle_lever_stays_compact():
    (line,) = compiled("S9-nl").equations().lines()
    assert line == "J·θ̈ + c·l1²·cos²(θ)·θ̇ + k·l2²·cos(θ)·sin(θ) = τ"


def test_gravity_disappears_in_deviations_from_the_equilibrium():
    dae = compiled("Ex5")
    (rest,) = dae.equilibria(inputs={"u": 0})
    moved = dae.equations().about(rest)
    assert not any("g" in {s.name for s in e.residual.free_symbols} for e in moved.equations)


@pytest.mark.parametrize("name", TRUTH)
def test_not_longer_than_by_hand(name):
    """Operations of the printed equations against those of the reference, both as they stand."""
    names = names_of(name) | {f"a_{q}": jet_symbol(q, 2) for q in TRUTH[name]["coordinates"]}
    by_reference = [read(name, t.removesuffix(" = 0"), names) for t in TRUTH[name]["second_order"].values()]
    assert compiled(name).equations().operation_count <= sum(sp.count_ops(e) for e in by_reference) + 3


def test_contact_force_between_gears():
    forces = compiled("S8").equations(forces=True).forces
    (value,) = forces.values()
    accelerations = {jet_symbol("gear2.theta", 2): by_hand("S8").derivatives[1]}
    expected = by_hand("S8").outputs["F"]
    assert equal(value.xreplace(accelerations), expected)


def test_the_page_counts_operations_of_the_shortest_forms_by_hand():
    """``m·a + k·(q + L - d0)³ = f`` has 6; nowhere do lmoc and a person differ by much."""
    rows = [line.split("|") for line in (ROOT / "docs/notes.md").read_text().splitlines() if line.startswith("| [")]
    counts = {row[1].partition("]")[0].strip(" ["): (int(row[-3]), int(row[-2])) for row in rows}
    assert counts[NOTES["S3.1-cubic"]["title"]] == (6, 6)
    assert len(counts) == len(NOTES) and all(abs(ours - theirs) <= 2 for ours, theirs in counts.values())
