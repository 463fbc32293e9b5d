"""What the tests of the command share."""

import gc
import os
import signal
import sys
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import pytest
from hypothesis import HealthCheck, settings

ROOT = Path(__file__).parents[1]

# the same examples in every run of the suite; HYPOTHESIS_PROFILE=random searches further.
# How long a machine takes that is busy with other things decides about no test.
PATIENT = settings(deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.register_profile("same", PATIENT, derandomize=True)
settings.register_profile("random", PATIENT)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "same"))

# a shell starts its background jobs with Ctrl-C ignored, and tests of Ctrl-C would inherit that
signal.signal(signal.SIGINT, signal.default_int_handler)

# every structure that a stage hands on is checked (in child processes too) where tests are about the stages, or about
# random scenes; what others compile is of a kind that has been checked there, and compiles a third faster without
CHECKED = {"expression", "ir", "lower", "semantics", "sources", "structure", "syntax", "wrong"}

# hundreds of processes are started, each of which would compile the package where bytecode is not to be written
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False

# one thread of the BLAS in tests that call the package, as in the command; several processes run them at a time
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

SPRING = """\
model Oscillator "A mass on a spring"
  parameter Real k(unit = "N/m") = 8 "stiffness";
  input Real f(unit = "N") = 0 "push";
  output Real x(unit = "m") = body.q "where the body is";
  Fixed wall;
  Spring spring(k = k);
  Mass body(m = 2, q(start = 0.5, fixed = true));
  Force push(f = f);
equation
  connect(wall.flange, spring.a);
  connect(spring.b, body.flange);
  connect(push.flange, body.flange);
  annotation(experiment(StopTime = 3));
end Oscillator;
"""


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config, log):
    """Tests that stand together go to one process, which shares what they compile; who ends first takes of the rest."""
    from xdist.scheduler import WorkStealingScheduling

    return WorkStealingScheduling(config, log) if config.getvalue("dist") == "load" else None


def pytest_collection_finish(session: pytest.Session) -> None:
    """Ten thousand tests and what they import stay: the collector of garbage need not look at them again and again."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(20_000, 20, 20)


def pytest_runtest_setup(item: pytest.Item) -> None:
    checked = item.path.parent.name in CHECKED or item.path.name.startswith("test_random")
    os.environ["LMOC_CHECK"] = str(int(checked))


class Answer(NamedTuple):
    """What a command has given back."""

    code: int
    out: str
    err: str


@pytest.fixture
def lmoc(capsys, monkeypatch, tmp_path) -> Callable[..., Answer]:
    """Runs the command inside this process, in a folder of its own."""
    from lmoc.cli.main import main

    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("TMPDIR", str(tmp_path))

    def call(*words: object) -> Answer:
        code = main([str(w) for w in words])
        captured = capsys.readouterr()
        return Answer(code, captured.out, captured.err)

    return call


@pytest.fixture
def scene(tmp_path) -> Path:
    """A file with a mass on a spring."""
    path = tmp_path / "oscillator.lmo"
    path.write_text(SPRING)
    return path
