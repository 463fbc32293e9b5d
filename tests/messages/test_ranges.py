"""What is said of every member of an array is said once."""

import pytest

import lmoc
from lmoc.messages.diagnostics import Diagnostic, Report
from lmoc.messages.ranges import over_range, ranges, report_alike


def test_indices_become_ranges():
    assert over_range(["m[1].q", "m[2].q", "m[3].q"]) == "m[1:3].q"
    assert over_range(["a[1] and b[2]", "a[2] and b[3]"]) == "a[1:2] and b[2:3]"
    assert over_range([f"g[{i},{j}].x = s[{j}]" for i in (1, 2) for j in (4, 5, 6)]) == "g[1:2,4:6].x = s[4:6]"
    assert over_range(["m[3]", "m[1]", "m[2]"]) == "m[1:3]"
    assert over_range(["m"]) == "m"


@pytest.mark.parametrize("texts", [["m[1]", "m[3]"], ["g[1,1]", "g[2,2]", "g[1,2]"], ["m[1]", "m[1]"]])
def test_what_fills_no_range_is_not_one(texts):
    assert over_range(texts) is None


def test_names_of_several_arrays():
    assert ranges(["a[1]", "b", "a[2]", "a[3]", "c[1]", "c[5]"]) == ["a[1:3]", "b", "c[1]", "c[5]"]


def told(*found: tuple[str, str], most: int = 2, unseen: int = 0) -> list[tuple[str, str]]:
    report = Report()
    report_alike([Diagnostic("E0402", m, found=f) for m, f in found], report, most, unseen)
    return [(" | ".join(filter(None, [d.message, d.hint])), d.found) for d in report.diagnostics]


def test_one_for_all_members():
    assert told(("r[1] floats", "x[1] = 0"), ("r[2] floats", "x[2] = 0")) == [("r[1:2] floats", "x[1:2] = 0")]
    assert told(("r[1] floats", "1"), ("r[2] floats", "2")) == [("r[1:2] floats", "of the first: 1")]
    assert told(("r[1] floats", ""), ("r[5] floats", "")) == [("r[1] floats", ""), ("r[5] floats", "")]


def test_members_that_are_not_all_side_by_side():
    floating = [(f"r[{i}] floats", "") for i in (1, 2, 3, 5, 6, 8, 10)]
    assert told(*floating) == [("r[1:3] floats", ""), ("r[5:6] floats, and 2 more like it", "")]
    grid = [(f"r[{i},{j}] floats", "") for i in (1, 2) for j in (1, 2, 3)][:-1]
    assert told(*grid) == [("r[1,1:3] floats", ""), ("r[2,1:2] floats", "")]


def test_what_is_cut_is_counted():
    unlike = [(f"{name} floats", "") for name in "abcd"]
    assert told(*unlike) == [("a floats", ""), ("b floats | 2 more such mistakes are not shown", "")]
    assert told(*unlike[:2], unseen=1)[-1] == ("b floats | 1 more place was not examined", "")
    assert told(*unlike, most=4)[-1] == ("d floats", "")


def said(body: str, **more: object) -> list[tuple[str, str]]:
    """Codes and messages of the errors, or else the warnings, of a check and a run of a model."""
    dae = lmoc.compile_text(f"model T {body} end T;")
    try:
        return [(d.code, d.message) for d in dae.simulate(stop=0.1, **more).notes if d.severity == "warning"]
    except lmoc.ModelError as error:
        return [(d.code, d.message) for d in error.diagnostics if d.severity == "error"]


TWO = """Mass m[30](each m = 1, each q(start = 1, fixed = true));
Mass n[30](each m = 1, each q(start = 2, fixed = true));
equation for i in 1:30 loop connect(m[i].flange, n[i].flange); end for;"""


@pytest.mark.parametrize(
    ("body", "expected"),
    [
        ("Mass m[30];", [("E0530", "parameter 'm[1:30].m' has no value")]),
        (
            "parameter Real c[30]; parameter Real e; Mass m[30](m = c + fill(e, 30));",
            [("E0530", "parameter 'c[1:30]' has no value"), ("E0530", "parameter 'e' has no value")],
        ),
        (
            "Mass m[30](each m = 1, each q(start = 1, fixed = true)); Rod r[29](each L = 1); equation"
            " for i in 1:29 loop connect(m[i].flange, r[i].a); connect(r[i].b, m[i+1].flange); end for;",
            [("E0531", "the fixed values m[1:30].q = 1 contradict each other")],
        ),
        (TWO, [("E0531", "the fixed values m[1:30].q = 1 and n[1:30].q = 2 contradict each other")]),
        (
            "Real y[30]; equation for i in 1:30 loop y[i] = log(-i - time); end for;",
            [("W0537", "y[1:30] has no finite value (nan) at the start")],
        ),
        (
            "Real y[30]; equation for i in 1:30 loop y[i] = sqrt(abs(i - 3) - 1.5 - time); end for;",
            [("W0537", "y[2:4] has no finite value (nan) at the start")],
        ),
        (
            "parameter Real z = 0; parameter Real c[30] = {1/z for i in 1:30};",
            [("W0537", "c[1:30] has no finite value (inf)")],
        ),
        (
            "parameter Real z[30] = fill(0, 30); Real c[30] = {1/z[i] for i in 1:30}; equation",
            [("W0537", "c[1:30] has no finite value (inf)")],
        ),
    ],
)
def test_arrays_in_runs(body, expected):
    assert said(body) == expected


def test_one_message_for_ten_thousand():
    assert said("Mass m[10000];") == [("E0530", "parameter 'm[1:10000].m' has no value")]


def test_a_value_that_is_not_a_number_is_not_missing():
    told = said("Mass m(m = 2);", parameters={"m.m": float("nan")})
    assert told == [("E0530", "the value given for parameter 'm.m' is not a number (nan)")]
    told = said("parameter Real z = 0; Mass m(m = z/z);")
    assert told == [("E0530", "the value of parameter 'm.m' is not a number (nan)")]


def test_the_place_of_a_value_from_elsewhere_is_not_in_the_model():
    with pytest.raises(lmoc.ModelError) as caught:
        lmoc.compile_text("model T Mass m(m = 2); end T;").simulate(parameters={"m.m": float("nan")})
    assert [(d.code, d.span) for d in caught.value.diagnostics if d.code != "W0312"] == [
        ("W0537", None),
        ("E0530", None),
    ]


def test_an_input_without_signal_is_told_once():
    """Also where its derivatives are needed."""
    parts = "input Real u; Motion M(q = u); Spring s(k = 3); Damper d(c = 1); Mass m(m = 2);"
    wires = "connect(M.flange, s.a); connect(s.b, m.flange); connect(M.flange, d.a); connect(d.b, m.flange);"
    assert said(f"{parts} equation {wires}") == [("E0520", "input 'u' has no signal")]
