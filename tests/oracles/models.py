"""Scenes of `models/` compiled once for all tests of a process, and equations that models of several tests share."""

import os
from functools import cache, lru_cache
from pathlib import Path

import lmoc

MODELS = Path(__file__).parents[2] / "models"


def compiled(name: str | Path, **parameters: float) -> lmoc.DAE:
    """A scene of `models/`, by its file or as in "planar/four_bar", for tests that change nothing about it."""
    path = Path(name) if isinstance(name, Path) else MODELS / f"{name}.lmo"
    return _compiled(path, tuple(parameters.items()), os.environ.get("LMOC_CHECK", ""))


@cache
def _compiled(path: Path, parameters: tuple[tuple[str, float], ...], checked: str) -> lmoc.DAE:
    """Also by whether its stages are checked, which not all tests ask for."""
    return lmoc.compile(path, parameters=dict(parameters))


def compiled_text(text: str) -> lmoc.DAE:
    """A scene given as text, for tests that change nothing about it: one text is run by many methods."""
    return _compiled_text(text, os.environ.get("LMOC_CHECK", ""))


@lru_cache(maxsize=64)
def _compiled_text(text: str, checked: str) -> lmoc.DAE:
    return lmoc.compile_text(text)


CONNECTED_SLIDER_CRANK = """\
  connect(ground.frame, main.a);
  connect(main.b, crank.a);
  connect(crank.b, pin.a);
  connect(pin.b, rod.a);
  connect(rod.b, gudgeon.b);
  connect(gudgeon.a, slider.frame);
  connect(ground.frame, line.a);
  connect(line.b, slider.frame);"""
PARALLELOGRAM = """model Parallelogram "three bars of 1 m and 1 kg, from the upright with 1 m/s"
  import Planar.*;
  constant Real up(unit = "rad") = 1.5707963267948966;
  inner World world;
  Ground left, right(x = 1);
  Revolute first(phi(start = up, fixed = true), omega(start = 1, fixed = true)), second(phi(start = up));
  Revolute third(phi(start = -up)), fourth;
  Bar crank(l = 1, m = 1), coupler(l = 1, m = 1), rocker(l = 1, m = 1);
equation
  connect(left.frame, first.a);
  connect(first.b, crank.a);
  connect(crank.b, third.a);
  connect(third.b, coupler.a);
  connect(coupler.b, fourth.a);
  connect(fourth.b, rocker.b);
  connect(rocker.a, second.b);
  connect(right.frame, second.a);
end Parallelogram;"""
STIFF = """model Stiff "two masses, stiffness ratio 1e6, damped"
  Fixed wall; Spring s1(k = 1e6); Damper d1(c = 400); Mass m1(m = 1, q(start = 1e-3, fixed = true), v(fixed = true));
  Spring s2(k = 2); Mass m2(m = 1, q(start = 1, fixed = true), v(fixed = true));
  output Real y = m2.q;
equation
  connect(wall.flange, s1.a); connect(wall.flange, d1.a); connect(s1.b, m1.flange); connect(d1.b, m1.flange);
  connect(m1.flange, s2.a); connect(s2.b, m2.flange);
end Stiff;"""
FLOOR = """model Floor "a ball on the floor, stuck by friction; the upper end of its damper steps"
  output Real x(unit = "m") = ball.q;
  Motion top(q = if time < 1 then 1 elseif time < 2 then 0.5 else 1);
  Mass ball(m = 1, g = -9.81, q(start = 0, fixed = true), v(start = 0, fixed = true));
  Damper d(c = 3);
  Fixed wall;
  Stop floor(L = 0, e = 0.5);
  DryFriction friction(F = 0.5);
equation
  connect(top.flange, d.b); connect(d.a, ball.flange);
  connect(wall.flange, floor.a); connect(floor.b, ball.flange);
  connect(wall.flange, friction.a); connect(friction.b, ball.flange);
  annotation(experiment(StopTime = 3));
end Floor;"""
