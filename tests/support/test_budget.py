"""Work that does not move on is ended, other work is not; what was interrupted is never taken for a result."""

import os
import subprocess
import sys
import threading
import time

import pytest

from lmoc.support import budget
from lmoc.support.budget import Spent, within

SHORT = 0.15  # s


@pytest.fixture(autouse=True)
def often(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(budget, "_EVERY", 0.02)


def without_end() -> None:
    x = 0
    while True:
        x += 1


def busy(seconds: float) -> None:
    end = time.process_time() + seconds
    while time.process_time() < end:
        pass


def test_what_does_not_move_on_is_ended():
    with budget.budget(SHORT), pytest.raises(Spent) as spent:
        within("a sum", without_end)
    assert (spent.value.work, spent.value.seconds) == ("a sum", SHORT)


def test_in_another_thread_too():
    found = []

    def work() -> None:
        try:
            with budget.budget(SHORT):
                within("a sum", without_end)
        except Spent as spent:
            found.append(spent.work)

    thread = threading.Thread(target=work)
    thread.start()
    thread.join(60)
    assert found == ["a sum"]


@pytest.mark.skipif(not hasattr(time, "pthread_getcpuclockid"), reason="no clocks of threads")
def test_what_other_threads_spend_does_not_count():
    """Runs of an ensemble share a process: each has its whole budget."""
    work = budget.Work("a sum", None)
    begin = work.processor(), time.process_time()
    other = threading.Thread(target=busy, args=(0.2,))
    other.start()
    other.join()
    own, whole = work.processor() - begin[0], time.process_time() - begin[1]
    assert whole >= 0.2 and own < 0.5 * whole


def test_a_look_at_work_whose_thread_has_ended_is_no_error():
    made = []
    thread = threading.Thread(target=lambda: made.append(budget.Work("a sum", None)))
    thread.start()
    thread.join()
    assert made[0].moved() and not made[0].spent() > 1e3


def test_what_moves_on_goes_on():
    def work() -> str:
        for k in range(8):
            budget.reached(0.1 * k)
            busy(0.5 * SHORT)
        return "done"

    with budget.budget(SHORT):
        assert within("a way", work) == "done"


@pytest.mark.parametrize("share", [0.0, 1e-5])
def test_a_way_that_gets_on_by_next_to_nothing_does_not_move_on(share):
    def work() -> None:
        at = 0.0
        while True:
            budget.reached(at := at + share / 1000)
            busy(0.01)

    with budget.budget(SHORT), pytest.raises(Spent):
        within("a way", work)


def test_the_same_stage_again_is_nothing_new():
    def work() -> None:
        while True:
            budget.moved_on("reduce")
            budget.moved_on("lower")
            busy(0.01)

    with budget.budget(SHORT), pytest.raises(Spent) as spent:
        within("stages", work)
    assert spent.value.doing == "lower"


def test_what_was_interrupted_is_no_result():
    def swallowing() -> int:
        try:
            without_end()
        except KeyboardInterrupt:
            return 1  # as a library of C does that drops what a callback raises
        raise AssertionError

    with budget.budget(SHORT), pytest.raises(Spent):
        within("a sum", swallowing)


def test_an_interruption_that_is_lost_comes_again(monkeypatch):
    monkeypatch.setattr(budget, "_AGAIN", SHORT)

    def swallowing() -> None:
        for _ in range(3):
            try:
                without_end()
            except KeyboardInterrupt:
                pass

    with budget.budget(SHORT), pytest.raises(Spent):
        within("a sum", swallowing)


def test_inner_work_has_its_own_budget_and_moves_the_outer_on():
    ended = []

    def outer() -> int:
        for _ in range(3):
            try:
                within("a point", without_end)
            except Spent as spent:
                ended.append(spent.work)
        return len(ended)

    with budget.budget(SHORT):
        assert within("a study", outer) == 3


def test_nothing_is_on_its_way_when_work_has_ended():
    for _ in range(15):
        with budget.budget(0.02):
            try:
                within("at the edge", lambda: busy(0.1))
            except Spent:
                pass
        busy(0.001)  # an interruption that came too late would end the test here
    assert not budget.interrupted() and not budget._open


def test_other_errors_and_interruptions_stay_what_they_are():
    def fail() -> None:
        raise ZeroDivisionError

    def interrupt() -> None:
        raise KeyboardInterrupt

    with pytest.raises(ZeroDivisionError):
        within("a sum", fail)
    with pytest.raises(KeyboardInterrupt) as error:
        within("a sum", interrupt)
    assert not isinstance(error.value, Spent)


def test_who_has_something_to_free_is_called_instead():
    stop = threading.Event()

    def work() -> None:
        with budget.instead(stop.set):
            while not stop.is_set():
                busy(0.01)

    def in_thread() -> None:
        with budget.budget(SHORT):
            try:
                within("a library", work)
            except Spent:
                found.append(stop.is_set())

    found: list[bool] = []
    thread = threading.Thread(target=in_thread)
    thread.start()
    thread.join(60)
    assert found == [True]


def test_the_environment_sets_it_and_none_lifts_it(monkeypatch):
    assert budget.allowed() == budget.DEFAULT
    monkeypatch.setenv(budget.VARIABLE, "7.5")
    assert budget.allowed() == 7.5
    with budget.budget(None):
        assert budget.allowed() == float("inf")
    for wrong in ("", "soon", "-3"):
        monkeypatch.setenv(budget.VARIABLE, wrong)
        assert budget.allowed() == budget.DEFAULT
    for wrong in (0, -1, float("nan")):
        with pytest.raises(ValueError, match="positive"), budget.budget(wrong):
            pass


@pytest.mark.skipif(not hasattr(os, "fork"), reason="a process that is copied is one of Unix")
def test_a_copied_process_has_a_budget():
    text = """
import os, time
from lmoc.support.budget import Spent, budget, within
within("before", lambda: 1)
def without_end():
    while True: pass
child = os.fork()
if child == 0:
    try:
        with budget(0.3): within("in the copy", without_end)
    except Spent: os._exit(7)
    os._exit(1)
os._exit(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
"""
    assert subprocess.run([sys.executable, "-c", text], timeout=60).returncode == 7
