"""The reduced system as text: states, programs step by step, and what the reduction assumed."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from lmoc.expression.text import number_text, to_text
from lmoc.ir.names import patterns, summarised
from lmoc.ir.program import Apply, Program, Solve, Step, Total
from lmoc.ir.reduced import Reduced
from lmoc.ir.text.columns import cut


def reduced_text(reduced: Reduced) -> str:
    """Counts, states, what the reduction rests on, and the steps that compute the derivatives."""
    flat = reduced.flat
    sections = [
        [flat.name, *(f"  {n:>9} {stage}" for stage, n in reduced.counts.items())],
        _states(reduced),
        _quadratures(reduced),
        program_lines("computed once for a set of parameters", reduced, reduced.parameter_program),
        program_lines("the derivatives, step by step", reduced, reduced.rhs),
        ["assumed about the parameters", *(f"    {text}" for text in _unique(g.text for g in reduced.guards))],
        ["notes", *(f"    {d.message}" for d in reduced.notes)],
        [f"computed on demand: {_rows(reduced.observe)} quantities in {len(reduced.observe)} steps"],
    ]
    return "\n\n".join("\n".join(s) for s in sections if len(s) > 1 or s and s[0].startswith("computed"))


def _unique(texts: Iterator[str]) -> list[str]:
    distinct = list(dict.fromkeys(texts))
    return distinct if len(distinct) <= 20 else [*distinct[:20], f"… and {len(distinct) - 20} more"]


def register_patterns(reduced: Reduced, registers: np.ndarray, most: int = 12) -> list[str]:
    """The jets in some registers, arrays put together."""
    table = reduced.registers
    return patterns(reduced.flat, table.variable[registers], table.order[registers], most)


def _states(reduced: Reduced) -> list[str]:
    lines = [f"    {name}" for name in register_patterns(reduced, reduced.states, 40)]
    return [f"states ({len(reduced.states)})", *(lines or ["    none"])]


def _quadratures(reduced: Reduced) -> list[str]:
    names = register_patterns(reduced, reduced.quadratures, 20)
    return [f"quadratures ({len(reduced.quadratures)})", *(f"    {name}" for name in names)] if names else []


def program_lines(title: str, reduced: Reduced, program: Program, indent: str = "    ") -> list[str]:
    lines = [title]
    for number, step in enumerate(program, 1):
        first, *rest = step_lines(reduced, step)
        lines += [f"{indent}{number:>3}  {first}", *(f"{indent}     {line}" for line in rest)]
    return lines


def step_lines(reduced: Reduced, step: Step) -> list[str]:
    """A step in names: the first of its rows, and their number."""
    if isinstance(step, Apply):
        text = to_text(step.shape, lambda k, _: reduced.register_name(int(step.slots[0, k])))
        return [cut(f"{reduced.register_name(int(step.out[0]))} := {text}") + _times(len(step.out))]
    if isinstance(step, Total):
        terms = _terms(reduced, step)
        return [cut(f"{reduced.register_name(int(step.out[0]))} := {terms}") + _times(len(step.out))]
    return _solve_lines(reduced, step)


def _solve_lines(reduced: Reduced, step: Solve) -> list[str]:
    instances, size = step.unknowns.shape
    kind = "constant linear" if step.constant else "linear" if step.linear else "nonlinear"
    names = summarised([reduced.register_name(int(r)) for r in step.unknowns[0]], 8)
    plural = "s" if size > 1 else ""
    lines = [f"solve {size} {kind} equation{plural} for {', '.join(names)}{_times(instances)}"]
    for inner in step.inner:
        lines += [f"  {line}" for line in step_lines(reduced, inner)]
    return lines


def _terms(reduced: Reduced, step: Total) -> str:
    begin, end = int(step.start[0]), int(step.start[1])
    text = ""
    for j in range(begin, min(end, begin + 12)):
        c, name = float(step.coefficient[j]), reduced.register_name(int(step.index[j]))
        size = name if abs(c) == 1 else f"{number_text(abs(c))}*{name}"
        text += (" - " if c < 0 else " + ") + size
    text = text.removeprefix(" + ") or "0"
    return text + (f" … ({end - begin} terms)" if end - begin > 12 else "")


def _times(rows: int) -> str:
    return f"   (and {rows - 1} alike)" if rows > 1 else ""


def _rows(program: Program) -> int:
    return sum(step.unknowns.size if isinstance(step, Solve) else len(step.out) for step in program)
