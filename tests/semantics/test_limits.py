"""Models that no machine could make are refused soon, by a limit that has a name and can be raised."""

from concurrent.futures import ThreadPoolExecutor

import pytest
from oracles.flattening import codes, flat, mistakes

import lmoc
from lmoc.expression import dag
from lmoc.messages.diagnostics import ModelError

NESTED = "model P0 Real x = time; end P0;\n" + "".join(
    f"model P{i} P{i - 1} a; P{i - 1} b; end P{i};\n" for i in range(1, 25)
)
LOOPS = """function f input Real x; output Real y; algorithm y := 0;
    for i in 1:3000 loop for j in 1:3000 loop y := y + x*i*j; end for; end for; end f;
    model A Real x = f(time); end A;"""
CALLS = """function f input Integer n; output Real y; algorithm y := if n <= 0 then 0 else f(n - 1) + f(n - 1); end f;
    model A Real x = f(40); end A;"""


@pytest.mark.parametrize(
    ("text", "model", "name"), [(NESTED, "P24", "LMOC_MAX_PARTS"), (LOOPS, "A", "LMOC_MAX_ROUNDS"),
                                (CALLS, "A", "LMOC_MAX_ROUNDS")],
)  # fmt: skip
def test_a_limit_has_a_name(text: str, model: str, name: str, monkeypatch) -> None:
    monkeypatch.setenv(name, "500")
    (mistake,) = mistakes(text, model)
    assert mistake.code == "E0225" and name in mistake.hint


def test_a_limit_can_be_raised(monkeypatch) -> None:
    monkeypatch.setenv("LMOC_MAX_PARTS", "20")
    assert codes(NESTED, "P6") == ["E0225"]
    monkeypatch.setenv("LMOC_MAX_PARTS", "200")
    assert flat(NESTED, "P6").count > 64


def test_arrays_are_refused_before_they_are_made() -> None:
    assert codes("""model A parameter Integer n = 2000;
        parameter Real y = sum({{{i*j*k for i in 1:n} for j in 1:n} for k in 1:n}); end A;""") == ["E0225"]
    assert codes("""model A Real x[100]; equation for i in 1:2000 loop for j in 1:2000 loop for k in 1:2000 loop
        x[1] = i*j*k; end for; end for; end for; end A;""") == ["E0225"]


def test_parts_without_connection_are_told_before_they_are_reduced() -> None:
    (mistake,) = mistakes("""model A Fixed w; Mass m(m = 1); Spring s[3000](each k = 1);
        equation connect(w.flange, s[1].a); connect(s[1].b, m.flange); end A;""")
    assert mistake.code == "E0402" and "2999 elements of 's'" in mistake.message
    flat("model A Mass m[3000](each m = 1); end A;")


@pytest.mark.parametrize(
    ("signal", "fits"),
    [
        ("+".join(["sin(time)"] * 3000), True),
        ("time;Real y=2", False),
        ("time; equation der(x) = 1", False),
        ("time; end Signal; model Other Real z = 1", False),
        ("1 if time > 1", False),
        ("(" * 300 + "time" + ")" * 300, False),
        ("", False),
    ],
)
def test_signals_as_text(signal: str, fits: bool) -> None:
    dae = lmoc.compile_text("model A input Real u = 0; Real x(start = 0, fixed = true); equation der(x) = u; end A;")
    if fits:
        assert dae.simulate(stop=1, inputs={"u": signal})["x"][-1] == pytest.approx(3000*(1 - 0.5403023058681398))
    else:
        with pytest.raises(ModelError) as caught:
            dae.simulate(stop=1, inputs={"u": signal})
        assert [d.code for d in caught.value.diagnostics if d.severity == "error"] == ["E0521"]


@pytest.mark.parametrize("brackets", ["(" * 400, "(" * 400 + "1" + ")" * 400, "{" * 300])
def test_a_mistake_before_many_brackets(brackets: str) -> None:
    with pytest.raises(ModelError) as caught:
        lmoc.compile_text(f"model A\n  Real x = ;\n  Real y = {brackets};\nend A;")
    assert "E0123" in [d.code for d in caught.value.diagnostics]


def test_threads_make_the_same_expressions() -> None:
    def build(n: int) -> list[dag.Expr]:
        return [dag.function("sin", dag.slot(k % 50) * dag.const(k + 0.125)) + dag.slot(n % 1) for k in range(2000)]

    with ThreadPoolExecutor(8) as pool:
        results = list(pool.map(build, range(8)))
    assert all(a is b for other in results[1:] for a, b in zip(results[0], other, strict=True))


def test_threads_compile_at_the_same_time() -> None:
    text = "model A parameter Real k = 1; Real x(start = 1, fixed = true); equation der(x) = -k*sin(x)*{n}; end A;"
    with ThreadPoolExecutor(4) as pool:
        flats = list(pool.map(lambda n: lmoc.compile_text(text.replace("{n}", str(n % 3 + 1))).flat, range(12)))
    assert all(flats[i].groups[0].right is flats[i + 3].groups[0].right for i in range(9))
