"""The runs of an ensemble as rows: what each of them is given, and what is kept of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import field
from typing import TYPE_CHECKING, Any

import numpy as np

from lmoc.ir.flat import FlatDAE
from lmoc.messages.diagnostics import ModelError, RunInterrupted, SimulationError
from lmoc.messages.requests import is_of_the_request
from lmoc.report.result import is_array
from lmoc.support.budget import Spent
from lmoc.support.records import dataclass

if TYPE_CHECKING:
    from lmoc.numerics.observe.event import Event
    from lmoc.run import Run

# what may be wrong with the values of one run, as far as these differ between runs
_OF_ONE_RUN = {"initial": frozenset({"E0621"}), "inputs": frozenset({"E0521", "E0522", "E0625"})}


@dataclass(frozen=True, eq=False)
class Rows:
    """What the runs of an ensemble are given.

    Attributes
    ----------
    count : N
    parameters, initial : {name: (N,) or, for arrays of the model, (N, m)}
    inputs : {name: a list of N signals}
    same : {"parameters", "initial", "inputs": what is the same in all runs}
    """

    count: int
    parameters: Mapping[str, np.ndarray]
    initial: Mapping[str, np.ndarray]
    inputs: Mapping[str, Sequence[object]]
    same: Mapping[str, Any] = field(default_factory=dict)

    def request(self, row: int) -> dict[str, Any]:
        """Return the arguments of `DAE.simulate` that differ between runs."""

        def own(values: np.ndarray) -> object:
            value = values[row]
            return value.item() if isinstance(value, np.generic) else value

        initial = self.same["initial"]
        if self.initial:
            initial = {**(initial or {}), **{name: own(v) for name, v in self.initial.items()}}
        return {
            "parameters": {**self.same["parameters"], **{name: own(v) for name, v in self.parameters.items()}},
            "initial": initial,
            "inputs": {**self.same["inputs"], **{name: signals[row] for name, signals in self.inputs.items()}},
        }


def rows_of(
    flat: FlatDAE,
    parameters: Mapping[str, object] | None,
    initial: Mapping[str, object] | str | None,
    inputs: Mapping[str, object] | None,
) -> Rows:
    """Return the rows of an ensemble.

    Parameters
    ----------
    parameters, initial : arrays of one length vary, numbers stay; of an array of the model (N, m) varies
    inputs : an array of numbers or a list of signals varies, everything else stays

    Raises
    ------
    ValueError
        Nothing varies, or lengths differ.
    """
    lengths: dict[str, int] = {}
    varied: list[dict[str, Any]] = []
    same: list[Any] = []
    for given, signals in ((parameters, False), (initial, False), (inputs, True)):
        if given is not None and not isinstance(given, Mapping):
            varied.append({})
            same.append(given)
            continue
        own = {name: value for name, value in (given or {}).items() if _varies(flat, name, value, signals)}
        lengths |= {name: len(value) for name, value in own.items()}
        varied.append({name: v if isinstance(v, list) and signals else np.asarray(v) for name, v in own.items()})
        same.append({name: value for name, value in (given or {}).items() if name not in own})
    if len(set(lengths.values())) != 1 or not min(lengths.values()):
        found = ", ".join(f"{name}: {length}" for name, length in lengths.items()) or "nothing that varies"
        arrays = [n for given in same[:2] if isinstance(given, Mapping) for n, v in given.items() if np.ndim(v) == 1]
        more = f"; '{arrays[0]}' is an array of the model, of which one row a run varies" if arrays else ""
        message = "an ensemble takes arrays of one length, such as parameters={'k': [10, 20]}"
        raise ValueError(f"{message}; found {found}{more}")
    held = dict(zip(("parameters", "initial", "inputs"), same, strict=True))
    parameters, starts, signals_of_runs = varied
    return Rows(next(iter(lengths.values())), parameters, starts, signals_of_runs, held)


def for_all_members(flat: FlatDAE, drawn: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Return numbers (N,) by name, those of an array of the model as (N, …): one for all members, as `--set` has it."""

    def own(name: str, values: np.ndarray) -> np.ndarray:
        found = flat.find(name)
        if found is None or not is_array(flat, name):
            return values
        dims = flat.block_at(int(found[0])).dims
        shape = dims if np.prod(dims) == len(found) else (len(found),)  # a part of it may be asked for
        return np.broadcast_to(values.reshape(-1, *[1] * len(shape)), (len(values), *shape)).copy()

    return {name: own(name, np.asarray(values)) for name, values in drawn.items()}


def _varies(flat: FlatDAE, name: str, value: object, signal: bool) -> bool:
    """Return whether a value is one for each run."""
    if signal:
        return isinstance(value, list) or isinstance(value, np.ndarray) and value.ndim == 1
    if isinstance(value, str) or np.ndim(value) == 0:
        return False
    found = flat.find(name)
    return np.ndim(value) > (1 if found is not None and is_array(flat, name) else 0)


@dataclass(frozen=True, eq=False)
class Row:
    """What is kept of one run.

    Attributes
    ----------
    values : {name: (T,) or (T, m)}, NaN behind the place where the run failed
    reason : why it failed; empty where it did not
    events : its records
    """

    values: Mapping[str, np.ndarray]
    reason: str
    events: tuple[Event, ...]


def row_of(run: Run | None, names: Sequence[str], times: np.ndarray, shapes: Mapping[str, tuple], reason: str) -> Row:
    """Return what is kept of a run, or of the part of it that there is."""
    if run is None:
        return Row({name: np.full((len(times), *shapes[name]), np.nan) for name in names}, reason, ())
    if not reason:
        return Row({name: run[name] for name in names}, "", run.events)
    reached = np.isin(times, run.time)  # it may end with the place where it failed, which is no output time
    mine = np.isin(run.time, times)
    found = {}
    for name in names:
        found[name] = np.full((len(times), *shapes[name]), np.nan)
        found[name][reached] = run[name][mine]
    return Row(found, reason, run.events)


def concerns_all_runs(error: ModelError, rows: Rows) -> bool:
    """Return whether an error is about what was asked for, so that no run can be made."""
    own = frozenset().union(*(codes for kind, codes in _OF_ONE_RUN.items() if getattr(rows, kind)))
    wrong = [d for d in error.diagnostics if d.severity == "error"]
    return bool(wrong) and all(is_of_the_request(d) and d.code not in own for d in wrong)


def reason_of(failure: BaseException, rows: Rows) -> tuple[str, Run | None]:
    """Return why a run failed, and the part of it that there is.

    Raises
    ------
    ModelError
        The failure is about what was asked for.
    """
    if isinstance(failure, RunInterrupted) and not isinstance(failure.__cause__, Spent):
        raise failure
    if isinstance(failure, SimulationError):
        return str(failure), failure.partial  # type: ignore[return-value]
    if isinstance(failure, ModelError):
        if concerns_all_runs(failure, rows):
            raise failure
        wrong = [d for d in failure.diagnostics if d.severity == "error"]
        found = [f", found {d.found}" if d.found else "" for d in wrong]
        return "; ".join(f"[{d.code}] {d.message}{f}" for d, f in zip(wrong, found, strict=True)), None
    raise failure
