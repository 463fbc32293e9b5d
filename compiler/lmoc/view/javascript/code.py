"""Programs as JavaScript: the fifth reader of a program over registers.

Expressions are written as in C: what C calls a function is a name of `assets/elementary.js`. The few rows of a small
step are written one by one, those of a large one are a loop over tables of registers. Blocks are handed to the solver
of `assets/blocks.js`.
"""

from __future__ import annotations

from dataclasses import field

import numpy as np

from lmoc.ir.program import Apply, Program, Solve, Total
from lmoc.support.records import dataclass
from lmoc.view.javascript.expressions import FEW, expression_lines, number_text
from lmoc.view.javascript.varying import matrix_varies


@dataclass
class Writer:
    """Collects the tables that the written functions read.

    Attributes
    ----------
    tables : lists of numbers, which the text calls ``tab[0]``, ``tab[1]``, …
    blocks : {unknowns of an implicit block: its number}; functions that solve the same block share its last solution
    varying : (registers,) which change between events; all, where it is None
    """

    tables: list[list] = field(default_factory=list)
    blocks: dict[bytes, int] = field(default_factory=dict)
    varying: np.ndarray | None = None
    _names: int = 0

    def name(self, lead: str) -> str:
        """Return a name that is used nowhere else."""
        self._names += 1
        return f"{lead}{self._names}"

    def table(self, values: np.ndarray) -> str:
        self.tables.append(np.asarray(values).ravel().tolist())
        return f"tab[{len(self.tables) - 1}]"

    def function(self, program: Program) -> str:
        """Return an arrow function ``(w, time) => {…}`` that runs a program."""
        return "(w, time) => {\n" + "\n".join(self._steps(program)) + "\n}"

    def _steps(self, program: Program) -> list[str]:
        lines: list[str] = []
        for step in program:
            if isinstance(step, Solve):
                lines += self._solve(step)
            elif isinstance(step, Total):
                lines += self._total(step)
            elif len(step.out):
                lines += self._apply(step)
        return lines

    def _apply(self, step: Apply) -> list[str]:
        if len(step.out) > FEW:
            return self._loop(step)
        lines = []
        for row, out in zip(step.slots.tolist(), step.out.tolist(), strict=True):
            body, results = expression_lines([step.shape], {k: f"w[{r}]" for k, r in enumerate(row)}, self, "const")
            lines += [*body, f"w[{out}] = {results[0]};"]
        return lines

    def _loop(self, step: Apply) -> list[str]:
        columns = {k: self.table(step.slots[:, k]) for k in range(step.slots.shape[1])}
        access = {k: f"w[a{k}[i]]" for k in columns}
        body, results = expression_lines([step.shape], access, self, "const")
        declared = [f"const a{k} = {name};" for k, name in columns.items()]
        loop = f"for (let i = 0; i < {len(step.out)}; i++) {{"
        return ["{", *declared, f"const o = {self.table(step.out)};", loop, *body, f"w[o[i]] = {results[0]};", "}", "}"]

    def _total(self, step: Total) -> list[str]:
        if len(step.index) <= 10 * FEW:
            lines = []
            for k, out in enumerate(step.out.tolist()):
                own = range(int(step.start[k]), int(step.start[k + 1]))
                terms = (f"{number_text(float(step.coefficient[j]))}*w[{step.index[j]}]" for j in own)
                lines.append(f"w[{out}] = {' + '.join(terms) or '0'};")
            return lines
        tables = (self.table(column) for column in (step.start, step.index, step.coefficient, step.out))
        return [f"totals(w, {', '.join(tables)});"]

    def _solve(self, step: Solve) -> list[str]:
        number = self.blocks.setdefault(step.unknowns.tobytes(), len(self.blocks))
        unknowns, residuals = self.table(step.unknowns), self.table(step.residuals)
        guess = "null" if step.guess is None else self.table(step.guess)
        size = step.unknowns.shape[1]
        kind = 0 if not step.linear else 1 if self.varying is None or matrix_varies(step, self.varying) else 2
        head = f"solve(blocks, {number}, w, time, {unknowns}, {residuals}, {size}, {kind}, {guess}, "
        return [head + self.function(step.inner) + ");"]
