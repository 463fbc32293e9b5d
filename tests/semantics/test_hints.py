"""What is said of usual slips: one message each, at the right place, with what to write instead."""

import pytest
from oracles.flattening import codes, flat, mistakes

import lmoc
from lmoc.messages.diagnostics import ModelError


def said(text: str) -> list:
    """All errors of a text, those of the grammar included."""
    with pytest.raises(ModelError) as caught:
        lmoc.compile_text(text)
    return [d for d in caught.value.diagnostics if d.severity == "error"]


@pytest.mark.parametrize(
    ("text", "code", "marked", "hint"),
    [
        ("model A Cell c[3](s(each k = 5)); end A; model Cell Spring s(k = 1); end Cell;", "E0213", "5",
         "move it out: 'c(each s(k = …))'"),
        ("model A Mass mass(m = 1, q = 0.5); end A;", "E0307", "0.5", "'q(start = 0.5, fixed = true)'"),
        ("model A Modelica.SIunits.Length x = 1; end A;", "E0202", "Modelica.SIunits.Length", 'Real x(unit = "m")'),
        ("model A Modelica.Units.SI.Torque x = 1; end A;", "E0202", "Modelica.Units.SI.Torque", '"N.m"'),
        ("model A Motor motor(u = 1); end A;", "E0202", "Motor", "did you mean 'DCMotor'?"),
        ("model A import Modelica.Constants.pi; Real x = pi; end A;", "E0202", None, "3.14159"),
        ("model A Real x; equation; x = 1; end A;", "E0101", ";", "leave it out"),
        ("function f output Real y; algorithm; y := 1; end f; model A Real x = f(); end A;", "E0101", ";", "leave it"),
        ("model A Spring s(k = 50,5); end A;", "E0101", "50,5", "50.5"),
        ("model A Real x = max(1,5, 2); end A;", "E0217", None, ""),
        ("model A Real x[3] = {1, 2, 3}; Real y = sum(3[:]); end A;", "E0101", "[:]", "only names"),
        ("model A Real y = (1 + 2)[1]; end A;", "E0101", "[1]", "name the array first"),
        ("model A Real x; % text\n equation\n x = 1; % more\n end A;", "E0106", "% text", "//"),
        ("model A\n % text\n Real x = 1;\n end A;", "E0106", "% text", "//"),
        ("model A Real model = 2; Real x = model + 2*model - model; equation der(x) = model; end A;", "E0110", "model",
         "another name"),
        ("model A Real end = 3; end A;", "E0110", "end", "another name"),
        ("model A Mass m(m = 1); Spring s(k = 3); connect(m.flange, s.a); m.q = 1; end A;", "E0122", "connect", ""),
        ('model A Real q(unit = "meter") = 3; end A;', "E0304", '"meter"', "'m'"),
        ('model A Real q(unit = "Newton") = 3; end A;', "E0304", '"Newton"', "'N'"),
        ("model A spring spring(k = 1); end A;", "E0223", "spring", "'Spring'"),
        ("model A Real spring_ = 1; Real y = Spring; end A;", "E0301", "Spring", "'spring_'"),
        ("model A Real x, y; equation x + y = 1; end A;", "E0307", "A", "'x', 'y'"),
        ("model A Маss m(m = 1); end A;", "E0106", "Маss", "'Mass'"),  # noqa: RUF001  Cyrillic letters
        ("model A output Real x; end A;", "E0307", "A", "'x' occurs in no equation"),
        ("model A Mass m(m = 1); Fixed w; equation connect(w.flange, m.q); end A;", "E0305", "m.q",
         "the connectors of 'm' are flange"),
    ],
)  # fmt: skip
def test_one_right_message(text: str, code: str, marked: str | None, hint: str) -> None:
    (mistake,) = said(text)
    assert mistake.code == code and hint in mistake.hint
    if marked is not None:
        assert mistake.span.text == marked


def test_a_connect_lists_ports_only() -> None:
    (mistake,) = mistakes("model A Spring spring(k = 1); Mass m(m = 1); equation connect(spring.c, m.flange); end A;")
    assert mistake.hint == "its connectors are a, b"


def test_no_class_is_offered_for_a_variable() -> None:
    (mistake,) = mistakes("model A Real x = unit + 1; end A;")
    assert (mistake.code, mistake.hint) == ("E0201", "")


def test_conditions_in_time_alone_are_not_warned_of() -> None:
    quiet = "model A Real x = if time < 1 then 0 else abs(time - 2); end A;"
    assert flat(quiet).notes == ()
    assert [n.code for n in flat(quiet.replace("abs(time - 2)", "abs(z); Real z = sin(time)")).notes] == ["W0311"]


@pytest.mark.parametrize(
    ("part", "given", "name"),
    [
        ("Mass p(m = {})", "-2", "p.m"), ("Inertia p(J = {})", "-1e-9", "p.J"), ("Disk p(m = 1, r = {})", "-1", "p.r"),
        ("Disk p(m = {}, r = 1)", "-1", "p.m"), ("Mass p[2](m = {{1, {}}})", "-3", "p[2].m"),
    ],
)  # fmt: skip
def test_a_negative_mass_is_refused_where_it_is_given(part: str, given: str, name: str) -> None:
    text = f"model A {part.format(given)}; end A;"
    dae = lmoc.compile_text(text.replace(given, "1"))
    with pytest.raises(ModelError) as caught:
        dae.simulate(stop=1, parameters={name: float(given)})
    assert {d.code for d in caught.value.diagnostics if d.severity == "error"} == {"E0551"}
    assert name in str(caught.value)
    with pytest.raises(ModelError) as caught:
        lmoc.compile_text(text).simulate(stop=1)
    errors = [d for d in caught.value.diagnostics if d.severity == "error"]
    assert {d.code for d in errors} == {"E0551"}
    assert any(given in d.span.text and name in d.found for d in errors)


def test_limits_of_the_users_own_parameters() -> None:
    dae = lmoc.compile_text("""model A parameter Real k(min = 1, max = 2) = 1.5; Real x(start = k, fixed = true);
        equation der(x) = 0; end A;""")
    for value, fits in ((1.0, True), (2.0, True), (0.99, False), (2.01, False)):
        if fits:
            dae.simulate(stop=1, parameters={"k": value})
        else:
            with pytest.raises(ModelError, match="'k' must be at"):
                dae.simulate(stop=1, parameters={"k": value})


def test_protected_inputs_belong_to_their_class() -> None:
    text = """connector RealInput = input Real; connector RealOutput = output Real;
        block Source RealOutput y; equation y = 3*time; end Source;
        block Gain RealInput u; RealOutput y; equation y = 2*u; end Gain;
        block B Source s; Gain g; RealOutput y; protected RealInput inner_; RealInput other;
          equation connect(s.y, inner_); connect(inner_, g.u); connect(g.y, y); other = inner_; end B;
        model A B b; Real z = b.y; end A;"""
    assert lmoc.compile_text(text, model="A").simulate(stop=1)["z"][-1] == pytest.approx(6)
    assert codes(text.replace("protected RealInput inner_;", "RealInput inner_; protected"), "A") == ["E0315"]


def test_arrays_of_open_size_take_another_size() -> None:
    dae = lmoc.compile_text("""model A parameter Real v[:] = {1, 2, 3}; Real x(start = 0, fixed = true);
        equation der(x) = sum(v); end A;""")
    for values in ([1, 2], [5], [1, 2, 3, 4], [2, 2, 2]):
        assert dae.simulate(stop=1, parameters={"v": values})["x"][-1] == pytest.approx(sum(values))
    fixed = lmoc.compile_text("model A parameter Real v[3] = {1, 2, 3}; Real x = sum(v); end A;")
    with pytest.raises(ModelError):
        fixed.simulate(stop=1, parameters={"v": [1, 2]})
