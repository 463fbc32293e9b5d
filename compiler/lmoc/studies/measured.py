"""Measured data that a scene is fitted to: columns over time, from files, data frames or arrays."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from lmoc.ir.flat import FlatDAE
from lmoc.ir.names import hint_for
from lmoc.messages.diagnostics import Diagnostic, ModelError, Report
from lmoc.messages.source import Source
from lmoc.numerics.signals.delimited import sheet
from lmoc.numerics.signals.table_files import read_tables
from lmoc.support.records import dataclass

_CODE = "E0668"
LARGEST = 1e150  # of a measured number: beyond it, squares are no numbers


@dataclass(frozen=True, eq=False)
class Experiment:
    """What was measured in one experiment.

    Attributes
    ----------
    columns : {column: (times (k,) s, values (k,), variable of the model)}
    settings : "parameters", "initial", "inputs", "start" of its simulation
    """

    columns: Mapping[str, tuple[np.ndarray, np.ndarray, str]]
    settings: Mapping[str, Any]

    @property
    def times(self) -> np.ndarray:
        """All times of measurements, in order."""
        return np.unique(np.concatenate([time for time, _, _ in self.columns.values()]))


def experiments_of(
    data: object, outputs: Mapping[str, str] | None, flat: FlatDAE, unit: Callable[[str], str]
) -> tuple[Experiment, ...]:
    """Return what was measured.

    Parameters
    ----------
    data : a table, or a pair (table, settings), or a list of these; a table is the name of a file, a data frame, or
        a mapping, with a column ``time``
    outputs : {column: variable}; by default the columns that are called as variables are
    unit : gives the unit of a variable, into which columns of a file are converted

    Raises
    ------
    ModelError
        E0668: the data do not fit the model; E0610, E0625: the file cannot be read.
    """
    given = data if isinstance(data, list) else [data]
    if not given:
        raise refusal("there are no experiments")
    return tuple(_experiment(own, outputs, flat, unit) for own in given)


def _experiment(data: Any, outputs: Mapping[str, str] | None, flat: FlatDAE, unit: Callable[[str], str]) -> Experiment:
    table, settings = data if isinstance(data, tuple) else (data, {})
    wrong = set(settings) - {"parameters", "initial", "inputs", "start"}
    if wrong:
        raise refusal(f"an experiment has parameters, initial, inputs and start; found {', '.join(sorted(wrong))}")
    if isinstance(table, (str, Path)):
        found = _of_file(Path(table), outputs, flat, unit)
    else:
        found = _of_columns(_columns(table), outputs, flat)
    for column, (time, values, _) in found.items():
        if not len(time) or not (np.isfinite(time).all() and np.isfinite(values).all()):
            raise refusal(f"column '{column}' has no numbers, or some that are not finite")
        if np.abs(values).max() > LARGEST:
            raise refusal(f"column '{column}' has numbers too large to be squared: {np.abs(values).max():g}")
    return Experiment(found, dict(settings))


def _of_file(path: Path, outputs: Mapping[str, str] | None, flat: FlatDAE, unit: Callable[[str], str]):
    if not path.is_file():
        raise ModelError([Diagnostic("E0610", f"there is no file '{path}'")])
    if outputs is None:
        table = sheet(Source(str(path), path.read_text(encoding="utf-8-sig")))
        names = [] if table is None else [path_of(cell) for cell in table.header]
        outputs = _by_name([name for name in names if name.lower() != "time"], flat)
    report = Report()
    found = read_tables(path, {column: unit(variable) for column, variable in outputs.items()}, report)
    report.check()
    return {column: (*_in_order(p.times, p.values), outputs[column]) for column, p in found.items()}


def path_of(cell: object) -> str:
    """Return the name in the head of a column, without its unit."""
    from lmoc.numerics.signals.delimited import content

    return content(cell).partition("[")[0].strip()  # type: ignore[arg-type]


def _columns(table: Any) -> dict[str, np.ndarray]:
    """Return the columns of a data frame, or of a mapping."""
    if hasattr(table, "columns") and hasattr(table, "index"):
        columns = {str(name): np.asarray(table[name], float) for name in table.columns}
        return columns if "time" in columns else {"time": np.asarray(table.index, float), **columns}
    if not isinstance(table, Mapping):
        raise refusal(f"data are a file, a data frame or a mapping with 'time'; found {type(table).__name__}")
    return {str(name): np.asarray(values, float) for name, values in table.items()}


def _of_columns(columns: dict[str, np.ndarray], outputs: Mapping[str, str] | None, flat: FlatDAE):
    time = columns.pop("time", None)
    if time is None:
        raise refusal("the data have no column 'time'")
    outputs = _by_name(columns, flat) if outputs is None else outputs
    found = {}
    for column, variable in outputs.items():
        if column not in columns:
            raise refusal(f"the data have no column '{column}'; there are {', '.join(columns)}")
        values = columns[column]
        if values.shape != time.shape or time.ndim != 1:
            raise refusal(f"column '{column}' has {values.size} numbers, 'time' {time.size}")
        there = np.isfinite(values)  # a gap in a data frame is no number
        found[column] = (*_in_order(time[there], values[there]), variable)
    return found


def _in_order(time: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    order = np.argsort(time, kind="stable")
    return time[order], values[order]


def _by_name(columns: object, flat: FlatDAE) -> dict[str, str]:
    """Return the columns that are called as variables of the model."""
    found = {name: name for name in columns if flat.find(name) is not None}  # type: ignore[attr-defined]
    if not found:
        names = ", ".join(f"'{name}'" for name in columns)  # type: ignore[attr-defined]
        if not names:
            raise refusal("there is no table with a column 'time' and columns of measured variables")
        hint = "outputs={'column': 'variable'}, on the command line --outputs column=variable"
        raise refusal(f"none of the columns {names} is called as a variable of '{flat.name}'", hint)
    return found


def check_variables(flat: FlatDAE, experiments: tuple[Experiment, ...]) -> None:
    """Refuse variables that are not in the model, or are arrays."""
    report = Report()
    for experiment in experiments:
        for _, _, variable in experiment.columns.values():
            found = flat.find(variable)
            if found is None:
                report.error("E0622", f"'{variable}' is not in '{flat.name}'", hint=hint_for(flat, variable))
            elif len(found) > 1:
                report.error(_CODE, f"'{variable}' is an array", hint=f"name one of its members: {variable}[1]")
    report.check()


def refusal(message: str, hint: str = "") -> ModelError:
    """Return the error for data that do not fit."""
    return ModelError([Diagnostic(_CODE, message, hint=hint)])
