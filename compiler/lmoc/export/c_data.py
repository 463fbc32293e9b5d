"""An executable as data in C: the initializer of ``lmoc_fmu_model`` (``export/c/fmu.h``)."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable
from typing import Any

import numpy as np

from lmoc.engine.instant import COUNTED, TABLES
from lmoc.export.executable import Executable
from lmoc.export.variables import Variable
from lmoc.lower.tape import SolveBlock, Tape
from lmoc.numerics.dop853.dense_output import LAST_WEIGHTS
from lmoc.numerics.dop853.rules import RULES
from lmoc.numerics.evaluate import engine_stepper
from lmoc.numerics.steps.added_errors import NO_FINER

_PER_LINE = 12
_EMPTY = Tape(0, 0, (np.zeros(0), np.zeros(0)), 0, np.zeros(1, int), np.zeros(0, int), (), np.zeros(0, int))


class _Writer:
    """Collects arrays, and gives each a name."""

    def __init__(self) -> None:
        self.lines: list[str] = []
        self._count = 0

    def array(self, kind: str, values: np.ndarray, text: Callable[[Any], str]) -> str:
        items = [text(v) for v in np.ravel(values).tolist()] or ["0"]
        self._count += 1
        name = f"a{self._count}"
        self.lines.append(f"static const {kind} {name}[] = {{")
        self.lines += [", ".join(items[k : k + _PER_LINE]) + "," for k in range(0, len(items), _PER_LINE)]
        self.lines.append("};")
        return name

    def ints(self, values: np.ndarray, kind: str = "int32_t") -> str:
        return self.array(kind, np.asarray(values, np.int64), str)

    def reals(self, values: np.ndarray) -> str:
        return self.array("double", np.asarray(values, float), _real)

    def texts(self, values: tuple[str, ...]) -> str:
        return self.array("char *const", np.array(values, object), _text)

    def structures(self, kind: str, items: list[str]) -> str:
        self._count += 1
        name = f"a{self._count}"
        self.lines.append(f"static const {kind} {name}[] = {{{', '.join(items) or '{0}'}}};")
        return name

    def block(self, block: SolveBlock, patient: bool) -> str:
        instances, size = block.unknowns.shape
        tables = [self.ints(t) for t in block.tables]
        pattern = ["0", "0"] if block.pattern is None else [self.ints(p) for p in block.pattern]
        places = f"{block.a}, {block.b}, {block.work}, {block.x}, 0, 0, {int(patient)}"
        shape = f"{instances}, {size}, {block.fill.shape[1]}, {block.right.shape[1]}"
        return f"{{{shape}, {', '.join(tables)}, {', '.join(pattern)}, 0, 0, {places}}}"

    def tape(self, tape: Tape, patient: bool) -> str:
        blocks = [self.block(b, patient) for b in tape.blocks]
        pivots = [(b.unknowns.shape[0] if b.kept else 1) * b.unknowns.shape[1] for b in tape.blocks]
        name = self.structures("lmoc_block", blocks)
        places, values = tape.constants
        counts = f"{tape.size}, {tape.time}, {len(tape.blocks)}, {len(places)}, {len(tape.results)}"
        arrays = [self.ints(places), self.reals(values), self.ints(tape.code), self.ints(tape.index), name]
        arrays += [self.ints(np.array(pivots), "int64_t"), self.ints(tape.results)]
        return f"{{{counts}, {', '.join(arrays)}}}"


def _real(value: float) -> str:
    if math.isnan(value):
        return "NAN"
    if math.isinf(value):
        return "INFINITY" if value > 0 else "-INFINITY"
    return value.hex()


def _text(value: str) -> str:
    """Return a text as C has it, without trigraphs and escapes that go on."""
    plain = value.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n").replace("?", "\\?")
    return f'"{plain}"'


def _events(w: _Writer, own: Executable) -> str:
    """Write the events of a scene; return the initializer of ``fmu_events``."""
    e = own.events
    sizes = {name: len(e.columns[column]) for name, column in COUNTED.items()} | {"states": len(own.plan.states)}
    instant = [f".{name} = {size}" for name, size in sizes.items()]
    instant += [f".{name} = {w.ints(e.columns[name])}" for name in TABLES]
    counts = [
        e.checks, len(e.watched.places), len(e.branches), len(e.seen), len(e.parameters),
        len(e.begun), len(e.kept), e.absent, e.initial, e.terminal,
    ]  # fmt: skip
    tapes = [w.tape(t, not own.branches) for t in (e.look, e.assign, e.lines, e.begin)]
    integers = (
        e.registers, e.zeros, e.reinits, e.errors, e.watched.places, e.watched.errors, e.first_known, e.known,
        e.branches, e.seen, e.parameters, e.begun, e.kept,
    )  # fmt: skip
    texts = [w.texts(t) for t in (e.texts, e.told_texts, e.watched.texts)]
    tables = f"{{{', '.join(instant)}}}"
    parts = [tables, *map(str, counts), *tapes, *map(w.ints, integers), w.reals(e.start), *texts, _real(e.longest)]
    return "{" + ", ".join(parts) + "}"


def _laws(w: _Writer, own: Executable) -> str:
    """Write the laws of a scene; return the initializer of ``fmu_laws``, all zero without any."""
    laws, states, count = own.laws, len(own.plan.states), own.plan.count
    if laws is None:
        return f"{{.by_force = {w.tape(_EMPTY, True)}, .by_state = {w.tape(_EMPTY, True)}}}"
    t = laws.table
    numbers = [w.ints(v, "int64_t") for v in (t.degree, t.normal)]
    flags = [w.ints(v, "lmoc_flag") for v in (t.complementary, t.dry, t.contact)]
    form = f"{{{len(t.kind)}, {', '.join(numbers + flags)}}}"
    masks = t.unilateral, laws.curved, laws.linear, laws.position, np.zeros(states, bool)
    tapes = [w.tape(tape, True) for tape in (laws.by_force, laws.by_state)]
    places = [np.where(v < 0, -1, v + count) for v in (laws.known, laws.restitution)]
    tables = (laws.given, *laws.entries, laws.quantity, *places, laws.inputs, laws.held, laws.read)
    parts = [form, *(w.ints(m, "lmoc_flag") for m in masks), *tapes, str(len(laws.given)), *map(w.ints, tables)]
    return "{" + ", ".join([*parts, w.reals(laws.noise), *map(w.texts, laws.texts)]) + "}"


def _jumps(w: _Writer, own: Executable) -> str:
    """Write what may step; return the initializer of ``fmu_jumps``, all zero where nothing does."""
    j = own.jumps
    if j is None:
        return f"{{.rates = {w.tape(_EMPTY, True)}}}"
    judged = len(j.results) - len(own.plan.states)
    counts = len(j.registers), len(j.which), len(j.tables[0]), judged, len(j.kept[0]), len(j.early)
    tables = (j.registers, *j.tables, own.plan.ledger, j.which, j.given, j.results, *j.kept, j.early)
    parts = [*map(str, counts), w.tape(j.rates, not own.branches), *map(w.ints, tables), w.texts(j.names)]
    return "{" + ", ".join(parts) + "}"


def _loops(w: _Writer, own: Executable) -> str:
    """Write the closures of a scene; return the initializer of ``fmu_loops``, without stages where there are none."""
    loops, stages = own.loops, []
    if loops is None:
        none = f"{{0, 0, 0, 0, {w.tape(_EMPTY, True)}}}"
        return f"{{.stage = {{{none}, {none}}}}}"
    for stage, tape in zip(loops.stages, loops.tapes, strict=True):
        groups = []
        for g in stage.loops:
            (count, m), n = g.rows.shape, g.columns.shape[1]
            loop, i, j = g.place
            tables = ", ".join(w.ints(t) for t in (g.rows, g.columns, g.entry, (loop * m + i) * n + j))
            groups.append(f"{{{count}, {m}, {n}, {len(g.entry)}, {tables}, 0, 0, 0, 0, 0, 0}}")
        name = w.structures("lmoc_loops", groups)
        sizes = f"{len(stage.residual)}, {len(stage.jacobian.source)}, {len(groups)}"
        stages.append(f"{{{sizes}, {name}, {w.tape(tape, not own.branches)}}}")
    held = np.where(loops.free, 0.0, loops.scale)
    written = [w.ints(loops.given), w.reals(loops.scale), w.reals(held), w.ints(own.closing, "lmoc_flag")]
    return f"{{{len(stages)}, {len(loops.given)}, {{{', '.join(stages)}}}, {', '.join(written)}}}"


def c_data(own: Executable, tolerance: float) -> tuple[str, str]:
    """Return the text in C, and the token that stands for it.

    Parameters
    ----------
    tolerance : relative, of co-simulation where the importer gives none
    """
    w, plan = _Writer(), own.plan
    patient = not own.branches
    tapes = [w.tape(t, patient) for t in (own.parametric, own.right, own.observe, own.slopes)]
    tables = [w.ints(np.array([getattr(v, n) for v in own.variables])) for n in ("place", "index", "type")]
    tables += [w.ints(plan.states), w.ints(plan.derivatives)]
    tables += [w.ints(own.inputs), w.ints(own.parameters + plan.count), w.ints(own.given), w.ints(own.kept)]
    tables += [w.ints(own.unknowns), w.reals(own.guess), w.ints(own.turning, "lmoc_flag"), str(len(own.tied.registers))]
    tables += [w.ints(own.tied.registers), w.reals(own.tied.values), w.reals(own.tied.reach)]
    tables += [w.reals(own.known), w.reals(own.start), w.reals(own.nominal)]
    tables += [w.reals(own.input_start), w.reals(own.dae.values[own.parameters]), w.reals(own.breaks)]
    tables += [w.ints(own.rows), w.ints(own.columns), w.ints(own.outputs)]
    tables += [w.ints(own.assumed.places), w.ints(own.assumed.errors), w.texts(own.assumed.texts)]
    method = engine_stepper.weights(), engine_stepper.nodes(), engine_stepper.dense(), LAST_WEIGHTS
    tables += [w.reals(a) for a in method]
    rules = ", ".join(_real(float(v)) for v in vars(RULES).values())
    counts = [
        plan.count, len(own.variables), len(plan.states), len(own.inputs), len(own.parameters), len(own.given),
        len(own.kept), len(own.unknowns), len(own.breaks), len(own.outputs), len(own.assumed.places),
        int(own.branches),
    ]  # fmt: skip
    parts = [", ".join(map(str, counts)), *tapes, ", ".join(tables), f"{{{rules}}}"]
    parts += [_events(w, own), _laws(w, own), _jumps(w, own), _loops(w, own)]
    body = ",\n".join(parts)
    start, stop = float(own.run.time[0]), float(own.run.trajectory.planned)
    ends = f"{_real(start)}, {_real(stop - start)}, {_real(tolerance)}, {_real(own.finer)}, {_real(NO_FINER)}"
    arrays = "\n".join(w.lines)
    token = _token(arrays + body + ends, own.variables)
    head = '/* A scene as data, written by lmoc. */\n\n#include "fmu.h"\n\n'
    return f'{head}{arrays}\n\nconst fmu_model lmoc_fmu_model = {{"{token}",\n{body},\n{ends}}};\n', token


def _token(text: str, variables: tuple[Variable, ...]) -> str:
    names = "\0".join(v.name for v in variables)
    h = hashlib.sha256(f"{text}\0{names}".encode()).hexdigest()
    return f"{{{h[:8]}-{h[8:12]}-{h[12:16]}-{h[16:20]}-{h[20:32]}}}"
