"""What all runs of an ensemble share, checked before the first of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from lmoc.ir.names import hint_for, names_of, outputs_of
from lmoc.messages.diagnostics import ModelError, Report
from lmoc.numerics.options.options import RunOptions
from lmoc.numerics.run.simulate import check_options
from lmoc.parameters import indexed
from lmoc.report.result import is_array
from lmoc.session import Session
from lmoc.studies.rows import Rows, concerns_all_runs
from lmoc.support.records import dataclass


@dataclass(frozen=True, eq=False)
class Job:
    """What all runs of an ensemble share.

    Attributes
    ----------
    options : of each run
    rows : what differs between them
    names : of the variables that are kept
    series : whether they are kept over time
    shapes : {name: shape of its value at one time}
    times : (T,) s
    """

    session: Session
    options: RunOptions
    rows: Rows
    names: tuple[str, ...]
    series: bool
    shapes: Mapping[str, tuple[int, ...]]
    times: np.ndarray


def job_of(
    session: Session, options: RunOptions, rows: Rows, keep: str | Sequence[str] | None, series: bool = True
) -> Job:
    """Return what an ensemble does, once it has been seen that it can be done.

    Raises
    ------
    ModelError
        Names that are not in the model, options that cannot be used.
    """
    flat = session.flat
    first = rows.request(0)
    try:
        indexed(flat, first["parameters"])
    except ModelError as error:
        if concerns_all_runs(error, rows):
            raise
    report = Report()
    span = check_options(options, session.reduced, report)
    names = names_of(keep) or outputs_of(flat) or tuple(session.reduced.state_names)
    for kind in ("initial", "inputs"):
        given = first[kind]
        for name in given if isinstance(given, Mapping) else ():
            if flat.find(str(name)) is None:
                report.error("E0622", f"'{name}' is not in '{flat.name}'", hint=hint_for(flat, str(name)))
    for name in names:
        if not name.startswith("der(") and flat.find(name) is None:
            report.error("E0622", f"'{name}' cannot be kept: there is no such variable", hint=hint_for(flat, name))
    report.check()
    shapes = {name: _shape(session, name) for name in names}
    return Job(session, options, rows, tuple(names), series, shapes, span.times)


def _shape(session: Session, name: str) -> tuple[int, ...]:
    flat = session.flat
    return (len(flat.find(name)),) if not name.startswith("der(") and is_array(flat, name) else ()
