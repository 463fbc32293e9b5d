"""The variables with start values, and the initial equations, as functions of the states."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from lmoc.diagnostics import Report
from lmoc.distinct import distinct
from lmoc.expression.dag import Expr
from lmoc.expression.dag import slots as slots_of
from lmoc.numerics.evaluate import Interpreter
from lmoc.numerics.jacobian import Jacobian
from lmoc.numerics.plan import Plan
from lmoc.semantics.flat import Group
from lmoc.source import Span
from lmoc.structure.program import Apply, Program, needed_steps

if TYPE_CHECKING:
    from lmoc.numerics.initialization import Targets


class StartSystem:
    """Residuals ``variable - value`` and of the initial equations, and their Jacobian by states and quadratures.

    Attributes
    ----------
    value : (m,) values wanted; 0 for equations
    hard : (m,) whether a residual must vanish
    last : (m,) the residuals of the last evaluation
    """

    def __init__(
        self,
        plan: Plan,
        base: np.ndarray,
        signals: Mapping,
        values: np.ndarray,
        time: float,
        targets: Targets,
        report: Report,
    ) -> None:
        self.plan, self.time, self.targets = plan, time, targets
        self.flat = plan.reduced.flat
        equations = _InitialEquations(plan, report)
        outputs = np.concatenate([plan.reduced.register_of[targets.variable], equations.out]).astype(int)
        program: Program = plan.full_program + equations.program
        count = plan.count + equations.added
        self.equations = equations.rows
        self.program = needed_steps(program, outputs, count)
        self.interpreter = Interpreter(self.program, count)
        self.jacobian = Jacobian(self.program, plan.states, outputs, count)
        self.outputs = outputs
        self.w = np.concatenate([base, np.full(equations.added, np.nan)])
        self.w[plan.count + np.arange(len(equations.parameters))] = values[equations.parameters]
        for register, (variable, order) in zip(plan.sampled.tolist(), plan.samplers, strict=True):
            self.w[register] = signals[variable].value(time, order)
        self.value = np.concatenate([targets.value, np.zeros(len(equations.out))])
        self.hard = np.concatenate([targets.hard, np.ones(len(equations.out), bool)])
        self.last = np.zeros(len(self.value))

    def evaluate(self, x: np.ndarray):
        """Residuals (m,) and their Jacobian as (rows, columns, values)."""
        self.w[self.plan.states] = x
        self.interpreter.run(self.w, self.time)
        self.last = self.w[self.outputs] - self.value
        return self.last, (self.jacobian.rows, self.jacobian.columns, self.jacobian.values(self.w, self.time))

    # ---------------------------------------------------------------- names for messages

    def name(self, k: int) -> str:
        if k < len(self.targets):
            return self.flat.variable_name(int(self.targets.variable[k]))
        group, row = self.equations[k - len(self.targets)]
        return f"the initial equation `{self.flat.row_text(group, row)}`"

    def text(self, k: int) -> str:
        return f"{self.name(k)} = {self.value[k]:g}" if k < len(self.targets) else self.name(k)

    def span(self, k: int) -> Span | None:
        if k < len(self.targets):
            variable = self.targets.variable[k]
            for a in self.flat.starts:
                if a.span is not None and (a.target == variable).any():
                    return a.span
            return self.flat.block_at(int(variable)).span
        return self.equations[k - len(self.targets)][0].span


class _InitialEquations:
    """The initial equations of the flat model as steps of the program."""

    def __init__(self, plan: Plan, report: Report) -> None:
        reduced = plan.reduced
        self.plan = plan
        self.report = report
        self.jets = _jets(plan)
        self.derivative = dict(zip(reduced.states.tolist(), reduced.derivatives.tolist(), strict=True))
        self.derivative |= zip(reduced.quadratures.tolist(), reduced.quadrature_derivatives.tolist(), strict=True)
        self.constants = dict(zip(plan.known[1].tolist(), plan.known[0].tolist(), strict=True))
        self.parameters: list[int] = []
        self.rows: list[tuple[Group, int]] = []
        groups = reduced.flat.initial_groups
        self._collect_parameters(groups)
        first = plan.count + len(self.parameters)
        steps, out = [], []
        for group in groups:
            own = first + np.arange(group.rows)
            first += group.rows
            step = self._step(group, own)
            if step is not None:
                steps.append(step)
                out.append(own)
                self.rows += [(group, row) for row in range(group.rows)]
        self.program = tuple(steps)
        self.out = np.concatenate(out) if out else np.zeros(0, int)
        self.added = first - plan.count

    def _collect_parameters(self, groups: tuple[Group, ...]) -> None:
        """Registers for parameters that only initial equations read."""
        from lmoc.semantics.flat import Kind

        kind = self.plan.reduced.flat.kind
        for group in groups:
            for v in distinct(group.slots).tolist():
                if kind[v] in (Kind.PARAMETER, Kind.CONSTANT) and v not in self.constants:
                    self.constants[v] = self.plan.count + len(self.parameters)
                    self.parameters.append(v)

    def _step(self, group: Group, out: np.ndarray) -> Apply | None:
        """An equation with a column for each jet it uses."""
        from lmoc.expression.dag import slot, substitute

        leaves = slots_of(group.residual)
        columns: list[np.ndarray] = []
        replacement: dict[Expr, Expr] = {}
        for k, leaf in enumerate(leaves):
            column, order = leaf.value
            registers = [self._register(v, order) for v in group.slots[:, column].tolist()]
            if None in registers:
                variable = int(group.slots[registers.index(None), column])
                jet = self.plan.reduced.flat.jet_name(variable, order)
                hint = f"give it a name in the model, `Real rate = {jet}`, and write the initial equation for that"
                message = f"{jet} is not known at the start, so no equation can fix it"
                self.report.error("E0536", message, group.span, hint=hint)
                return None
            columns.append(np.array(registers, int))
            replacement[leaf] = slot(k)
        slots = np.stack(columns, axis=1) if columns else np.zeros((group.rows, 0), int)
        return Apply(substitute(group.residual, replacement), slots, out)

    def _register(self, variable: int, order: int) -> int | None:
        if variable in self.constants:
            return self.constants[variable]
        register = int(self.plan.reduced.register_of[variable])
        if register < 0:
            return self.jets.get((variable, order))
        for _ in range(order):  # a variable may be a jet of another one: v = der(q), so der(v) = der(der(q))
            table = self.plan.reduced.registers
            jet = (int(table.variable[register]), int(table.order[register]) + 1)
            register = self.derivative.get(register, self.jets.get(jet, -1))
            if register < 0:
                return self.jets.get((variable, order))
        return register


def _jets(plan: Plan) -> dict[tuple[int, int], int]:
    """Register of each (variable, order) of the reduced system; made only where there are initial equations."""
    if not plan.reduced.flat.initial_groups:
        return {}
    table = plan.reduced.registers
    own = np.flatnonzero(table.variable >= 0)
    keys = zip(table.variable[own].tolist(), table.order[own].tolist(), strict=True)
    jets = dict(zip(keys, own.tolist(), strict=True))
    return jets | {(v, o): r for r, v, o in plan.reduced.inputs.T.tolist()}
