"""Checks beside the typing: the newest text is answered, and a key costs no process and little of what is known."""

import threading

import pytest

from lmoc.editor import background, checking
from lmoc.editor.background import Checker, Request
from lmoc.editor.checking import Checks, Stopped, check

THREE = """model A
  Real x = y;
end A;
model B
  P p(k = 2);
end B;
model C
  P p(l = 2);
end C;
model P
  parameter Real k = 1;
end P;
"""


def test_models_that_have_not_changed_are_not_checked_again(monkeypatch):
    asked, checks = [], Checks()
    checked = checking._Text.checked
    monkeypatch.setattr(checking._Text, "checked", lambda self, m: (asked.append(m.name), checked(self, m))[1])
    first = checks.check(THREE, "/nowhere/three.lmo")
    assert sorted(f.code for f in first.findings) == ["E0201", "E0205"] and asked == ["A", "B", "C"]
    steps = {
        "model B\n": ("model B  // moved\n\n", ["B"]),
        "l = 2": ("l = 3", ["C"]),
        "k = 1": ("l = 1", ["B", "C"]),  # in P, of which both are made
        "Real x = y": ("Real x = y; Real y = 1", ["A"]),
        "end P;": ("end P", ["B", "C"]),
    }
    text = THREE
    for old, (new, again) in steps.items():
        text = text.replace(old, new)
        asked.clear()
        found = checks.check(text, "/nowhere/three.lmo")
        assert sorted(asked) == again
        assert found == check(text, "/nowhere/three.lmo")
    with pytest.raises(Stopped):
        checks.check(THREE, "/nowhere/three.lmo", lambda: False)


def test_models_in_a_package_are_checked_one_by_one(monkeypatch):
    asked, checks, checked = [], Checks(), checking._Text.checked
    monkeypatch.setattr(checking._Text, "checked", lambda self, m: (asked.append(m.name), checked(self, m))[1])
    text = "package Q\n" + "".join(f"  {line}\n" for line in THREE.splitlines()) + "end Q;\n"
    first = checks.check(text, "/nowhere/pack.lmo")
    places = {f.code: text[f.place.start : f.place.end] for f in first.findings}
    assert places == {"E0201": "y", "E0205": "l = 2"} and asked == ["Q.A", "Q.B", "Q.C"]
    steps = {
        "model B\n": ("model B  // moved\n\n", ["Q.B"]),
        "Real x = y": ("Real x = y +", ["Q.A"]),
        "k = 1": ("l = 1", ["Q.B", "Q.C"]),
        "package Q\n": ("package Q\n  constant Real y = 1;\n", ["Q.A", "Q.B", "Q.C"]),
    }
    for old, (new, again) in steps.items():
        text = text.replace(old, new)
        asked.clear()
        assert checks.check(text, "/nowhere/pack.lmo") == check(text, "/nowhere/pack.lmo")
        assert sorted({*asked}) == ["Q.A", "Q.B", "Q.C"] and all(asked.count(m) == 2 for m in again)


def test_of_a_class_without_end_it_is_said_what_follows():
    found = check("model X\n  Real x = 1;\n" + THREE, "/nowhere/two.lmo").findings
    assert [f.found for f in found if f.code == "W0246"] == ["the next class"]


def test_of_many_models_all_are_checked_and_those_that_changed_last_first(monkeypatch):
    asked, checks, checked, parts = [], Checks(), checking._Text.checked, []
    monkeypatch.setattr(checking._Text, "checked", lambda self, m: (asked.append(m.name), checked(self, m))[1])
    text = "".join(f"model M{k}\n  Real x = y{k};\nend M{k};\n" for k in range(25))
    found = checks.check(text, "/nowhere/many.lmo", tell=lambda part: parts.append(part()))
    assert [f.found for f in found.findings] and len(found.findings) == len(asked) == found.models == 25
    assert [p.left for p in parts] == [*range(24, 0, -1)] and parts[6].findings == found.findings[:7]
    asked.clear()
    text = text.replace("y3;", "z3;").replace("end M20;", "end M20;\n")
    with pytest.raises(Stopped):
        checks.check(text, "/nowhere/many.lmo", lambda: len(asked) < 1)
    asked.clear()
    text = text.replace("y22;", "z22;").replace("model M0\n", "model M0\n  constant Real c = 1;\n")
    assert checks.check(text, "/nowhere/many.lmo") == check(text, "/nowhere/many.lmo")
    assert asked[:2] == ["M0", "M22"]


def test_a_text_that_is_saved_is_not_checked_again(monkeypatch, tmp_path):
    asked, checks, checked = [], Checks(), checking._Text.checked
    monkeypatch.setattr(checking._Text, "checked", lambda self, m: (asked.append(m.name), checked(self, m))[1])
    path = tmp_path / "Old.lmo"
    text = "model A\n  Real x = y;\nend A;\nmodel B\n  Real x = z;\nend B;\n"
    for own, again in (text, []), (text.replace("Real", "Old", 1), ["A"]):  # a class of the file as it was
        path.write_text("model Old\nend Old;\n")
        before = checks.check(own, str(path))
        asked.clear()
        path.write_text(own)
        after = checks.check(own, str(path))
        assert [m for m in asked if m == "A"] == again and (after != before) == bool(again)
        assert after == check(own, str(path))
    (tmp_path / "Other.lmo").write_text("model Other\nend Other;\n")
    asked.clear()
    checks.check(own, str(path))
    assert asked == ["A", "B"]


def test_a_newer_text_waits_for_a_check_that_is_short(monkeypatch):
    monkeypatch.setattr(background, "PATIENCE", float("inf"))
    said, ready = [], threading.Event()

    def deliver(request, checked):
        said.append((request.version, [f.code for f in checked.findings]))
        ready.set()

    checker = Checker(deliver)
    try:
        checker.ask(Request("/nowhere/m.lmo", "model M\n  Real x = 1;\nend M;\n", 0))
        assert ready.wait(120)
        process = checker._process
        ready.clear()
        for version, text in enumerate(("model M\n  Real x = y;\nend M;\n", "model M\n  Real x = 1\nend M;\n"), 1):
            checker.ask(Request("/nowhere/m.lmo", text, version))
        while not said or said[-1][0] != 2:
            assert ready.wait(120)
            ready.clear()
        assert said[0] == (0, []) and said[-1] == (2, ["E0102"])
        assert checker._process is process and process.is_alive()
    finally:
        checker.close()


def test_a_second_file_does_not_wait_for_all_models_of_the_first():
    last, ready = [], threading.Event()

    def deliver(request, checked):
        if not checked.left:
            last.append((request.path, len(checked.findings)))
            if len(last) == 2:
                ready.set()

    checker = Checker(deliver)
    try:
        many = "".join(f"model M{k}\n  Real x = y{k};\nend M{k};\n" for k in range(30))
        checker.ask(Request("/nowhere/many.lmo", many, 0))
        while checker._running is None:
            pass
        checker.ask(Request("/nowhere/one.lmo", "model M\n  Real x = y;\nend M;\n", 0))
        assert ready.wait(120)
        assert last == [("/nowhere/one.lmo", 1), ("/nowhere/many.lmo", 30)]
    finally:
        checker.close()
