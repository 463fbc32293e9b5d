"""Checks beside the typing: the newest text is answered, and a key does not cost a process."""

import threading

from lmoc.editor import background
from lmoc.editor.background import Checker, Request


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
