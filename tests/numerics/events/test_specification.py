"""Events as the Modelica specification 3.6 defines them: 8.3.5 (when), 8.5 (events), 8.6 (start), 3.7.5 (operators)."""

import pytest

import lmoc

CLOCK = """Real x(start = 0, fixed = true);
equation
  der(x) = 1;
"""

CASES = {
    "one of several conditions": (
        """Integer n(start = 0, fixed = true);""",
        """when {x > 0.2, x > 0.5} then n = pre(n) + 1; end when;""",
        {"n": 2},
    ),
    "two conditions at one instant are one event": (
        """Integer n(start = 0, fixed = true);""",
        """when {time > 0.2, 2*time > 0.4} then n = pre(n) + 1; end when;""",
        {"n": 1},
    ),
    "the first branch that becomes true": (
        """Integer n(start = 0, fixed = true);""",
        """when time >= 0.5 then n = 1; elsewhen time >= 0.5 then n = 2; end when;""",
        {"n": 1},
    ),
    "samples in elsewhen": (
        """Integer n(start = 0, fixed = true), m(start = 0, fixed = true);""",
        """when sample(0, 0.5) then n = pre(n) + 1; m = pre(m); elsewhen sample(0, 0.25) then m = pre(m) + 1; n
        = pre(n); end when;""",
        {"n": 3, "m": 2},
    ),
    "edge and change": (
        """Boolean b(start = false, fixed = true); Integer i(start = 0, fixed = true), e(start = 0, fixed =
        true), c(start = 0, fixed = true);""",
        """b = sin(10*x) > 0.3; when sample(0, 0.25) then i = pre(i) + 1; end when; when edge(b) then e =
        pre(e) + 1; end when; when change(i) then c = pre(c) + 1; end when;""",
        {"e": 2, "c": 5},
    ),
    "a chain of pre": (
        """Integer a(start = 0, fixed = true), b(start = 0, fixed = true), c(start = 0, fixed = true);""",
        """when sample(0.05, 0.1) then a = pre(a) + 1; b = pre(a); c = pre(b); end when;""",
        {"a": 10, "b": 9, "c": 8},
    ),
    "a sample that begins in the past": (
        """Integer n(start = 0, fixed = true); discrete Real last(start = 0, fixed = true);""",
        """when sample(-0.25, 0.5) then n = pre(n) + 1; last = time; end when;""",
        {"n": 2, "last": 0.75},
    ),
    "initial()": (
        """discrete Real s(start = 0);""",
        """when initial() then s = 7; end when;""",
        {"s": 7},
    ),
    "reinit at the start": (
        """Real y(start = 0);""",
        """der(y) = 1; when initial() then reinit(y, 5); end when;""",
        {"y": 6},
    ),
    "terminal()": (
        """Integer k(start = 0, fixed = true);""",
        """when terminal() then k = 9; end when;""",
        {"k": 9},
    ),
    "branches in branches": (
        """Real y;""",
        """y = if x < 0.3 then (if x < 0.1 then 1 else 2) elseif x < 0.6 then 3 else 4;""",
        {"y": 4},
    ),
    "branches with different unknowns": (
        """Real a, b;""",
        """if x < 0.5 then a = 1; b = x; else b = 2; a = x + 1; end if;""",
        {"a": 2, "b": 2},
    ),
    "relations in functions": (
        """function f input Real u; output Real y; algorithm y := if u > 0.5 then 1 else 0; end f; Real y,
        z(start = 0, fixed = true);""",
        """y = f(x); der(z) = y;""",
        {"z": 0.5},
    ),
    "smooth of order 0": (
        """Real y, z(start = 0, fixed = true);""",
        """y = smooth(0, if x > 0.5 then x - 0.5 else 0); der(z) = y;""",
        {"z": 0.125},
    ),
    "smooth of order 1 has a derivative": (
        """Real y, w;""",
        """y = smooth(1, if x > 0.5 then (x - 0.5)^2 else 0); w = der(y);""",
        {"w": 1},
    ),
    "an enumeration": (
        """type S = enumeration(a, b, c); S s(start = S.a, fixed = true);""",
        """when x > 0.5 then s = if pre(s) == S.a then S.c else S.b; end when;""",
        {"s": 3},
    ),
    "an array in a when": (
        """discrete Real v[3](each start = 0, each fixed = true);""",
        """when x > 0.5 then v = {1, 2, 3}*x; end when;""",
        {"v[2]": 1},
    ),
    "a loop in a when": (
        """discrete Real v[3](each start = 0, each fixed = true);""",
        """when x > 0.5 then for i in 1:3 loop v[i] = pre(v[i]) + i; end for; end when;""",
        {"v[3]": 3},
    ),
    "if in a when": (
        """Integer k(start = 0, fixed = true);""",
        """when sample(0.1, 0.2) then if x < 0.4 then k = pre(k) + 1; else k = pre(k) + 10; end if; end when;""",
        {"k": 32},
    ),
    "when in an algorithm": (
        """Integer k(start = 0, fixed = true);""",
        """algorithm when x > 0.25 then k := pre(k) + 1; elsewhen x > 0.75 then k := k + 10; end when;""",
        {"k": 11},
    ),
    "the derivative of an input with a kink": (
        """input Real u = if time < 0.5 then 0 else time - 0.5; Real z(start = 0, fixed = true);""",
        """der(z) = der(u);""",
        {"z": 0.5},
    ),
    "pre of a state in a when": (
        """discrete Real s(start = 0, fixed = true); Real y(start = 0, fixed = true);""",
        """der(y) = 1; when y > 0.4 then reinit(y, 0); s = pre(y); end when;""",
        {"s": 0.4, "y": 0.2},
    ),
    "a condition that turns itself off": (
        """Boolean b(start = false, fixed = true);""",
        """when sample(0.1, 0.2) then b = not pre(b); end when;""",
        {"b": 1},
    ),
    "events that follow each other": (
        """Integer a(start = 0, fixed = true), b(start = 0, fixed = true), c(start = 0, fixed = true);""",
        """when x > 0.5 then a = 1; end when; when a > 0 then b = 1; end when; when b > 0 then c = pre(c) + 1;
        end when;""",
        {"a": 1, "b": 1, "c": 1},
    ),
    "what is assigned at one instant counts at once": (
        """Integer a(start = 0, fixed = true), b(start = 0, fixed = true);""",
        """when x > 0.5 then a = 5; end when; when x > 0.5 then b = a + 1; end when;""",
        {"b": 6},
    ),
    "pre at one instant is what was before": (
        """Integer a(start = 0, fixed = true), b(start = 0, fixed = true);""",
        """when x > 0.5 then a = pre(b) + 1; end when; when x > 0.5 then b = pre(a) + 1; end when;""",
        {"a": 1, "b": 1},
    ),
    "a condition that is a value before": (
        """Boolean b(start = false, fixed = true), p;
        Integer m(start = 0, fixed = true), n(start = 0, fixed = true);""",
        """when x > 0.5 then b = true; end when; when pre(b) then m = pre(m) + 1; end when;
        algorithm p := pre(b); when p then n := pre(n) + 1; end when;""",
        {"m": 1, "n": 1},
    ),
    "a start value of pre": (
        """Integer k;""",
        """when x > 0.5 then k = pre(k) + 1; end when; initial equation pre(k) = 4;""",
        {"k": 5},
    ),
    "an initial algorithm": (
        "Real y; Integer k; parameter Real a = 2;",
        """der(y) = 0; when time > 5 then k = pre(k) + 1; end when;
        initial algorithm y := a*3; k := integer(y) + 1;""",
        {"y": 6, "k": 7},
    ),
    "sample outside of a when": (
        """Integer n(start = 0, fixed = true); Boolean s;""",
        """s = sample(0.1, 0.35); when s then n = pre(n) + 1; end when;""",
        {"n": 3},
    ),
    "change of a discrete Real": (
        """discrete Real d(start = 0, fixed = true); Integer n(start = 0, fixed = true);""",
        """when sample(0.2, 0.2) then d = floor(time*2.5 + 1e-9); end when; when change(d) then n = pre(n) + 1;
        end when;""",
        {"n": 2},
    ),
    "Boolean equations": (
        """Boolean b, c, d;""",
        """b = x > 0.2 and x < 0.7; c = not b or x > 0.9; d = b <> c;""",
        {"b": 0, "c": 1, "d": 1},
    ),
    "jumps of elementary functions": (
        """Real z(start = 0, fixed = true);""",
        """der(z) = sign(x - 0.5) + abs(x - 0.25) + floor(4*x) + max(x, 0.75);""",
        {"z": 2.59375},
    ),
    "a state that follows from another one": (
        """Mass a(m = 1, q(start = 0, fixed = true), v(start = 0, fixed = true)), b(m = 1); Rod r(L = 1);""",
        """connect(a.flange, r.a); connect(r.b, b.flange); when time > 0.5 then reinit(b.v, 3); end when;""",
        {"a.q": 1.5},
    ),
}


def run(declared: str, equations: str, **options) -> lmoc.Run:
    text = f"model Case {declared}\n{CLOCK}{equations}\nend Case;"
    return lmoc.compile_text(text).simulate(**{"stop": 1, "rtol": 1e-9, "points": 5} | options)


@pytest.mark.parametrize("name", CASES)
def test_values_at_the_end(name):
    declared, equations, wanted = CASES[name]
    result = run(declared, equations)
    assert {n: result[n][-1] for n in wanted} == pytest.approx(wanted, abs=1e-7)


def test_terminate_tells_its_text():
    result = run("", 'when x > 0.5 then terminate("half way at " + String(2)); end when;')
    assert result.end.time == pytest.approx(0.5, abs=1e-9)
    assert any("half way at 2" in n.message for n in result.notes)


@pytest.mark.parametrize(
    "equation", ['assert(x < 0.55, "too far");', 'when x > 0.55 then assert(false, "too far"); end when;']
)
def test_an_assertion_of_level_error_ends_a_run(equation):
    with pytest.raises(lmoc.SimulationError, match="too far") as failed:
        run("", equation)
    assert failed.value.time == pytest.approx(0.55, abs=1e-8)


def test_an_assertion_of_level_warning_does_not():
    result = run("", 'assert(x < 0.55, "too far", AssertionLevel.warning);')
    assert result["x"][-1] == pytest.approx(1) and any("too far" in n.message for n in result.notes)


def test_no_event_makes_no_event():
    result = run("Real y;", "y = noEvent(if x > 0.5 then 1 else 0);")
    assert result.events == () and result["y"][-1] == 1
