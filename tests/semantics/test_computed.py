"""Integers, Booleans and enumerations bound to parameters, ranges that follow from arrays, ranges that differ."""

import pytest
from oracles.flattening import codes, equations, flat, value

import lmoc
from lmoc.messages.diagnostics import ModelError
from lmoc.semantics import equations as equation_module
from lmoc.semantics.values import array_builtins, constructors

COMPUTED = """
model A
  type Load = enumeration(light, heavy);
  parameter Integer k = 3;
  Integer n = 2*k;
  Boolean big = n > 4;
  Load load = if big then Load.heavy else Load.light;
  String name = if big then "big" else "small";
  Real y = if load == Load.heavy then n else -n;
  Real z[n] = {i^2 for i in 1:n};
  Mass extra(m = 1) if big;
protected
  Integer half = div(n, 2);
public
  Real w = half;
end A;
"""


@pytest.fixture(params=[False, True], ids=["short", "long"])
def either_way(request, monkeypatch):
    """Loops are unrolled, and loops are one group."""
    if request.param:
        for module in (constructors, equation_module, array_builtins):
            monkeypatch.setattr(module, "WRITTEN_OUT", 0)


def test_values_that_follow_from_parameters() -> None:
    dae = flat(COMPUTED)
    assert [value(dae, name) for name in ("n", "big", "load", "half")] == [6, 1, 2, 3]
    assert {"w = half", "z[6] = 36"} <= set(equations(dae))
    assert dae.find("extra.q") is not None and dae.find("z[6]") is not None


def test_they_follow_a_parameter_from_run_to_run() -> None:
    dae = lmoc.compile_text(COMPUTED)
    assert dae.simulate(stop=1, points=2)["y"].tolist() == [6, 6]
    run = dae.simulate(stop=1, points=2, parameters={"k": 2})
    assert (run["y"][0], run["w"][0], run["z[4]"][0]) == (-4, 2, 16)


@pytest.mark.parametrize("name", ["n", "big", "load", "half", "fixed"])
def test_they_cannot_be_set_neither_at_once_nor_later(name: str) -> None:
    text = COMPUTED.replace("protected", "  final parameter Real fixed = 2*k;\nprotected")
    dae = lmoc.compile_text(text)
    for attempt in (lambda: lmoc.compile_text(text, parameters={name: 1}), lambda: dae.simulate(parameters={name: 1})):
        with pytest.raises(ModelError) as caught:
            attempt()
        assert {d.code for d in caught.value.diagnostics} <= {"E0206", "E0210"}


def test_a_final_parameter_of_a_part_stays_as_it_follows() -> None:
    dae = lmoc.compile_text("model A Disk disk(m = 2, r = 1); Real J = disk.J; end A;")
    assert dae.simulate(stop=1, points=2, parameters={"disk.r": 2})["J"][0] == pytest.approx(4)
    with pytest.raises(ModelError, match="'disk.J' is final"):
        dae.simulate(parameters={"disk.J": 5})


def test_a_part_gives_another_value() -> None:
    dae = flat("model P parameter Integer k = 1; Integer n = k + 1; Real x[n]; equation x = zeros(n); end P; "
               "model A P a(k = 2); P b(n = 5); P c[2](each k = 3); end A;")  # fmt: skip
    assert [len(dae.find(f"{part}.x")) for part in ("a", "b", "c[1]", "c[2]")] == [3, 5, 4, 4]


@pytest.mark.parametrize(
    ("declared", "code"),
    [
        ("Boolean b = noEvent(x > 0);", "E0251"),
        ("Integer n = if time > 1 then 1 else 2; Real y[n];", "E0211"),
        ("Boolean b;", "E0307"),
        ("Boolean b = 1; Mass m(m = 1) if b;", "E0301"),
        ("Integer n = 1.5;", "E0301"),
        ("String s = 1;", "E0301"),
        ("parameter String s = \"a\" + 1;", "E0301"),
        ("parameter String s = t;", "E0201"),
        ("Integer n = m; Integer m = n;", "E0207"),
    ],
)  # fmt: skip
def test_what_they_cannot_be(declared: str, code: str) -> None:
    assert codes(f"model A Real x(start = 1); {declared} equation der(x) = -x; end A;") == [code]


# ------------------------------------------------------------------------------ ranges


def test_a_range_follows_from_the_arrays(either_way) -> None:
    text = """
        model A
          parameter Integer n = 20;
          Mass m[n](each m = 1);
          Spring s[n](each k = 1);
          Fixed wall;
          Real x[2, 3];
          Real top = sum(x[i, 2] for i), row[3] = {x[1, j] for j};
        equation
          for i loop
            connect(wall.flange, s[i].a);
            connect(s[i].b, m[i].flange);
          end for;
          for i, j loop
            x[i, j] = 10*i + j;
          end for;
        end A;"""
    written = text.replace("for i loop", "for i in 1:n loop").replace("for i, j", "for i in 1:2, j in 1:3")
    written = written.replace("for i)", "for i in 1:2)").replace("for j}", "for j in 1:3}")
    assert sorted(equations(flat(text))) == sorted(equations(flat(written)))


def test_a_range_follows_from_the_arrays_of_a_function_and_of_a_package() -> None:
    dae = flat("""
        package P constant Real c[4] = {1, 2, 3, 4}; end P;
        function total
          input Real v[:];
          output Real t = 0;
        algorithm
          for k loop
            t := t + v[k]*P.c[k];
          end for;
        end total;
        model A parameter Real a = total({1, 1, 1, 2}); parameter Real b = sum(P.c[i] for i); end A;""")
    assert (value(dae, "a"), value(dae, "b")) == (14, 10)


@pytest.mark.parametrize(
    ("loop", "code"),
    [
        ("for i loop x[1] = i; end for;", "E0211"),
        ("for i loop x[i + 1] = i; end for;", "E0211"),
        ("for i loop x[i] = y[i]; end for;", "E0302"),
        ("for i loop z[i] = i; end for;", "E0201"),
    ],
)
def test_a_range_that_does_not_follow(loop: str, code: str) -> None:
    assert codes(f"model A Real x[3], y[2]; equation {loop} end A;") == [code]


def test_ranges_that_differ_within_an_array_of_parts(either_way) -> None:
    dae = lmoc.compile_text("""
        model Part
          parameter Integer n = 1;
          Real x[30];
        equation
          for i in 1:n loop
            x[i] = i;
          end for;
          for i in n + 1:30 loop
            x[i] = -i;
          end for;
        end Part;
        model A Part p[3](n = {4, 0, 25}); end A;""")
    run = dae.simulate(stop=1, points=2)
    for part, n in enumerate((4, 0, 25), start=1):
        assert [run[f"p[{part}].x[{i}]"][0] for i in range(1, 31)] == [i if i <= n else -i for i in range(1, 31)]
