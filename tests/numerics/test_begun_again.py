"""CVODE where it gives up after a long step: it begins again there, and not for ever."""

import numpy as np
import pytest

import lmoc
from lmoc.numerics.sundials.cvode import CvodeSession

SLIDE = """model M Real x(start = 1, fixed = true), v(start = 0, fixed = true);
  equation der(x) = v; der(v) = -{d}*v - {d}*x; end M;"""


class Refusing:
    """The library, whose integrator says at some calls that seven steps in a row have failed the error test."""

    def __init__(self, library, refuses) -> None:
        self._library, self._refuses, self.calls, self.refused = library, refuses, 0, 0

    def __getattr__(self, name):
        return getattr(self._library, name)

    def CVode(self, *arguments):
        self.calls += 1
        if self._refuses(self.calls):
            self.refused += 1
            return -3
        return self._library.CVode(*arguments)


def refusing(monkeypatch, refuses) -> list[Refusing]:
    """Have all sessions of CVODE be refused; the libraries that are made are added to the list."""
    made, create = [], CvodeSession.create

    def with_refusals(self):
        memory = create(self)
        self.lib = Refusing(self.lib, refuses)
        made.append(self.lib)
        return memory

    monkeypatch.setattr(CvodeSession, "create", with_refusals)
    return made


@pytest.mark.parametrize("d", [100.0, 1e5])
def test_a_run_goes_on_where_cvode_gives_up_after_long_steps(monkeypatch, d):
    made = refusing(monkeypatch, lambda call: call % 30 == 0)
    run = lmoc.compile_text(SLIDE.format(d=d)).simulate(stop=5, points=101, rtol=1e-8, solver="cvode")
    roots = np.roots([1, d, d])
    exact = (roots[1] * np.exp(np.multiply.outer(run.time, roots[0]))
             - roots[0] * np.exp(np.multiply.outer(run.time, roots[1]))) / (roots[1] - roots[0])  # fmt: skip
    assert sum(one.refused for one in made) >= 3
    np.testing.assert_allclose(run["x"], exact, atol=1e-6)


def test_a_run_that_cvode_gives_up_again_and_again_ends(monkeypatch):
    made = refusing(monkeypatch, lambda call: call > 40)
    with pytest.raises(lmoc.SimulationError, match="the step size collapsed"):
        lmoc.compile_text(SLIDE.format(d=100.0)).simulate(stop=5, points=101, solver="cvode")
    assert 1 < sum(one.refused for one in made) < 100
