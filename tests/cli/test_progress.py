"""What a terminal is told about the progress of work that takes long."""

import re

import pytest

from lmoc.cli.progress import Progress


@pytest.fixture
def told(monkeypatch) -> list[str]:
    """The stages as they begin, each word of a label once."""
    stages: list[str] = []
    begin, reached = Progress.stage, Progress.reached

    def stage(self: Progress, name: str) -> None:
        begin(self, name)
        stages.append(self._stage)

    def advance(self: Progress, simulated: float, stop: float) -> None:
        reached(self, simulated, stop)
        stages.append(self._stage)

    monkeypatch.setattr(Progress, "stage", stage)
    monkeypatch.setattr(Progress, "reached", advance)
    return stages


READ = ["parse", "library", "flatten"]


@pytest.mark.parametrize(
    ("words", "stages"),
    [
        (["show", "--stage", "parse"], ["parse", "show"]),
        (["show"], [*READ, "show"]),
        (["show", "--stage", "reduce"], [*READ, "reduce", "show"]),
        (["equations"], [*READ, "reduce", "equations"]),
        (["equations", "--about-equilibrium"], [*READ, "reduce", "equations"]),
        (["linearize"], [*READ, "reduce", "linearize"]),
        (["equilibria"], [*READ, "reduce", "equilibria"]),
        (["transfer", "f", "body.q"], [*READ, "reduce", "transfer function"]),
        (["equivalent", "body.flange"], [*READ, "equivalent"]),
    ],
)
def test_every_verb_tells_its_stages(lmoc, scene, told, words, stages):
    answer = lmoc(words[0], scene, *words[1:])
    assert (answer.code, told) == (0, stages)
    assert answer.err == ""  # which is no terminal here


def test_a_check_does_not_claim_to_simulate(lmoc, scene, told):
    assert lmoc("check", scene).code == 0
    assert told[:4] == [*READ, "reduce"]
    assert "lower and start" in told and "simulate" not in told


def test_a_run_simulates_when_time_advances(lmoc, scene, told, monkeypatch):
    from lmoc.numerics.problem.base import Watch

    monkeypatch.setattr(Watch, "EVERY", 0.0)
    assert lmoc("run", scene, "--stop", "100").code == 0
    assert told.index("lower and start") < told.index("simulate")
    assert told[-1] == "simulate"


def test_a_log_is_told_that_long_work_goes_on(monkeypatch, capsys):
    from lmoc.cli import progress

    monkeypatch.setattr(progress, "TOLD", 0.0)
    monkeypatch.setattr(progress, "_LOOK", 1e-3)
    said = ""
    with Progress() as shown:
        shown.stage("equilibria")
        while "equilibria" not in said or not said.endswith("\n"):  # the first lines may come before the stage is known
            said += capsys.readouterr().err
        shown.reached(0.0, 4.0)
        shown.reached(1.0, 4.0)
    assert re.search(r"^lmoc: equilibria goes on after \d+ s$", said, re.MULTILINE)  # s of work of the whole command
    told = Progress(enabled=False)
    with told:
        assert told._thread is None
