"""The switched form of laws: relative degrees, and one reduction whose modes are values."""

import numpy as np
import pytest
from oracles.flattening import flat
from oracles.lawful import reduced_of

from lmoc.ir.flat import Kind
from lmoc.ir.law import JENKINS, NONE
from lmoc.messages.diagnostics import ModelError, Report
from lmoc.structure.laws.degree import NOT_FELT, relative_degree
from lmoc.structure.laws.switched import free, switched
from lmoc.structure.reduce import reduce

STRING = """
model String Fixed c; Spring s(k = 100); Mass m1(m = 1, g = 9.81), m2(m = 2, g = 9.81); Cable t(L = 0.5);
equation connect(c.flange, s.a); connect(s.b, m1.flange); connect(m1.flange, t.a); connect(t.b, m2.flange); end String;
"""
SPRING_ENDS = """
model Ends Fixed w, x, axle; Mass m(m = 2); Spring k(k = 50), k2(k = 30); StringPulley p;
equation connect(w.flange, k.a); connect(k.b, m.flange); connect(m.flange, p.a); connect(p.b, k2.a);
  connect(k2.b, x.flange); connect(p.axle, axle.flange); end Ends;
"""
DAMPED_END = """
model Damped Fixed w; Mass m(m = 2); Damper c(c = 3); Stop stop(L = 0.1);
equation connect(m.flange, c.b); connect(c.a, stop.b); connect(w.flange, stop.a); end Damped;
"""
FRICTION = """
model Belt Fixed w; Mass m(m = 1); Spring k(k = 50); DryFriction f(F = 2, Fstick = 4);
equation connect(w.flange, k.a); connect(k.b, m.flange); connect(w.flange, f.a); connect(f.b, m.flange); end Belt;
"""


def degrees(text):
    loose, places = free(flat(text))
    return relative_degree(places, reduce(loose, report=Report()))


@pytest.mark.parametrize("text, degree", [(STRING, 2), (SPRING_ENDS, 0), (DAMPED_END, 1), (FRICTION, 2)])
def test_relative_degrees(text, degree):
    assert degrees(text).tolist() == [degree]


def test_a_force_between_fixed_ends_is_not_felt():
    text = """model M Fixed a, b(q0 = 1); Cable t(L = 2); Mass m(m = 1);
        equation connect(a.flange, t.a); connect(t.b, b.flange); end M;"""
    assert degrees(text).tolist() == [NOT_FELT]


def test_a_force_that_is_not_felt_is_an_error():
    text = """model M Fixed a, b(q0 = 1); Cable t(L = 2); Mass m(m = 1);
        equation connect(a.flange, t.a); connect(t.b, b.flange); end M;"""
    with pytest.raises(ModelError, match="'t.f' of a law does not act on its own motion 't.gap'"):
        reduced_of(text)


def test_the_extension_of_a_spring_in_series_with_friction_is_a_state():
    text = """model M Fixed w; Mass m(m = 1); Spring k(k = 10); DryFriction f(F = 2);
        equation connect(m.flange, k.a); connect(k.b, f.b); connect(w.flange, f.a); end M;"""
    reduced = reduced_of(text)
    assert degrees(text).tolist() == reduced.switched.degree.tolist() == [JENKINS]
    assert reduced.state_names == ["m.q", "m.v", "k.extension"]


def test_the_switched_form_has_the_states_of_the_free_scene():
    reduced = reduced_of(STRING)
    places, flat_ = reduced.switched, reduced.flat
    assert reduced.state_names == ["m1.q", "m1.v", "m2.q", "m2.v"]
    assert flat_.kind[places.closed].tolist() == [Kind.INPUT] and places.direction.tolist() == [NONE]
    assert flat_.laws == () and flat_.equation_count == np.count_nonzero(flat_.kind == Kind.UNKNOWN)


def test_modes_of_many_laws_are_one_reduction():
    text = """model Train Mass m[N](each m = 1); Cable c[N - 1](each L = 0.1); parameter Integer N = %d;
        equation for i in 1:N-1 loop
          connect(m[i].flange, c[i].a); connect(c[i].b, m[i+1].flange); end for; end Train;"""
    short, long = (switched(flat(text % n), np.full(n - 1, 2)) for n in (5, 50))
    assert len(short[0].groups) == len(long[0].groups) and long[1].count == 49
