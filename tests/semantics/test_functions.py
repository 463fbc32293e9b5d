"""Functions: algorithms become expressions."""

import pytest
from oracles.flattening import codes, equations, flat, mistakes, value

import lmoc


def of_function(body: str, call: str, declarations: str = "", inputs: str = "input Real x;", **parameters):
    text = f"""
        function f {inputs} output Real y; {declarations} algorithm {body} end f;
        model A parameter Real p = 3; Real v(start = 1); Real r = {call}; equation der(v) = 1; end A;"""
    return flat(text, library=False, **parameters)


def result(*arguments, **more) -> str:
    return equations(of_function(*arguments, **more))[0].removeprefix("r = ")


def test_assignments_and_locals() -> None:
    assert result("t := x^2; y := t + 1;", "f(v)", "protected Real t;") == "v^2 + 1"


def test_known_arguments_fold() -> None:
    assert result("y := 2*x;", "f(4)") == "8"


def test_named_arguments_and_defaults() -> None:
    inputs = "input Real x; input Real k = 2*x;"
    assert result("y := x + k;", "f(v)", inputs=inputs) == "v + 2*v"
    assert result("y := x - k;", "f(k = v, x = 1)", inputs=inputs) == "1 - v"


def test_loops_are_unrolled() -> None:
    assert result("y := 0; for i in 1:3 loop y := y + i*x; end for;", "f(v)") == "v + 2*v + 3*v"
    assert result("y := 1; for i in 1:2, j in 1:i loop y := y*(x + j); end for;", "f(v)") == ("(v + 1)*(v + 1)*(v + 2)")


def test_a_loop_ends_at_break_and_return() -> None:
    assert result("y := 0; for i in 1:9 loop if i > 2 then break; end if; y := y + x; end for;", "f(v)") == "v + v"
    assert result("y := x; for i in 1:9 loop if i > 2 then return; end if; y := 2*y; end for;", "f(v)") == "2*(2*v)"


def test_while_over_known_values() -> None:
    body = "n := 0; y := x; while n < 2 loop y := y*x; n := n + 1; end while;"
    assert result(body, "f(v)", "protected Integer n;") == "v*v*v"


def test_while_over_a_variable_is_refused() -> None:
    text = """function f input Real x; output Real y; algorithm y := x; while y > 1 loop y := y/2; end while; end f;
        model A Real v = time; Real r = f(v); end A;"""
    (error,) = mistakes(text)
    assert error.code == "E0211" and "'while'" in error.message


def test_branches_over_variables_join() -> None:
    body = "if x > 1 then y := x; elseif x > 0 then y := 2*x; else y := 0; end if;"
    assert result(body, "f(v)") == "if v > 1 then v else (if v > 0 then 2*v else 0)"
    dae = of_function(body, "noEvent(f(v))")
    assert not dae.notes
    assert [n.code for n in of_function(body, "f(v)").notes] == ["W0311", "W0311"]


def test_branches_over_known_values_are_chosen() -> None:
    body = "if x > 1 then y := time; else y := 0; end if;"
    assert result(body, "f(2)") == "time"


def test_arrays_in_functions() -> None:
    text = """
        function poly input Real c[:]; input Real x; output Real y;
        algorithm y := 0; for k in size(c, 1):-1:1 loop y := y*x + c[k]; end for; end poly;
        function squares input Integer n; output Real v[n];
        algorithm for i in 1:n loop v[i] := i^2; end for; end squares;
        model A Real x(start = 1); Real p = poly({1, 2, 3}, x); parameter Real s[4] = squares(4);
          parameter Real q = sum(squares(3)); equation der(x) = 1; end A;"""
    dae = flat(text, library=False)
    assert equations(dae)[0] == "p = (3*x + 2)*x + 1"
    assert value(dae, "s") == [1, 4, 9, 16]
    assert value(dae, "q") == 14


def test_several_results() -> None:
    dae = flat(
        """function polar input Real x; input Real y; output Real r; output Real phi;
        algorithm r := sqrt(x^2 + y^2); phi := atan2(y, x); end polar;
        model A Real r; Real phi; Real only; equation (r, phi) = polar(3, time); (, only) = polar(1, 1); end A;""",
        library=False,
    )
    assert equations(dae)[:2] == ["r = sqrt(9 + time^2)", "phi = atan2(time, 3)"]
    assert equations(dae)[2].startswith("only = 0.785398")


def test_functions_call_functions_and_themselves() -> None:
    text = """
        function power input Real x; input Integer n; output Real y;
        algorithm if n == 0 then y := 1; else y := x*power(x, n - 1); end if; end power;
        model A Real r = power(time, 3); end A;"""
    assert equations(flat(text, library=False)) == ["r = time*(time*time)"]
    assert codes(text.replace("n - 1", "n")) == ["E0222"]


HALVES = """
    function power input Real x; input Integer n; output Real y; algorithm
      if n == 0 then y := 1; return; end if;
      if n == 1 then y := x; elseif mod(n, 2) == 0 then y := power(x, div(n, 2))*power(x, div(n, 2));
      else y := power(x, div(n, 2))*power(x, n - div(n, 2)); end if; end power;"""
HALVES_IN_ONE = """
    function power input Real x; input Integer n; output Real y = if n == 0 then 1 elseif n == 1 then x elseif
      mod(n, 2) == 0 then power(x, div(n, 2))^2 else power(x, div(n, 2))*power(x, n - div(n, 2)); end power;"""
IN_TURN = """
    function power input Real x; input Integer n; output Real y;
      algorithm if n == 0 then y := 1; else y := x*rest(x, n - 1); end if; end power;
    function rest input Real x; input Integer n; output Real y;
      algorithm if n > 0 then y := power(x, n); else y := 1; end if; end rest;"""


@pytest.mark.parametrize("function", [HALVES, HALVES_IN_ONE, IN_TURN])
def test_a_recursion_that_a_parameter_ends_is_written_out_once(function: str, monkeypatch, tmp_path) -> None:
    """Both branches of each call would be 2^depth of them; what is counted grows as the result does."""
    text = function + "model A parameter Integer n = 17; Real r = power(time, n); end A;"
    monkeypatch.setenv("LMOC_MAX_ROUNDS", "1000")
    (r,) = equations(flat(text, library=False))
    assert eval(r.removeprefix("r = ").replace("^", "**"), {"time": 3}) == 3**17
    (tmp_path / "a.lmo").write_text(text)
    dae = lmoc.compile(tmp_path / "a.lmo")
    other = dae.simulate(stop=1.1, points=2, parameters={"n": 5})
    assert other["r"][-1] == pytest.approx(1.1**5, rel=1e-14), "another number is another recursion"


def test_a_recursion_that_the_run_would_have_to_end_is_refused_at_once(monkeypatch) -> None:
    monkeypatch.setenv("LMOC_MAX_ROUNDS", "1000")
    (only,) = mistakes("""
        function f input Real x; input Integer n; output Real y;
        algorithm if x > 0 then y := f(x - 1, n); elseif n == 2 then y := f(x - 2, n); else y := f(x/2, n); end if;
        end f;
        model A parameter Integer n = 2; Real y = f(time, n); end A;""")
    assert only.code == "E0222" and "more than 50 deep" in only.message and "parameters" in only.hint


def test_a_function_of_one_number_is_applied_to_arrays() -> None:
    dae = flat(
        """function sq input Real x; input Real k; output Real y; algorithm y := k*x*x; end sq;
        model A Real x[3]; Real y[3] = sq(x, 2); equation der(x) = y; end A;""",
        library=False,
    )
    (group,) = [g for g in dae.groups if g.origin == "binding"]
    assert group.rows == 3
    assert equations(dae, "binding")[1] == "y[2] = 2*x[2]*x[2]"


def test_functions_in_packages() -> None:
    dae = flat(
        """package P constant Real c = 2; function f input Real x; output Real y; algorithm y := c*x; end f; end P;
        model A import P.f; Real a = f(time); Real b = P.f(1); end A;""",
        library=False,
    )
    assert equations(dae) == ["a = 2*time", "b = 2"]


@pytest.mark.parametrize(
    ("call", "code"),
    [
        ("f(1, 2)", "E0217"),
        ("f()", "E0217"),
        ("f(z = 1)", "E0217"),
        ("f(true)", "E0301"),
        ("g(1)", "E0203"),
        ("sin()", "E0217"),
    ],
)
def test_wrong_calls(call: str, code: str) -> None:
    text = f"""function f input Real x; output Real y; algorithm y := x; end f;
        model A Real r = {call}; end A;"""
    assert codes(text) == [code]


def test_what_a_function_never_assigns() -> None:
    assert codes("function f input Real x; output Real y; algorithm end f; model A Real r = f(1); end A;") == ["E0222"]


RECORDS = """
    record Pair Real x; Real y = 7; end Pair;
    record Body Real m(unit = "kg"); Pair at; end Body;
    function moment
      input Body body;
      input Real g = 10;
      output Real t;
    algorithm
      t := body.m*g*body.at.x - body.at.y;
    end moment;
    function twice
      input Body body;
      output Real t;
    algorithm
      t := moment(body) + moment(g = 0, body = body);
    end twice;
"""


@pytest.mark.parametrize(
    ("declared", "expected"),
    [
        ("parameter Body b(m = 2, at(x = 3, y = 4)); parameter Real r = moment(b);", 2 * 10 * 3 - 4),
        ("parameter Real r = moment(Body(2, Pair(3, 4)));", 2 * 10 * 3 - 4),
        ("parameter Real r = moment(Body(at = Pair(x = 3), m = 2), g = 1);", 2 * 3 - 7),
        ("parameter Body b(m = 2, at(x = 3, y = 4)); parameter Real r = twice(b);", 2 * 10 * 3 - 4 - 4),
        ("parameter Body b[2](m = {1, 2}, each at(x = 3, y = 4)); parameter Real c[2] = moment(b);"
         " parameter Real r = c[1] + 100*c[2];", 26 + 5600),
    ],
)  # fmt: skip
def test_a_record_as_argument(declared: str, expected: float) -> None:
    assert value(flat(f"{RECORDS} model A {declared} end A;", library=False), "r") == expected


def test_a_record_of_variables_as_argument() -> None:
    dae = flat(f"{RECORDS} model A Body b(m = time, at(x = 2, y = 1)); Real r = moment(b); end A;", library=False)
    assert "r = b.m*10*b.at.x - b.at.y" in equations(dae)


@pytest.mark.parametrize(
    ("declared", "code", "words"),
    [
        ("Real r = moment(3);", "E0301", "'body' of 'moment' must be of type Body"),
        ("Real r = moment(Body(2));", "E0217", "the argument 'at' of 'Body' is missing"),
        ("Real r = moment(Body(2, where = 3));", "E0217", "'Body' has no argument 'where'"),
        ("Pair p(x = 1); Real r = moment(p);", "E0301", "must be of type Body with a field 'm'"),
    ],
)
def test_records_that_do_not_fit(declared: str, code: str, words: str) -> None:
    (only,) = mistakes(f"{RECORDS} model A {declared} end A;")
    assert only.code == code and words in only.message


@pytest.mark.parametrize(
    ("body", "code", "words"),
    [
        ("y := p.z;", "E0201", "'p' has no element 'z'"),
        ("y := p;", "E0301", "'y' is of type Real"),
        ("p.x := 1; y := 2;", "E0222", "the input 'p' cannot be assigned"),
    ],
)
def test_a_record_inside_a_function(body: str, code: str, words: str) -> None:
    (only,) = mistakes(f"""{RECORDS} function f input Pair p; output Real y; algorithm {body} end f;
                       model A Real r = f(Pair(1, 2)); end A;""")
    assert only.code == code and words in only.message


def test_an_assertion_in_a_function_is_looked_at_where_it_is_known() -> None:
    function = """function root input Real x; output Real y;
        algorithm assert(x >= 0, "no root of a negative number"); y := sqrt(x); end root;"""
    (only,) = mistakes(f"{function} model A Real r = root(4) + root(-4); end A;")
    assert only.code == "E0222" and "no root of a negative number" in only.message
    dae = flat(f"{function} model A Real r = root(time); end A;", library=False)
    assert [note.code for note in dae.notes] == ["W0229"]
    refused = """function f input Real x; output Real y; algorithm y := x;
        if x > 3 then y := root(-x); assert(false, "too much"); end if; end f;"""
    dae = flat(f"{function} {refused} model A Real r = f(time); end A;", library=False)
    assert {note.code for note in dae.notes} == {"W0229"}  # reached or not: the run decides
    (only,) = mistakes(f"{function} {refused} model A parameter Real p = 4; Real r = f(p); end A;")
    assert only.code == "E0222" and "too much" in only.message


@pytest.mark.parametrize(
    ("call", "code"),
    [
        ("first({1, 2})", "E0302"),
        ("first({1, 2, 3})", ""),
        ("chosen(2, {1, 2})", ""),
        ("chosen(3, {1, 2})", "E0302"),
        ("made(-1)", "E0301"),
        ("made(1000000000000)", "E0225"),
        ("half(2)", "E0301"),
    ],
)
def test_sizes_inside_functions(call: str, code: str) -> None:
    text = f"""
        function first input Real v[3]; output Real y; algorithm y := v[1]; end first;
        function chosen input Integer n; input Real v[n]; output Real y; algorithm y := v[n]; end chosen;
        function made input Integer n; output Real y; protected Real v[n]; algorithm y := 1; end made;
        function half input Integer n; output Real v[n]; algorithm v[1.5] := 3; end half;
        model A parameter Real r = {call}; end A;"""
    if code:
        assert codes(text) == [code]
    else:
        assert value(flat(text, library=False), "r") in (1, 2)


@pytest.mark.parametrize(
    ("name", "body", "result"),
    [
        ("mysin", 'external "builtin" y = sin(u);', "sin(x)"),
        ("mysin", 'external "builtin" y = sin(u) annotation(Library = "m"); annotation(Inline = true);', "sin(x)"),
        ("tanh", 'external "builtin";', "tanh(x)"),
        ("angle", 'external "builtin" atan2(u, 2);', "atan2(x, 2)"),
    ],
)
def test_a_function_that_is_built_in(name: str, body: str, result: str) -> None:
    dae = flat(f"""function {name} input Real u; output Real y; {body} end {name};
                   model A Real x = time; Real y = {name}(x); end A;""")
    assert f"y = {result}" in equations(dae)


def test_a_function_that_only_seems_to_be_built_in() -> None:
    function = 'function f input Real u; output Real y; external "builtin" y = besselj(u); end f;'
    assert codes(f"{function} model A Real x = f(1); end A;") == ["E0203"]


def test_local_variables_are_declared_in_any_order() -> None:
    text = """function f input Real x; output Real y;
                protected Real a = b + c[1]; Real b = 2*x; Real c[n] = fill(x, n); Integer n = 2;
                algorithm y := a; end f;
              model A parameter Real z = f(3); end A;"""
    assert value(flat(text), "z") == 9
    assert codes(text.replace("Real b = 2*x", "Real b = a")) == ["E0207"]


def test_an_element_keeps_the_type_of_its_array() -> None:
    """An Integer that has been stored in a Real array made it one of Integers, which took no Real any more."""
    again = "for k in 1:2 loop a[k] := a[k] + x; end for; y := a[1] + a[2];"
    assert result(f"a[1] := 0; a[2] := 1; {again}", "f(v)", "protected Real a[2];") == "v + (1 + v)"
    assert result(f"a := {{0, 1}}; {again}", "f(v)", "protected Real a[2];") == "v + (1 + v)"
    assert result(again, "f(v)", "protected Real a[2] = {0, 1};") == "v + (1 + v)"
    assert "E0301" in codes(
        "function f input Real x; output Real y; protected Integer a[2]; algorithm a[1] := x; y := a[1]; end f;"
        "model A Real v(start = 1); Real r = f(v); equation der(v) = 1; end A;"
    )
