"""Connection sets: inside and outside, potentials, flows, signals, what is unconnected."""

import numpy as np
import pytest
from oracles.flattening import codes, equations, flat, mistakes, sums

from lmoc.semantics.connections.components import components

PIN = """
connector Pin Real v; flow Real i; end Pin;
model Resistor Pin p, n; parameter Real R = 1; equation p.v - n.v = R*p.i; p.i + n.i = 0; end Resistor;
model Ground Pin p; equation p.v = 0; end Ground;
"""


def pins(text: str):
    return flat(PIN + text, library=False)


def test_a_set_of_three() -> None:
    dae = pins(
        "model A Resistor a, b; Ground g; equation connect(a.p, g.p); connect(b.p, g.p); connect(a.n, b.n); end A;"
    )
    assert equations(dae, "connection") == ["g.p.v = a.p.v", "b.p.v = a.p.v", "b.n.v = a.n.v"]
    assert sums(dae) == ["a.p.i + b.p.i + g.p.i = 0", "a.n.i + b.n.i = 0"]


def test_connecting_twice_or_in_a_circle_changes_nothing() -> None:
    ring = "connect(a.p, b.p); connect(b.p, g.p); connect(g.p, a.p); connect(a.p, b.p); connect(a.n, b.n);"
    dae = pins(f"model A Resistor a, b; Ground g; equation {ring} end A;")
    assert len(equations(dae, "connection")) == 3
    assert len(sums(dae)) == 2


def test_an_assembly_passes_flows_on() -> None:
    dae = pins("""
        model Two Pin p, n; Resistor a, b; equation connect(p, a.p); connect(a.n, b.p); connect(b.n, n); end Two;
        model A Two t; Ground g; Resistor r;
        equation connect(t.p, g.p); connect(t.n, r.p); connect(r.n, g.p); end A;""")
    assert "t.a.p.i - t.p.i = 0" in sums(dae)
    assert "t.p.i + g.p.i + r.n.i = 0" in sums(dae)
    assert dae.equation_count == sum(b.size for b in dae.blocks if b.kind == 3)


def test_what_is_not_connected_carries_no_flow_and_is_warned_of() -> None:
    dae = pins("model A Resistor r; Ground g; equation connect(r.p, g.p); end A;")
    assert equations(dae, "unconnected") == ["r.n.i = 0"]
    (note,) = dae.notes
    assert note.code == "W0312" and "'r.n'" in note.message


def test_unconnected_elements_of_an_array() -> None:
    dae = flat("model A Mass m[5](each m = 1); Fixed w; equation connect(m[2].flange, w.flange); end A;")
    assert equations(dae, "unconnected") == [f"m[{i}].flange.f = 0" for i in (1, 3, 4, 5)]
    (note,) = dae.notes
    assert "m[1].flange" in note.message and "3 more" in note.message


def test_ports_of_the_model_itself() -> None:
    dae = pins("model A Pin p; Resistor r; Ground g; equation connect(p, r.p); connect(r.n, g.p); end A;")
    assert equations(dae, "unconnected") == ["p.i = 0"]
    assert dae.equation_count == sum(b.size for b in dae.blocks if b.kind == 3)


def test_nested_connectors_and_arrays_in_connectors() -> None:
    dae = flat(
        """connector Pin Real v[2]; flow Real i[2]; end Pin;
        connector Plug Pin a; Pin b[2]; end Plug;
        model P Plug plug; equation plug.a.v = {1, 2}; plug.b.v = {{1, 2}, {3, 4}}; end P;
        model Q Plug plug; equation plug.a.i = {0, 0}; plug.b.i = zeros(2, 2); end Q;
        model A P p[2]; Q q[2]; equation connect(p.plug, q.plug); end A;""",
        library=False,
    )
    assert "q[2].plug.b[2].v[1] = p[2].plug.b[2].v[1]" in equations(dae, "connection")
    assert len(equations(dae, "connection")) == 12
    assert "p[1].plug.a.i[2] + q[1].plug.a.i[2] = 0" in sums(dae)


def test_signals() -> None:
    dae = flat(
        """connector RealInput = input Real; connector RealOutput = output Real;
        block Gain RealInput u; RealOutput y; parameter Real k = 2; equation y = k*u; end Gain;
        block Source output Real y = time; end Source;
        model A Source s; Gain a, b; output Real z;
        equation connect(s.y, a.u); connect(a.y, b.u); connect(b.y, z); end A;""",
        library=False,
    )
    assert equations(dae, "connection") == ["a.u = s.y", "b.u = a.y", "z = b.y"]


def test_an_input_at_the_top_drives_parts() -> None:
    dae = flat("""model A input Real u; Force f[2]; Mass m[2](each m = 1);
        equation connect(f.flange, m.flange); connect(u, f[1].f); f[2].f = 2*u; end A;""")
    assert "f[1].f = u" in equations(dae)


def test_connectors_of_different_kinds() -> None:
    (error,) = mistakes("model A Mass m(m = 1); Inertia j(J = 1); equation connect(m.flange, j.shaft); end A;")
    assert error.code == "E0306"
    assert (error.expected, error.found) == ("Flange", "Shaft")


def test_what_is_no_connector() -> None:
    assert codes("model A Mass m(m = 1); Spring s(k = 1); equation connect(m, s.a); end A;") == ["E0305"]
    assert codes("model A Mass m(m = 1); Real x = 1; equation connect(m.flange, x); end A;") == ["E0305"]


def test_a_connect_reaches_one_part_deep() -> None:
    found = codes("""model B Mass m(m = 1); end B;
        model A B b; Fixed w; equation connect(b.m.flange, w.flange); end A;""")
    assert found == ["E0313"]


def test_components_are_those_of_scipy() -> None:
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    random = np.random.default_rng(1)
    for _ in range(20):
        left, right = random.integers(0, 40, (2, 25))
        nodes, label, _, _ = components(left, right)
        count, other = connected_components(coo_matrix((np.ones(25), (left, right)), shape=(40, 40)), directed=False)
        assert (
            len(set(zip(label.tolist(), other[nodes].tolist()))) == label.max() + 1 == len(set(other[nodes].tolist()))
        )


@pytest.mark.parametrize("sizes", [("2", "3")])
def test_arrays_of_connectors_must_fit(sizes) -> None:
    a, b = sizes
    assert codes(f"model A Mass m[{a}](each m = 1); Fixed w[{b}]; equation connect(m.flange, w.flange); end A;") == [
        "E0302"
    ]


@pytest.mark.parametrize("supported", ["false", "true"])
def test_a_protected_connector_belongs_to_its_class(supported: str) -> None:
    """The way in which Modelica's own library lets parts react on a housing or on the ground."""
    dae = flat(
        """
        connector F Real s; flow Real f; end F;
        model Ground F flange; equation flange.s = 0; end Ground;
        partial model Supported
          parameter Boolean useSupport = false; Real length; F flange; F support if useSupport;
        protected
          F inner_support(f = -flange.f); Ground ground if not useSupport;
        equation
          length = flange.s - inner_support.s;
          connect(inner_support, support); connect(ground.flange, inner_support);
        end Supported;
        model Pull extends Supported; equation flange.f = -time; end Pull;
        model Hold F a; equation a.s = 1; end Hold;
        model A parameter Boolean held = HELD; Pull p(useSupport = held); Hold h; Hold g if held;
        equation connect(p.flange, h.a); connect(p.support, g.a); end A;
        """.replace("HELD", supported),
        library=False,
    )
    assert "p.inner_support.f = -p.flange.f" in equations(dae)
    balance = {"true": "p.support.f + g.a.f = 0", "false": "p.ground.flange.f - p.inner_support.f = 0"}
    assert balance[supported] in sums(dae)
    assert not equations(dae, "unconnected") and not dae.notes
