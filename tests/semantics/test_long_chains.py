"""Formulas of thousands of terms, factors, conditions and branches: depth is no limit in any stage."""

import math
import pickle

import pytest

import lmoc
from lmoc.cli.main import main

N = 1010  # beyond the depth that Python allows a recursion
HEAD = "model Long Real x(start = 1, fixed = true); equation der(x) = "
RATES = {  # formula, and what it is at a value of x
    "sum": (" + ".join(f"sin({k}*x)" for k in range(N)), lambda x: sum(math.sin(k * x) for k in range(N))),
    "difference": (" - ".join(f"sin({k}*x)" for k in range(N)), lambda x: -sum(math.sin(k * x) for k in range(N))),
    "product": ("*".join(["x", *["(1 + 1e-4*sin(x))"] * N]), lambda x: x * (1 + 1e-4 * math.sin(x)) ** N),
    "quotient": ("/".join(["x", *["(1 + 1e-4*sin(x))"] * N]), lambda x: x / (1 + 1e-4 * math.sin(x)) ** N),
    "and": (f"noEvent(if {' and '.join(f'x > -{k}' for k in range(N))} then 2*x else 1)", lambda x: 2 * x),
    "or": (f"if {' or '.join(f'x > {k}' for k in range(10, N))} then 2*x else 1", lambda x: 1),
    "branches": (
        f"noEvent(if x > 1e9 then 1 {' '.join(f'elseif x > {N - k}.5 then {k}' for k in range(N))} else -x)",
        lambda x: -x,
    ),
}


@pytest.mark.parametrize("kind", RATES)
def test_long_formulas_run(kind):
    text, rate = RATES[kind]
    dae = lmoc.compile_text(f"{HEAD}{text}; end Long;")
    run = dae.simulate(stop=1e-3, points=2, energy=False)
    for k in (0, -1):
        assert run["der(x)"][k] == pytest.approx(rate(run["x"][k]), rel=1e-9, abs=1e-9)


def test_long_formulas_are_kept_between_processes_and_sent_to_others(tmp_path, capsys):
    text, rate = RATES["sum"]
    file = tmp_path / "long.lmo"
    file.write_text(f"{HEAD}{text}; end Long;")
    said = []
    for _ in range(2):  # the second time it is read from the cache
        assert main(["run", str(file), "--stop", "1e-3", "--points", "2", "-o", str(tmp_path / "x.csv")]) == 0
        said.append((tmp_path / "x.csv").read_bytes())
    assert said[0] == said[1]
    again = pickle.loads(pickle.dumps(lmoc.compile(file)))
    assert again.simulate(times=[0.0])["der(x)"][0] == pytest.approx(rate(1.0), rel=1e-9)


def test_long_formulas_in_all_verbs(tmp_path):
    file = tmp_path / "long.lmo"
    file.write_text(f"{HEAD}-x{' - 0.1*x' * 400}; end Long;")
    verbs = [["check"], ["fmt"], ["show"], ["show", "--stage", "parse"], ["equations"], ["equations", "--latex"]]
    verbs += [["linearize"], ["equilibria"], ["view", "-o", str(tmp_path / "page.html"), "--stop", "0.1"]]
    for verb, *more in verbs:
        assert main([verb, str(file), *more]) == 0
