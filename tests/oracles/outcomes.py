"""What a scene gives, as plain data that can be compared between processes and machines.

``python tests/oracles/outcomes.py CASES ANSWERS`` reads cases from a JSON file and writes what each has given.
"""

from __future__ import annotations

import hashlib
import json
import sys
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

MOST = 400  # variables that are looked at
SHOWN = 21  # output times whose values are kept


@dataclass(frozen=True)
class Case:
    """A scene and what is done with it.

    Attributes
    ----------
    scene : a path, or a text
    verb : "run", "again" (a first, a second and a later run), "chart" or "page"
    """

    scene: str
    verb: str = "run"
    rtol: float | None = None
    solver: str = "auto"
    stop: float | None = None

    @property
    def name(self) -> str:
        """Return what a table calls it."""
        own = "/".join(self.scene.removesuffix(".lmo").split("/")[-2:])
        own = own if self.scene.endswith(".lmo") else self.scene.split()[1]
        more = ("" if self.verb == "run" else self.verb, "" if self.solver == "auto" else self.solver)
        at = "" if self.rtol is None else f"{self.rtol:.0e}"
        return " ".join(filter(None, (own, *more, at)))


@dataclass(frozen=True)
class Answer:
    """The outcome of a case.

    Attributes
    ----------
    outcome : "ok", or the kind of error with its codes
    events : (kind, name) of each, in order
    instants : s, of the events
    signals : {name: values at some of the output times}
    sizes : {name: largest magnitude}
    bits : digests of everything, of each time it was made
    """

    outcome: str
    events: list[list[str]]
    instants: list[float]
    signals: dict[str, list[float]]
    sizes: dict[str, float]
    bits: list[str]


def answer(case: Case) -> Answer:
    """Do what a case says."""
    import lmoc

    try:
        dae = lmoc.compile(case.scene) if case.scene.endswith(".lmo") else lmoc.compile_text(case.scene)
    except lmoc.ModelError as error:
        return _failed(error)
    return {"run": _run, "again": _again, "chart": _chart, "page": _page}[case.verb](dae, case)


def _failed(error: Exception) -> Answer:
    codes = ", ".join(sorted({d.code for d in getattr(error, "diagnostics", ())}))
    return Answer(f"{type(error).__name__} {codes}".strip(), [], [], {}, {}, [_digest(str(error))])


def _simulated(dae, case: Case, **changed):
    options = {"rtol": case.rtol, "solver": case.solver, "stop": case.stop} | changed
    return dae.simulate(**{key: value for key, value in options.items() if value is not None})


def _run(dae, case: Case) -> Answer:
    import lmoc

    try:
        return _of(_simulated(dae, case))
    except lmoc.SimulationError as error:
        if error.partial is None:
            return _failed(error)
        found = _of(error.partial)
        return Answer("SimulationError", found.events, found.instants, {}, {}, [*found.bits, _digest(str(error))])
    except lmoc.ModelError as error:
        return _failed(error)


def _of(run) -> Answer:
    names = run.outputs or run.states
    variables = np.arange(len(run.flat.kind))[:MOST]
    events = [[e.kind, e.name] for e in run.events]
    times = [float(e.time) for e in run.events]
    few = np.unique(np.linspace(0, len(run.time) - 1, SHOWN).astype(int))
    signals = {name: np.atleast_1d(np.asarray(run[name], float).T)[..., few].ravel().tolist() for name in names[:20]}
    sizes = {name: float(np.nanmax(np.abs(run[name]), initial=0.0)) for name in signals}
    what = [str(run.stats[key]) for key in ("solver", "evaluations", "steps") if key in run.stats]
    what += [repr(event) for event in run.events]
    numbers = run.time, run.values(variables), run.end.values
    return Answer("ok", events, times, signals, sizes, [_digest(*what, *(a.tobytes() for a in numbers))])


def _again(dae, case: Case) -> Answer:
    """Run it first, for the second time, and after runs of other kinds."""
    import lmoc
    from lmoc.numerics.options.options import RunOptions

    first, second = _run(dae, case), _run(dae, case)
    span = RunOptions(stop=case.stop).span(dae.flat.experiment)
    short = span.start + 0.02 * (span.end - span.start)
    for changed in ({"solver": "taylor"}, {"solver": "radau", "rtol": 1e-3}, {"rtol": 3e-5, "points": 7}):
        try:
            _simulated(dae, case, **changed | {"stop": short})
        except (lmoc.SimulationError, lmoc.ModelError):
            continue
    later = _run(dae, case)
    return Answer(first.outcome, first.events, first.instants, first.signals, first.sizes,
                  [b for a in (first, second, later) for b in a.bits])  # fmt: skip


def _chart(dae, case: Case) -> Answer:
    """A quick chart: what is in it but the times, and for how long the scene runs in it."""
    chart = dae.chart(["auto", "dop853"], rtols=[1e-3, 1e-5], quick=True)
    end = float(chart.reference.signals.time[-1])
    errors = [[p.setting.text, repr(p.error), p.note, str(p.evaluations)] for p in chart.points]
    return Answer("ok", [], [], {"end": [end]}, {"end": end}, [_digest(repr(end), *sum(errors, []))])


def _page(dae, case: Case) -> Answer:
    from lmoc.view.page.contents import contents

    run = _simulated(dae, case)
    found, own = contents(run, "page"), _of(run)
    text = json.dumps(found.data, sort_keys=True)
    return Answer("ok", own.events, own.instants, own.signals, own.sizes, [*own.bits, _digest(text)])


def _digest(*parts: str | bytes) -> str:
    digest = hashlib.sha256()
    for part in parts:
        digest.update(part.encode() if isinstance(part, str) else part)
    return digest.hexdigest()[:16]


def main() -> None:
    cases = [Case(**given) for given in json.loads(Path(sys.argv[1]).read_text())]
    with Path(sys.argv[2]).open("w") as file:
        for case in cases:
            try:
                found = answer(case)
            except Exception as error:  # a mistake in lmoc is an answer, too, and a bad one
                found = Answer(f"internal {type(error).__name__}: {error}", [], [], {}, {}, [])
            file.write(json.dumps(asdict(found)) + "\n")
            file.flush()


if __name__ == "__main__":
    main()
