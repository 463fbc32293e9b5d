"""Random modifications, extensions and redeclarations against a direct reading of the specification (7.2, 7.3).

Every model draws what may give a value to the parameter of an innermost part; the oracle walks that list from outside.
"""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from oracles.flattening import codes, flat, value

NUMBERS = st.one_of(st.none(), st.integers(1, 99))
PLACES = ("component", "extends", "redeclared", "constraint", "declared", "type")


@st.composite
def scenes(draw: st.DrawFn) -> tuple[str, float]:
    """A text, and the value that `a.e.k` has in it."""
    k = {place: draw(NUMBERS) for place in PLACES}
    redeclare = draw(st.sampled_from(["none", "component", "extends", "element", "class"]))
    constrained = draw(st.booleans())
    wrapped = draw(st.integers(0, 2))
    if redeclare in ("component", "extends") and k[redeclare] is not None:
        k["redeclared"] = None  # one modification gives a value once

    def mod(place: str, inside: str = "") -> str:
        parts = [f"k = {k[place]}"] if k[place] is not None else []
        return f"({', '.join([*parts, inside] if inside else parts)})" if parts or inside else ""

    of_class = redeclare == "class"
    clause = f" constrainedby E1{mod('constraint')}" if constrained else ""
    if of_class:
        body = f"replaceable model E = E1{mod('declared')}{clause}; E e;"
    else:
        body = f"replaceable E1 e{mod('declared')}{clause};"
    new = f"redeclare model E = E2{mod('redeclared')}" if of_class else f"redeclare E2 e{mod('redeclared')}"
    outer = [f"e{mod('component')}"] if k["component"] is not None and redeclare != "component" else []
    if redeclare == "component" and k["component"] is not None:
        outer = [f"e.k = {k['component']}"]
    if redeclare in ("component", "class"):
        outer.insert(0, new)
    base = [f"e{mod('extends')}"] if k["extends"] is not None else []
    if redeclare == "extends":
        base = [new, *([f"e.k = {k['extends']}"] if k["extends"] is not None else [])]
    element = f"{new};" if redeclare == "element" else ""
    text = f"""model E1 parameter Real k = {k['type'] or 0}; end E1; model E2 extends E1; end E2;
        model S {body} end S;
        model N extends S{f"({', '.join(base)})" if base else ""}; {element} end N;
        model A {"N" if not wrapped else "W1"} a{f"({wrap(outer, wrapped)})" if outer else ""}; end A;
        """
    text += "".join(f"model W{i} {'N' if i == wrapped else f'W{i + 1}'} w; end W{i};\n" for i in range(1, wrapped + 1))
    order = ["component"]
    order += ["redeclared", "extends"] if redeclare == "element" else ["extends", "redeclared"]
    if redeclare in ("component", "class"):
        order = ["component", "redeclared", "extends"] if not of_class else ["component", "extends", "redeclared"]
    if redeclare == "none":
        order = ["component", "extends", "declared", "constraint"]
        order = order if constrained else order[:-1]
    else:
        order += ["constraint"] if constrained else ["declared"]
    found = next((k[place] for place in [*order, "type"] if k[place] is not None), 0)
    return text, found, "a" + ".w" * wrapped + ".e.k"


def wrap(outer: list[str], levels: int) -> str:
    text = ", ".join(outer)
    for _ in range(levels):
        text = f"w({text})"
    return text


@settings(max_examples=150)
@given(scenes())
def test_the_outermost_modification_wins(scene: tuple[str, float, str]) -> None:
    text, expected, name = scene
    assert value(flat(text, "A", library=False), name) == expected


@pytest.mark.parametrize("twice", ["e(k = 1), e.k = 2", "redeclare E2 e(k = 1), e.k = 2", "e.k = 1, e(k = 2)"])
def test_one_modification_gives_a_value_once(twice: str) -> None:
    text = f"""model E1 parameter Real k = 0; end E1; model E2 extends E1; end E2;
        model S replaceable E1 e; end S; model A S a({twice}); end A;"""
    assert codes(text, "A") == ["E0221"]


@pytest.mark.parametrize("level", range(4))
@pytest.mark.parametrize("kind", ["Real", "Integer", "model", "function", "missing", "final"])
def test_illegal_redeclarations_are_refused_at_every_level(level: int, kind: str) -> None:
    wrong = {
        "Real": ("redeclare Real e", "E0243"),
        "Integer": ("redeclare Integer x", "E0243"),
        "model": ("redeclare model M = Other", "E0243"),
        "function": ("redeclare function M = f", "E0243"),
        "missing": ("redeclare model Nothing = Other", "E0205"),
        "final": ("redeclare E1 fixed_", "E0206"),
    }
    argument, code = wrong[kind]
    levels = "".join(f"model L{i} {'S' if i == 0 else f'L{i - 1}'} w; end L{i};\n" for i in range(level))
    text = f"""model E1 parameter Real k = 1; end E1; model Other Real z = 0; end Other;
        function f output Real y; algorithm y := 1; end f;
        model S replaceable E1 e; E1 fixed_; replaceable model M = E1; M m; replaceable parameter Real x = 1; end S;
        {levels} model A {f"L{level - 1}" if level else "S"} a({wrap([argument], level)}); end A;"""
    assert codes(text, "A") == [code]
