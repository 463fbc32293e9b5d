"""Names: enclosing classes, packages, imports, shadowing, inner and outer, protected."""

import pytest
from oracles.flattening import codes, equations, flat, mistakes, value

from lmoc.messages.diagnostics import ModelError, Report
from lmoc.messages.source import Source
from lmoc.semantics.flatten import flatten
from lmoc.syntax.parse import parse


def test_a_constant_of_an_enclosing_package_is_found() -> None:
    dae = flat("""
        package P
          constant Real g = 9.81;
          model A Real x = g; end A;
        end P;""")
    assert equations(dae) == ["x = 9.81"]
    assert dae.name == "P.A"


def test_constants_of_packages_may_use_each_other() -> None:
    dae = flat("""
        package P
          constant Real b = 2*a;
          constant Real a = 3;
        end P;
        model A parameter Real x = P.b; end A;""")
    assert value(dae, "x") == 6


@pytest.mark.parametrize(
    ("clause", "name"),
    [
        ("import P.Q;", "Q.c"),
        ("import R = P.Q;", "R.c"),
        ("import P.Q.*;", "c"),
        ("import P.Q.c;", "c"),
        ("import P.Q.{c, d};", "c"),
        ("", "P.Q.c"),
        ("", ".P.Q.c"),
    ],
)
def test_every_form_of_import(clause: str, name: str) -> None:
    dae = flat(f"""
        package P package Q constant Real c = 5; constant Real d = 6; end Q; end P;
        model A {clause} parameter Real x = {name}; end A;""")
    assert value(dae, "x") == 5


def test_the_users_class_shadows_the_librarys_but_not_for_the_library() -> None:
    dae = flat("""
        model Inertia parameter Real a = 1; end Inertia;
        model A
          Inertia mine;
          Disk disk(m = 2, r = 1);
        end A;""")
    assert value(dae, "mine.a") == 1
    assert value(dae, "disk.J") == 1


def test_an_absolute_name_reaches_the_library_past_a_shadow() -> None:
    dae = flat("""
        package Own model Mass parameter Real a = 1; end Mass; end Own;
        model A import Own.*; Mass mine; .Mass theirs(m = 3); end A;""")
    assert value(dae, "mine.a") == 1
    assert value(dae, "theirs.m") == 3


def test_encapsulated_classes_do_not_see_out() -> None:
    assert codes("""
        package P
          constant Real g = 9.81;
          encapsulated model A Real x = g; end A;
        end P;""") == ["E0201"]


def test_a_local_class_and_a_local_type() -> None:
    dae = flat(
        """
        model A
          type Length = Real(unit = "m", start = 2);
          model B Length x; equation der(x) = 1; end B;
          B b;
        end A;""",
        model="A",
    )
    (block,) = [b for b in dae.blocks if b.pattern == "b.x"]
    assert block.unit == "m"


def test_inherited_equations_see_the_names_of_their_own_class() -> None:
    dae = flat(
        """
        package P
          constant Real c = 1;
          partial model Base Real x = c; end Base;
        end P;
        model A extends P.Base; constant Real c = 2; end A;""",
        model="A",
    )
    assert equations(dae) == ["x = 1"]


def test_inner_and_outer_are_one_variable() -> None:
    dae = flat("""
        model Part outer Real g; Real x = g; end Part;
        model Middle Part p; end Middle;
        model A inner Real g = 9.81; Middle m[2]; end A;""")
    assert equations(dae, "binding") == ["g = 9.81", "m[1].p.x = g", "m[2].p.x = g"]


def test_an_inner_part_that_nobody_declared_has_its_own_values() -> None:
    dae = flat("""
        model World parameter Real g = 9.81; end World;
        model Body outer World world; Real w = 2*world.g; end Body;
        model Pair Body a, b; end Pair;
        model A Pair p[2]; end A;""")
    assert sorted(equations(dae, "binding")) == [f"p[{i}].{body}.w = 2*world.g" for i in (1, 2) for body in "ab"]
    assert value(dae, "world.g") == 9.81


def test_no_default_stands_in_for_a_name_that_is_taken() -> None:
    with pytest.raises(ModelError, match="E0214"):
        flat("""
            model World parameter Real g = 9.81; end World;
            model Body outer World world; Real w = 2*world.g; end Body;
            model A Real world = 3; Body a; end A;""")


def test_an_inner_part_is_shared() -> None:
    dae = flat("""
        model World parameter Real g = 9.81; end World;
        model Body outer World world; Real w = 2*world.g; end Body;
        model A inner World world(g = 1.6); Body a, b; end A;""")
    assert equations(dae, "binding") == ["a.w = 2*world.g", "b.w = 2*world.g"]
    assert value(dae, "world.g") == 1.6


def test_protected_elements_are_hidden() -> None:
    text = """
        model B protected parameter Real p = 1; Real x = p; end B;
        model A B b%s; %s end A;"""
    assert codes(text % ("(p = 2)", "")) == ["E0210"]
    assert codes(text % ("", "Real y = b.x;")) == ["E0210"]
    dae = flat(text % ("", ""))
    assert all(b.protected for b in dae.blocks if b.path[0][0] == "b")


def test_hints_name_the_nearest() -> None:
    (error,) = mistakes("model A Sprig s(k = 1); end A;")
    assert error.code == "E0202" and "'Spring'" in error.hint
    (error,) = mistakes("model A Real speed; equation der(speeed) = 1; end A;")
    assert error.code == "E0201" and "'speed'" in error.hint


def test_several_mistakes_are_named_at_once_and_do_not_cascade() -> None:
    found = codes("""
        model A
          Sprng s(k = 1);
          Real x = s.f;
          Real y = unknown1;
          Real z = unknown2;
        equation
          connect(s.a, s.b);
        end A;""")
    assert found == ["E0202", "E0201", "E0201"]


def test_each_element_of_an_array_has_its_own_inner() -> None:
    dae = flat("""
        model Part outer Real g; Real x = g; end Part;
        model Cell inner Real g = h; parameter Real h = 1; Part p[2]; end Cell;
        model A Cell c[2](h = {3, 4}); end A;""")
    assert "c[2].p[1].x = c[2].g" in equations(dae)
    assert "c[2].g = c[2].h" in equations(dae)
    assert value(dae, "c.h") == [3, 4]


def test_files_within_a_package() -> None:
    texts = (
        "package P constant Real c = 2; end P;",
        "within P; package Q model B parameter Real p = c; end B; end Q;",
        "within P.Q; model D extends B; parameter Real q = 2*p; end D;",
        "model A P.Q.D d; end A;",
    )
    report = Report()
    files = [parse(Source(f"{k}.lmo", text), report) for k, text in enumerate(texts)]
    dae = flatten(files, (), "A", {}, report)
    assert value(dae, "d.q") == 4
    with pytest.raises(ModelError) as error:
        flatten([files[1]], (), None, {}, Report())
    assert error.value.diagnostics[0].code == "E0202"
    assert flatten(files, (), "P.Q.D", {}, Report()).name == "P.Q.D"


def test_which_model() -> None:
    one = "model B Real x = 1; end B; model C extends B; end C; package P model D B b; end D; end P;"
    assert codes(one) == ["E0603"]
    assert codes(one, model="X") == ["E0601"]
    assert flat(one, model="P.D").name == "P.D"
    assert flat(one, model="Inertia").name == "Inertia"
    assert codes("partial model A end A;") == ["E0602"]


def test_the_one_model_at_the_top_is_meant() -> None:
    library = "package P model D Real x = 1; end D; model E Real x = 1; end E; end P; block G Real x = 1; end G; "
    assert flat(library + "partial model A end A; model B extends A; P.D d; end B;").name == "B"
    assert codes(library) == ["E0603"]
    assert codes(library + "model B end B; model C end C;") == ["E0603"]
    assert codes("partial model A end A;", model="A") == ["E0209"]
    assert codes("package P end P;", model="P") == ["E0601"]


def test_one_base_reached_by_two_ways_is_there_once() -> None:
    text = """partial model P parameter Real k = 1; Real z; equation z = k*time; end P;
      partial model A extends P; end A; partial model B extends P{}; end B;
      model M extends A{}; extends B; Real y = 2*z; end M;"""
    assert sorted(equations(flat(text.format("", "")))) == ["y = 2*z", "z = k*time"]
    assert value(flat(text.format("(k = 3)", "")), "k") == 3
    assert value(flat(text.format("", "(k = 4)")), "k") == 4
    assert codes(text.format("(k = 3)", "(k = 4)")) == ["E0204"]
    assert codes("model M Real x = 1; Real x = 1; end M;") == ["E0204"]
