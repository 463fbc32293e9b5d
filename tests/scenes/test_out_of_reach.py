"""Loops that cannot be closed: told by lengths and distances, in every verb."""

import numpy as np
import pytest

import lmoc
from lmoc.messages.diagnostics import ModelError

RODS = """model Rods
  import Planar.*;
  inner World world;
  Anchor left, right(x = {apart});
  Rod rod1(L = {one}), rod2(L = {two});
  PointMass mass(m = 1, x(start = 0.4), y(start = -0.9));
equation
  connect(left.point, rod1.a); connect(rod1.b, mass.point);
  connect(mass.point, rod2.a); connect(rod2.b, right.point);
end Rods;"""
BARS = """model Bars "a chain of bars on pins from one fixed point to another"
  import Planar.*;
  inner World world;
  Ground left, right(x = {apart});
  Revolute pin0, last; {pins}
  {bars}
equation
  connect(left.frame, pin0.a); {between} connect(bar{n}.b, last.a); connect(last.b, right.frame);
end Bars;"""
SLIDER = """model Slider
  import Planar.*;
  inner World world(g = 0);
  Ground g, line(y = {aside});
  Revolute A(phi(start = 0.7)), B, C;
  Bar crank(l = 0.3, m = 1), rod(l = 0.8, m = 1);
  Prismatic guide;
  Body slider(m = 1, J = 1);
equation
  connect(g.frame, A.a); connect(A.b, crank.a); connect(crank.b, B.a); connect(B.b, rod.a);
  connect(rod.b, C.a); connect(C.b, guide.b); connect(guide.a, line.frame); connect(guide.b, slider.frame);
end Slider;"""
FOURBAR = """model Fourbar
  import Planar.*;
  inner World world(g = 0);
  Ground g1, g2(x = 1);
  Revolute A(phi(start = {angle}, fixed = true), omega(start = 1, fixed = true)), B, C, D;
  Bar a(l = 1, m = 1), b(l = {coupler}, m = 1), c(l = 0.6, m = 1);
equation
  connect(g1.frame, A.a); connect(A.b, a.a); connect(a.b, B.a); connect(B.b, b.a); connect(b.b, C.a);
  connect(C.b, c.b); connect(c.a, D.b); connect(D.a, g2.frame);
end Fourbar;"""


def chain(lengths: list[float], apart: float) -> str:
    n = len(lengths)
    pins = f"Revolute {', '.join(f'pin{k}' for k in range(1, n))};"
    bars = f"Bar {', '.join(f'bar{k + 1}(l = {length}, m = 1)' for k, length in enumerate(lengths))};"
    between = "connect(pin0.b, bar1.a); "
    between += " ".join(f"connect(bar{k}.b, pin{k}.a); connect(pin{k}.b, bar{k + 1}.a);" for k in range(1, n))
    return BARS.format(apart=apart, pins=pins, bars=bars, between=between, n=n)


def told(text: str) -> str:
    with pytest.raises(ModelError) as wrong:
        lmoc.compile_text(text).simulate(stop=0.1)
    (diagnostic,) = [d for d in wrong.value.diagnostics if d.severity == "error"]
    return f"{diagnostic.code} {diagnostic.message}; {diagnostic.found}; {diagnostic.hint}"


def test_two_rods_that_are_too_short():
    said = told(RODS.format(apart=5, one=1, two=1))
    assert "E0529 rod1 and rod2 cannot span 5 m: 1 + 1 = 2 m between the fixed points (0, 0) and (5, 0)" in said
    assert "3 m nearer" in said


def test_a_rod_that_is_longer_than_the_way_round():
    said = told(RODS.format(apart=1, one=3, two=0.5))
    assert "E0529 rod1 (3 m) is too long for its loop: rod2 (0.5 m) and 1 m of ground reach 1.5 m" in said


@pytest.mark.parametrize(("lengths", "apart"), [([1, 0.5, 0.7], 2.5), ([0.2, 0.3, 0.1, 0.2], 0.9)])
def test_chains_of_bars_that_are_too_short(lengths, apart):
    said = told(chain(lengths, apart))
    assert f"cannot span {apart:g} m: {' + '.join(f'{v:g}' for v in lengths)} = {sum(lengths):g} m" in said


def test_a_coupler_that_is_too_long():
    said = told(FOURBAR.format(angle=0.5, coupler=3.2))
    assert "b (3.2 m) is too long for its loop" in said and "reach 2.6 m" in said


def test_a_line_that_is_too_far_away():
    said = told(SLIDER.format(aside=-2))
    assert "guide is out of reach: its line passes the fixed point (0, 0) at 2 m, and crank and rod reach 1.1 m" in said


def test_a_crank_that_is_fixed_where_the_others_do_not_reach():
    """The rod of 0.8 m reaches a line 1 m below the crank's foot where the crank of 0.3 m hangs 0.2 m or lower."""
    start = "A(phi(start = 0.7"
    said = told(SLIDER.replace(start, f"{start}, fixed = true").format(aside=-1))
    assert "E0532 no way was found to close the loop of A with A.phi = 0.7" in said
    nearest = float(said.split("closes with A.phi = ")[1].split(",")[0])
    assert 0.3 * np.sin(nearest) <= -0.2 + 1e-6


@pytest.mark.parametrize("verb", ["check", "equations", "draw"])
def test_every_verb_says_so(verb):
    with pytest.raises(ModelError, match="E0529.*cannot span 5 m"):
        getattr(lmoc.compile_text(RODS.format(apart=5, one=1, two=1)), verb)()


def test_other_lengths_close_it():
    dae = lmoc.compile_text(RODS.format(apart=1, one=3, two=0.5))
    with pytest.raises(ModelError, match="E0529"):
        dae.simulate(stop=0.1)
    run = dae.simulate(stop=0.1, parameters={"rod1.L": 0.8})
    assert np.hypot(run["mass.x"], run["mass.y"]) == pytest.approx(0.8, abs=1e-9)


def test_bars_that_just_fit_are_no_mistake():
    """Stretched out they cannot move, but they are closed."""
    try:
        lmoc.compile_text(RODS.format(apart=2, one=1, two=1)).simulate(stop=0.1)
    except ModelError as error:
        assert "E0529" not in {d.code for d in error.diagnostics}
