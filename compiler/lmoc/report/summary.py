"""The text that `lmoc run` prints, and the same as data."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from lmoc.ir.flat import Block
from lmoc.ir.names import patterns
from lmoc.report.display import display
from lmoc.report.events import events_data, events_text, modes_data
from lmoc.report.result import Result

_LABEL = 10
_MOST_ROWS = 24


def summary(run: Result, units: str | Sequence[str] | None = None) -> str:
    """Return the summary of a run: system, cost, accuracy and final values, in the units of `display`."""
    shown = display(units)
    rows = [(name, shown.value(value, u), shown.unit(u), text) for name, value, u, text in final_rows(run)]
    title = run.flat.name + (f": {run.flat.description}" if run.flat.description else "")
    lines = [title]
    lines += _labelled("reduction", " → ".join(counted(n, stage) for stage, n in stages(run.reduced.counts)))
    lines += _labelled("states", ", ".join(_states(run)) or "none")
    lines += _labelled("solver", _solver(run.stats))
    lines += _labelled("cost", _cost(run))
    lines += _labelled("closures", _closures(run))
    lines += _labelled("energy", energy_text(run))
    lines += _labelled("events", events_text(run.events))
    lines += ["", f"at t = {run.time[-1]:g} s{_broke_off(run)}", *_table(rows)]
    lines += [f"  {line}" for line in [_final_names(run)[1]] if line]
    return "\n".join(lines)


def as_data(run: Result) -> dict[str, Any]:
    """The summary as plain data for JSON; NaN becomes None."""
    energy = run.energy
    data = {
        "model": run.flat.name,
        "description": run.flat.description,
        "complete": run.complete,
        "broke_off": run.broke_off,
        "counts": run.reduced.counts,
        "states": run.states,
        "outputs": run.outputs,
        "start": run.time[0],
        "stop": run.time[-1],
        "stats": dict(run.stats),
        "timings": run.timings,
        "energy": energy and {
            "balance": energy.balance,
            "stored": [energy.stored[0], energy.stored[-1]],
            "supplied": energy.supplied[-1],
            "lost": energy.lost[-1],
        },
        "residual": run.residual and dict(zip(("position", "velocity"), run.residual, strict=True)),
        "events": events_data(run.events),
        "modes": modes_data(run.modes),
        "final": run.final,
        "units": {name: run.unit(name) for name in run.final},
        "notes": [{"code": d.code, "severity": d.severity, "message": d.message} for d in run.notes],
    }
    return plain(data)


def plain(value: Any) -> Any:
    """Numpy scalars and arrays as numbers and lists; what is not finite as None."""
    if isinstance(value, Mapping):
        return {str(k): plain(v) for k, v in value.items()}
    if isinstance(value, str | bool | int) or value is None:
        return value
    if isinstance(value, list | tuple):
        return [plain(v) for v in value]
    if hasattr(value, "tolist"):
        return plain(value.tolist())
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return str(value)


# ---------------------------------------------------------------------------- the lines


def _labelled(label: str, text: str, width: int = 100) -> list[str]:
    """A label and a text beside it, broken between words."""
    import textwrap

    lead = " " * (_LABEL + 2)
    broken = textwrap.wrap(text, width, initial_indent=lead, subsequent_indent=lead, break_on_hyphens=False)
    return [f"  {label:<{_LABEL}}{broken[0][len(lead) :]}", *broken[1:]] if broken else []


def stages(counts: Mapping[str, int]) -> list[tuple[str, int]]:
    """The counts worth a word: parts, flat equations, what linear elimination leaves, solved states."""
    words = {"parts": "parts", "equations": "flat equations", "after aliases": "after elimination", "states": "states"}
    return [(words[key], counts[key]) for key in words if key in counts]


def counted(n: int, things: str) -> str:
    """``1 part``, ``2 parts``."""
    return f"{_number(n)} {things.removesuffix('s') if n == 1 else things}"


def _broke_off(run: Result) -> str:
    """Describe how the last output time relates to the end of a run that failed."""
    if run.complete:
        return ""
    if f"{run.broke_off:g}" == f"{run.time[-1]:g}":
        return ", where the run broke off"
    return f", the last output time before the run broke off at t = {run.broke_off:.6g} s"


def _states(run: Result) -> list[str]:
    table, states = run.reduced.registers, run.reduced.states
    return patterns(run.flat, table.variable[states], table.order[states])


def _solver(stats: Mapping[str, Any]) -> str:
    reason, matrix, by = (stats.get(key, "") for key in ("reason", "matrix", "evaluation"))
    text = f"{stats.get('solver', 'none')}" + (f" ({reason})" if reason else "")
    if matrix:
        text += f"; Jacobian {matrix}"
    # casadi is the rule for small scenes and not worth a word
    return text if by in ("", "casadi") or stats.get("solver") == "none" else f"{text}; evaluated by {by}"


def _closures(run: Result) -> str:
    """Describe how well closed loops stay closed."""
    if run.residual is None:
        return ""
    return "positions satisfy them within {:.1e}, velocities within {:.1e}".format(*run.residual)


def _cost(run: Result) -> str:
    stats = run.stats
    counted = [
        f"{_number(stats[key])} {word}"
        for key, word in (("steps", "steps"), ("evaluations", "evaluations"))
        if key in stats
    ]
    return "; ".join(filter(None, [", ".join(counted), times_text(run.timings)]))


def times_text(timings: Mapping[str, float]) -> str:
    """Wall time of the stages that matter: in milliseconds, or in seconds where one of them takes more."""
    least = 0.02 * sum(timings.values())
    scale, unit, digits = (1e3, "ms", 0) if max(timings.values(), default=0) < 1 else (1, "s", 2)
    shown = [f"{stage} {scale * seconds:.{digits}f}" for stage, seconds in timings.items() if seconds > least]
    return f"{', '.join(shown)} {unit}" if shown else ""


def energy_text(run: Result) -> str:
    """Stored, supplied and lost energy at the end, and the error of their balance."""
    return "not requested" if run.energy is None else str(run.energy)


def final_rows(run: Result) -> list[tuple[str, float, str, str]]:
    """(name, value, unit, description) of the outputs, then of the states that are not outputs already; or of what was
    kept. Of very many only the first."""
    return [_final_row(run, name) for name in _final_names(run)[0]]


def _final_names(run: Result) -> tuple[list[str], str]:
    """Names of the values that are shown, and the line that tells of the others."""
    variables, orders = _final_jets(run)
    count = len(variables)
    if count <= _MOST_ROWS:
        shown = count
    else:  # outputs, or outputs and states: states only where they all fit, or where there is nothing else
        outputs = sum(b.size for b in run.flat.blocks if b.output) if run.kept is None else 0
        shown = min(outputs or count, _MOST_ROWS)
    names = [run.flat.jet_name(int(v), int(n)) for v, n in zip(variables[:shown], orders[:shown], strict=True)]
    if shown == count:
        return names, ""
    left = ", ".join(patterns(run.flat, variables[shown:], orders[shown:]))
    return names, f"… and {_number(count - shown)} more: {left}"


def _final_jets(run: Result) -> tuple[np.ndarray, np.ndarray]:
    """Variables and orders of derivatives whose last values are worth showing, the most important first."""
    if run.kept is not None:
        kept = np.array([int(run.flat.find(name)[0]) for name in run.kept], int)
        return kept, np.zeros(len(kept), int)
    table, blocks = run.reduced.registers, [b for b in run.flat.blocks if b.output]
    outputs = np.concatenate([np.zeros(0, int), *(b.offset + np.arange(b.size) for b in blocks)])
    states = run.reduced.states[~np.isin(run.reduced.states, run.reduced.register_of[outputs])]
    orders = np.concatenate([np.zeros(len(outputs), int), table.order[states]])
    return np.concatenate([outputs, table.variable[states]]), orders


def _final_row(run: Result, name: str) -> tuple[str, float, str, str]:
    return name, float(run[name][-1]), run.unit(name), _description(run, name)


def _description(run: Result, name: str) -> str:
    found = run.flat.find(name)
    block: Block | None = None if found is None else run.flat.block_at(int(found[0]))
    return "" if block is None else block.description


def _table(rows: Sequence[tuple[str, float, str, str]]) -> list[str]:
    """Aligned at the decimal sign."""
    values = [f"{value:z.6g}" for _, value, _, _ in rows]
    width = max((len(name) for name, *_ in rows), default=0)
    before = max((len(_whole(v)) for v in values), default=0)
    after = max((len(v) - len(_whole(v)) for v in values), default=0)
    units = max((len(unit) for _, _, unit, _ in rows), default=0)
    lines = []
    for (name, _, unit, description), v in zip(rows, values, strict=True):
        number = (_whole(v).rjust(before) + v[len(_whole(v)) :]).ljust(before + after)
        lines.append(f"  {name:<{width}}  {number}  {unit:<{units}}  {description}".rstrip())
    return lines


def _whole(text: str) -> str:
    return text.partition(".")[0] if "." in text else text.partition("e")[0]


def _number(n: float) -> str:
    return f"{n:,}".replace(",", " ") if isinstance(n, int) else f"{n:g}"
