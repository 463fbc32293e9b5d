"""The command among other processes: closed and full streams, full disks, signals."""

import os
import resource
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from conftest import SPRING

COMMAND = [sys.executable, "-m", "lmoc"]
LONG = ["run", "oscillator.lmo", "--stop", "1e7", "--points", "100001", "-o", "kept.csv"]


def lmoc(*words: str, before=None, **settings) -> subprocess.CompletedProcess:
    return subprocess.run(
        [*COMMAND, *words], preexec_fn=before, stderr=subprocess.PIPE, text=True, timeout=120, **settings
    )


def wait_for_work(process: subprocess.Popen, seconds: float) -> None:
    """Wait until a process has used so much processor time: it is as far then on a busy machine as on an idle one."""
    table = Path(f"/proc/{process.pid}/stat")
    if not table.exists():  # not Linux
        time.sleep(2 * seconds)
        return
    while sum(map(int, table.read_text().rpartition(")")[2].split()[11:13])) < seconds * os.sysconf("SC_CLK_TCK"):
        time.sleep(0.02)


# an import within such a limit leaves a piece of bytecode in the environment, which no process can load any more
NO_BYTECODE = {**os.environ, "PYTHONDONTWRITEBYTECODE": "1"}


def small_files() -> None:
    resource.setrlimit(resource.RLIMIT_FSIZE, (64, 64))


@pytest.fixture
def folder(tmp_path: Path, scene: Path) -> Path:
    assert scene.parent == tmp_path
    return tmp_path


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="a device of Linux")
@pytest.mark.parametrize("words", [["run", "oscillator.lmo"], ["--help"], ["check", "oscillator.lmo"]])
def test_a_full_device_is_told_in_a_line(folder, words):
    with open("/dev/full", "w") as full:
        answer = lmoc(*words, stdout=full, cwd=folder)
    assert answer.returncode == 2
    assert answer.stderr == "failed: standard output cannot be written: No space left on device\n"


@pytest.mark.parametrize(("words", "code"), [(["--quiet"], 0), ([], 2)])
def test_closed_output_matters_where_there_is_something_to_say(folder, words, code):
    answer = lmoc("run", "oscillator.lmo", "-o", "x.csv", *words, before=lambda: os.close(1), cwd=folder)
    assert answer.returncode == code
    assert answer.stderr == ("" if code == 0 else "failed: standard output cannot be written: Bad file descriptor\n")
    assert np.genfromtxt(folder / "x.csv", delimiter=",", names=True)["time"][-1] == 3


def test_nothing_of_standard_error_ends_up_in_a_result(folder):
    def close_all() -> None:
        for number in range(3):
            os.close(number)

    wrong = SPRING.replace("k = k", "k = k, L = L").replace("parameter", "parameter Real L = 0; parameter", 1)
    (folder / "oscillator.lmo").write_text(wrong.replace('Real k(unit = "N/m")', 'Real k(unit = "N")'))
    lmoc("run", "oscillator.lmo", "-o", "x.csv", before=close_all, cwd=folder)
    assert not (folder / "x.csv").exists()


def test_a_reader_that_has_seen_enough_hears_nothing(folder):
    reading, writing = os.pipe()
    os.close(reading)
    answer = lmoc("run", "oscillator.lmo", stdout=writing, cwd=folder)
    os.close(writing)
    assert (answer.returncode, answer.stderr) == (0, "")


def test_formatting_on_a_full_disk_leaves_the_file(folder):
    before = (folder / "oscillator.lmo").read_text().replace("  Fixed", "     Fixed")
    (folder / "oscillator.lmo").write_text(before)
    answer = lmoc("fmt", "oscillator.lmo", before=small_files, env=NO_BYTECODE, cwd=folder)
    assert answer.returncode == 2 and "error[E0623]" in answer.stderr and "unchanged" in answer.stderr
    assert (folder / "oscillator.lmo").read_text() == before
    assert os.listdir(folder) == ["oscillator.lmo"]


@pytest.mark.parametrize("name", ["x.csv", "x.mat", "x.png"])
def test_a_result_on_a_full_disk_leaves_the_one_before(folder, name):
    (folder / name).write_text("the result of yesterday")
    option = "--plot" if name == "x.png" else "-o"
    answer = lmoc("run", "oscillator.lmo", option, name, before=small_files, env=NO_BYTECODE, cwd=folder)
    assert answer.returncode == 2 and "error[E0623]" in answer.stderr and "internal" not in answer.stderr
    assert (folder / name).read_text() == "the result of yesterday"
    assert sorted(os.listdir(folder)) == ["oscillator.lmo", name]


@pytest.mark.parametrize(("number", "code", "background"), [(signal.SIGINT, 130, False), (signal.SIGTERM, 143, True)])
def test_a_signal_while_running_keeps_what_there_is(folder, number, code, background):
    """A shell script starts its background jobs with Ctrl-C ignored."""
    before = (lambda: signal.signal(signal.SIGINT, signal.SIG_IGN)) if background else None
    for seconds in (1.2, 3, 8, 20):
        process = subprocess.Popen([*COMMAND, *LONG], cwd=folder, preexec_fn=before, text=True, stderr=subprocess.PIPE,
                                   stdout=subprocess.DEVNULL)  # fmt: skip
        wait_for_work(process, seconds)
        process.send_signal(number)
        _, said = process.communicate(timeout=60)
        assert process.returncode == code and "Traceback" not in said
        begun = said != "failed: interrupted\n"
        times = np.genfromtxt(folder / "kept.csv", delimiter=",", names=True)["time"] if begun else np.zeros(0)
        if times.size > 1:
            break  # else before the run had got on: where others use the processors, too, all takes longer
    assert "it was interrupted" in said
    assert times.size < 100001 and (np.diff(times) > 0).all()


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_at_any_moment_ends_quietly(folder, number):
    """While files are imported, parsed, reduced: a line, no traceback, no file of an internal error."""
    for wait in np.linspace(0.12, 0.9, 8)[number == signal.SIGTERM :: 2]:
        environment = {**os.environ, "TMPDIR": str(folder)}
        process = subprocess.Popen([*COMMAND, *LONG], cwd=folder, text=True, env=environment,
                                   stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)  # fmt: skip
        time.sleep(wait)
        process.send_signal(number)
        _, said = process.communicate(timeout=60)
        assert "mistake in lmoc" not in said
        if "Traceback" in said:  # Python itself was still starting: nothing of lmoc had been run
            assert "lmoc/" not in said
    assert not list(folder.glob("lmoc-*.txt"))


SWALLOWS = """import os, signal
try:
    os.kill(os.getpid(), signal.SIGINT)
    for _ in range(1000): pass
except KeyboardInterrupt:
    pass
error = ImportError("an extension could not be initialized")
"""


@pytest.mark.parametrize("interrupted", [True, False])
def test_an_extension_that_swallows_an_interruption_while_it_loads(folder, interrupted):
    """It raises an error of its own that says nothing of it; without an interruption that is a mistake."""
    begin = SWALLOWS if interrupted else "error = ImportError('broken')\n"
    (folder / "extension.py").write_text(f"{begin}raise error from None\n")
    program = "import sys; sys.path.insert(0, '.'); import lmoc.cli.run as verb\n"
    program += "def execute(arguments): import extension\n"
    program += "verb.execute = execute\nfrom lmoc.cli.main import main; sys.exit(main(['run', 'oscillator.lmo']))"
    found = subprocess.run([sys.executable, "-c", program], cwd=folder, capture_output=True, text=True,
                           env={**os.environ, "TMPDIR": str(folder)})  # fmt: skip
    assert found.returncode == (130 if interrupted else 70), found.stderr
    assert ("interrupted" in found.stderr) == interrupted


LOST = """import os, signal, sys, weakref
from lmoc.cli import interruption
from lmoc.cli.main import main
interruption.keep()
class Gone: pass
def strike(reference):
    os.kill(os.getpid(), number)
    for _ in range(1000): pass
number = int(sys.argv[1])
import lmoc.cli.run as verb
def execute(arguments):
    gone = Gone()
    reference = weakref.ref(gone, strike)
    del gone
    while True: pass
verb.execute = execute
sys.exit(main(['run', 'oscillator.lmo']))
"""


INTERRUPTED, TERMINATED = (signal.SIGINT, 130), (signal.SIGTERM, 143)


@pytest.mark.parametrize(("sent", "ignored"), [(INTERRUPTED, False), (TERMINATED, False), (TERMINATED, True)])
def test_a_signal_is_not_lost_where_no_exception_can_get_out(folder, sent, ignored):
    """In the callback of a weak reference, of which each import runs some."""
    before = (lambda: signal.signal(signal.SIGINT, signal.SIG_IGN)) if ignored else None
    number, code = sent
    found = subprocess.run([sys.executable, "-c", LOST, str(int(number))], cwd=folder, preexec_fn=before,
                           capture_output=True, text=True, timeout=60)  # fmt: skip
    assert (found.returncode, found.stderr) == (code, "failed: interrupted\n")


@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="threads are counted as Linux lists them")
@pytest.mark.parametrize("said, threads", [({}, 1), ({"OPENBLAS_NUM_THREADS": "2"}, 2), ({"OMP_NUM_THREADS": "2"}, 2)])
def test_the_command_has_one_thread_of_the_blas_unless_told_otherwise(said: dict[str, str], threads: int):
    around = {k: v for k, v in os.environ.items() if not k.endswith("_NUM_THREADS")}
    count = "import lmoc.__main__, os, numpy.linalg; print(len(os.listdir('/proc/self/task')))"
    run = subprocess.run([sys.executable, "-c", count], env={**around, **said}, capture_output=True, text=True)
    assert run.stdout.strip() == str(min(threads, len(os.sched_getaffinity(0)))), run.stderr
