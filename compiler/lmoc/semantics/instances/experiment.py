"""The `experiment` annotation (Modelica specification, 18.4)."""

from __future__ import annotations

from math import inf

from lmoc.ir.flat import Experiment
from lmoc.messages.diagnostics import nearest
from lmoc.messages.source import Span
from lmoc.semantics.classes.scope import Scope
from lmoc.semantics.instances.elaboration import Elaboration
from lmoc.semantics.mistakes.wrong import MAX_ELEMENTS, Wrong
from lmoc.semantics.values.context import Context
from lmoc.syntax import tree

FIELDS = {"StartTime": "start", "StopTime": "stop", "Tolerance": "tolerance", "Interval": "interval"}
FINEST_TOLERANCE = 1e-14  # doubles know no finer relative one


def experiment_of(cls: Scope, model: Elaboration) -> Experiment:
    """Times and tolerance that the model asks for; numbers or its own parameters."""
    values: dict[str, float] = {}
    annotation = cls.definition.annotation
    for argument in annotation.arguments if annotation else ():
        if not isinstance(argument, tree.ElementModification) or argument.name != ("experiment",):
            continue
        for entry in argument.modification.arguments if argument.modification else ():
            name = entry.name[0]
            if name in FIELDS:
                try:
                    values[FIELDS[name]] = _value(model, cls, entry)
                except Wrong as wrong:
                    wrong.put_into(model.report)
            elif not name.startswith("__"):
                hint = nearest(name, FIELDS)
                model.report.warning("W0231", f"'experiment' has no entry '{name}'", entry.span, hint=hint)
        experiment = Experiment(**values)
        _check(experiment, argument.span, model)
        return experiment
    return Experiment()


def _value(model: Elaboration, cls: Scope, entry: tree.ElementModification) -> float:
    name = entry.name[0]
    expression = entry.modification.value if entry.modification else None
    if expression is None:
        raise Wrong("E0212", f"'{name}' has no value", entry.span, expected=f"{name} = …")
    context = Context(model, model.root, cls)
    return context.scalar(context.value(expression), expression.span, f"'{name}'")


def _check(experiment: Experiment, span: Span, model: Elaboration) -> None:
    """Refuse times and a tolerance that no run could keep."""
    start = experiment.start or 0.0
    stop, interval, tolerance = experiment.stop, experiment.interval, experiment.tolerance
    length = None if stop is None else stop - start
    if length is not None and not 0 < length < inf:
        found = f"from {start:g} s to {stop:g} s"
        message = "the times of the experiment cannot be used"
        model.report.error("E0228", message, span, expected="StartTime < StopTime", found=found)
    elif interval is not None and not 0 < interval < inf:
        message = "the interval of the experiment must be positive"
        model.report.error("E0228", message, span, found=f"{interval:g} s")
    elif length is not None and interval is not None and length / interval > MAX_ELEMENTS:
        message = "the experiment has too many intervals"
        most = f"at most {MAX_ELEMENTS:,} intervals".replace(",", " ")
        model.report.error("E0228", message, span, expected=most, found=f"{length / interval:g}")
    if tolerance is not None and not FINEST_TOLERANCE <= tolerance < 1:
        message = "the tolerance of the experiment cannot be used"
        expected = f"{FINEST_TOLERANCE:g} ≤ Tolerance < 1"
        model.report.error("E0228", message, span, expected=expected, found=f"{tolerance:g}")
