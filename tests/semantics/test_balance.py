"""As many equations as unknowns, part by part; the energy ledger."""

import numpy as np
from oracles.flattening import codes, equations, flat, mistakes

from lmoc.ir.flat import Kind


def test_too_few_equations_are_named_at_the_class() -> None:
    (error,) = mistakes("""
model Brake
  Flange a;
  Real f;
  Real slip;
equation
  a.f = f;
end Brake;
model A Brake b[3]; Fixed w; equation for i in 1:3 loop connect(b[i].a, w.flange); end for; end A;""")
    assert error.code == "E0307" and error.span.line == 2
    assert "4 unknowns but 2 equations" in error.message
    assert "'slip'" in error.hint


def test_too_many_equations() -> None:
    (error,) = mistakes("model A Real x; equation x = 1; der(x) = 2; end A;")
    assert error.code == "E0307" and "1 unknown but 2 equations" in error.message


def test_each_class_is_reported_once_and_assemblies_are_counted_without_their_parts() -> None:
    found = mistakes("""
        model Bad Flange p; equation p.q = 1; p.f = 2; end Bad;
        model Two Bad x, y; Flange p; equation connect(p, x.p); end Two;
        model A Two t; Bad b; Fixed w; equation connect(t.p, w.flange); end A;""")
    assert [("Bad" in e.message, e.code) for e in found] == [(True, "E0307")]


def test_an_assembly_is_balanced_through_its_connections() -> None:
    dae = flat("""
        model Two Flange a, b; Spring s(k = 1); Damper d(c = 1); Real x = s.f;
        equation connect(a, s.a); connect(a, d.a); connect(s.b, b); connect(d.b, b); end Two;
        model A Two t[4]; Mass m[4](each m = 1); equation connect(t.b, m.flange); end A;""")
    assert dae.equation_count == np.count_nonzero(dae.kind == Kind.UNKNOWN)


def test_an_assembly_that_leaves_its_port_open() -> None:
    assert codes("""
        model Two Flange a, b; Spring s(k = 1); equation connect(a, s.a); end Two;
        model A Two t; Mass m(m = 1); equation connect(t.b, m.flange); end A;""") == ["E0307"]


def test_inputs_must_be_given() -> None:
    (error,) = mistakes("model A Force f; Mass m(m = 1); equation connect(f.flange, m.flange); end A;")
    assert error.code == "E0310" and "'f.f'" in error.message
    flat("model A Force f(f = 1); Mass m(m = 1); equation connect(f.flange, m.flange); end A;")
    flat("model A Force f; Mass m(m = 1); equation connect(f.flange, m.flange); f.f = sin(time); end A;")


def test_signals_between_blocks_are_balanced() -> None:
    text = """
        block Gain input Real u; output Real y; equation y = 2*u; end Gain;
        model A Gain a, b; equation %s a.u = time; end A;"""
    flat(text % "b.u = a.y;", library=False)
    assert codes(text % "b.u = a.y; b.y = 1;") == ["E0307"]
    assert codes(text % "") == ["E0310"]


def test_connectors_have_as_many_flows_as_potentials() -> None:
    (error,) = mistakes("""connector P Real a; Real b; flow Real c; end P;
        model B P p; equation p.a = 1; p.b = 2; end B; model A B b, c; equation connect(b.p, c.p); end A;""")
    assert error.code == "E0308" and "2 potentials but 1 flow" in error.message


# ------------------------------------------------------------------------ the ledger


def ledger_sums(dae) -> list[str]:
    return [t for t in (dae.sum_text(i) for i in range(dae.sums.rows)) if "ledger" in t]


def test_the_ledger_collects_what_the_parts_state() -> None:
    dae = flat("""model A Fixed w; Spring s(k = 1); Damper d(c = 1); Mass m[2](each m = 1); Force f(f = 1);
      equation
        connect(w.flange, s.a); connect(w.flange, d.a); connect(s.b, m[1].flange); connect(d.b, m[2].flange);
        connect(f.flange, m[2].flange); end A;""")
    assert ledger_sums(dae) == [
        "s.energy + m[1].energy + m[2].energy - ledger.stored = 0",
        "d.loss - ledger.lost = 0",
        "f.power - ledger.supplied = 0",
    ]
    assert equations(dae, "ledger") == ["der(ledger.work) = ledger.supplied", "der(ledger.heat) = ledger.lost"]


def test_a_part_that_states_nothing_delivers_what_comes_out_of_its_ports() -> None:
    dae = flat("""
        model Wind Flange flange; equation flange.f = -time; end Wind;
        model Actuator Flange a, b; equation a.f = time; a.f + b.f = 0; end Actuator;
        model A Wind w[2]; Actuator x; Mass m[3](each m = 1);
      equation connect(w.flange, m[1:2].flange); connect(x.a, m[2].flange); connect(x.b, m[3].flange); end A;""")
    assert equations(dae, "ledger")[:3] == [
        "w[1].power = -w[1].flange.f*der(w[1].flange.q)",
        "w[2].power = -w[2].flange.f*der(w[2].flange.q)",
        "x.power = -x.a.f*der(x.a.q) - x.b.f*der(x.b.q)",
    ]
    assert "w[1].power + w[2].power + x.power - ledger.supplied = 0" in ledger_sums(dae)
    assert dae.find("w[2].power") is not None


def test_a_pair_whose_units_make_no_power_adds_nothing() -> None:
    dae = flat("""connector P Real p(unit = "Pa"); flow Real m(unit = "kg/s"); end P;
        connector Q Real p(unit = "Pa"); flow Real v(unit = "m3/s"); end Q;
        model Pump P a, b; Q c; equation a.m = 1; a.m + b.m = 0; c.v = 2; end Pump;
        model Pool P a; equation a.p = 1; end Pool; model Tank Q c; equation c.p = 3; end Tank;
        model A Pump pump; Pool x, y; Tank z;
      equation connect(pump.a, x.a); connect(pump.b, y.a); connect(pump.c, z.c); end A;""")
    assert equations(dae, "ledger")[:2] == ["pump.power = -pump.c.v*pump.c.p", "x.power = 0"]


def test_assemblies_are_not_counted_twice() -> None:
    dae = flat("""
        model Two Flange a; Real energy = m.energy; Mass m(m = 1); equation connect(a, m.flange); end Two;
        model A Two t; Force f(f = 1); equation connect(t.a, f.flange); end A;""")
    assert "t.m.energy - ledger.stored = 0" in ledger_sums(dae)
    assert [p.leaf for p in dae.parts] == [False, False, True, True]


def test_the_table_of_parts() -> None:
    dae = flat(
        """model A Spring s[3](each k = 1) "a row"; Fixed w;
        equation for i in 1:3 loop connect(s[i].a, w.flange); end for; end A;"""
    )
    root, spring, wall = dae.parts
    assert (root.leaf, spring.leaf, spring.class_name, spring.description) == (False, True, "Spring", "a row")
    assert [tuple(dae.blocks[k].pattern for k in pair) for pair in spring.ports] == [
        ("s[1:3].a.q", "s[1:3].a.f"), ("s[1:3].b.q", "s[1:3].b.f"),
    ]  # fmt: skip


def test_a_chain_has_as_many_groups_whatever_its_length() -> None:
    text = """model Chain
        parameter Integer N = 3; Fixed wall;
        Mass m[N](m = {1 + 0.1*i for i in 1:N}); Spring s[N](each k = 10); Damper d[N](each c = 1);
      equation
        connect(wall.flange, s[1].a); connect(wall.flange, d[1].a);
        for i in 1:N - 1 loop connect(m[i].flange, s[i + 1].a); connect(m[i].flange, d[i + 1].a); end for;
        for i in 1:N loop connect(s[i].b, m[i].flange); connect(d[i].b, m[i].flange); end for;
      end Chain;"""
    small, large = flat(text, N=20), flat(text, N=50_000)
    assert len(small.groups) == len(large.groups) < 30
    assert len(small.blocks) == len(large.blocks)
    unknowns = [int(np.sum(d.kind == Kind.UNKNOWN)) for d in (small, large)]
    assert unknowns == [small.equation_count, large.equation_count]
    assert large.parameter_values()[large.find("m[50000].m")] == [1 + 0.1 * 50_000]
    # the long model is the short one, only longer: the same equations up to the last mass
    assert large.row_text(large.groups[5], 7) == small.row_text(small.groups[5], 7)
    assert "m[20].flange.f + s[20].b.f + d[20].b.f = 0" in [small.sum_text(i) for i in range(small.sums.rows)]


def test_a_value_for_a_variable_of_a_part_is_an_equation_too_many() -> None:
    (error,) = mistakes("model A Mass m(m = 1, v = 3); end A;")
    assert error.code == "E0307" and "'Mass' has 6 unknowns but 7 equations" in error.message
    assert error.span.text == "3" and "'v(start = 3, fixed = true)'" in error.hint
