"""The `experiment` annotation (Modelica specification, 18.4)."""

from __future__ import annotations

from lmoc.diagnostics import nearest
from lmoc.semantics.context import Context
from lmoc.semantics.elaboration import Elaboration
from lmoc.semantics.flat import Experiment
from lmoc.semantics.scope import Scope
from lmoc.semantics.wrong import Wrong
from lmoc.syntax import tree

FIELDS = {"StartTime": "start", "StopTime": "stop", "Tolerance": "tolerance", "Interval": "interval"}


def experiment_of(cls: Scope, model: Elaboration) -> Experiment:
    """Times and tolerance that the model asks for; numbers or its own parameters."""
    values: dict[str, float] = {}
    annotation = cls.definition.annotation
    for argument in annotation.arguments if annotation else ():
        if not isinstance(argument, tree.ElementModification) or argument.name != ("experiment",):
            continue
        for entry in argument.modification.arguments if argument.modification else ():
            name = entry.name[0]
            if name not in FIELDS:
                if not name.startswith("__"):
                    model.report.warning(
                        "W0231", f"'experiment' has no entry '{name}'", entry.span, hint=nearest(name, FIELDS)
                    )
                continue
            try:
                context = Context(model, model.root, cls)
                value = context.value(entry.modification.value)
                values[FIELDS[name]] = context.scalar(value, entry.span, f"'{name}'")
            except Wrong as wrong:
                wrong.put_into(model.report)
    return Experiment(**values)
