"""Tapes as C: operation by operation in the same order, so that compiled and interpreted ones agree bit for bit.

Nothing waits for the compiler, and nobody notices but by the time: what it has made takes the interpreter's place
between two calls. Constants are read from memory, so that no compiler computes with them, and a sine beside a cosine of
the same angle stays a call of its own.
"""

from __future__ import annotations

import ctypes
import re
import threading
from abc import ABC, abstractmethod
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np

from lmoc.engine.compiler import find_compiler, load_library
from lmoc.expression.functions import FUNCTIONS
from lmoc.lower.operations import BINARY, UNARY
from lmoc.lower.tape import Tape, row_instructions, row_operands

OPTIONS = "-O2 -fno-builtin-sin -fno-builtin-cos"
_LONGEST = 20_000  # instructions of a text: beyond, compilers take minutes
# Interpreted work, in operations of about a nanosecond, after which a tape is compiled: 3 s. The compiler takes 0.2 to
# 2 s of another core.
WORTHWHILE = 3e9
_ON_BLOCKS = ("linear", "constant", "implicit")


def cost(tape: Tape) -> int:
    """Return about how many operations a tape has."""
    total = 0
    for _, name, rest in tape.instructions():
        if name == "rows":
            total += rest[0] * sum(1 for _ in row_instructions(rest))
        elif name in ("products", "fill"):
            total += rest[0]
        else:
            total += len(rest)
    return total + 50 * sum(b.unknowns.size for b in tape.blocks)


def c_text(tape: Tape) -> str:
    """Return the text of ``int lmoc_program(time, w, tape)``."""
    return headers("lane", "lu", "tape") + _Text(tape).text()


@cache
def headers(*names: str) -> str:
    """Return headers of the engine as one text, in an order in which each needs those before it."""
    folder = Path(__file__).with_name("c")
    text = "".join((folder / f"{name}.h").read_text(encoding="utf-8") for name in names)
    return re.sub('#include "[a-z]+.h"\n', "", text)


class _Text:
    """The lines of one function. Scratch that only single operations read is a variable."""

    def __init__(self, tape: Tape) -> None:
        self.tape = tape
        instructions = list(tape.instructions())
        self._seen = self._in_memory(instructions)
        self._locals: set[int] = set()
        targets = {rest[1] for _, name, rest in instructions if name in ("correct", "ready")}
        self.lines: list[str] = []
        for at, name, rest in instructions:
            if at in targets:
                self.lines.append(f"L{at}:;")
            self._write(at, name, rest)

    def _in_memory(self, instructions: list[tuple[int, str, list[int]]]) -> np.ndarray:
        """(size,) whether something else than single operations reads or writes a place."""
        tape = self.tape
        seen = np.zeros(tape.size + 1, bool)
        seen[: tape.registers] = True
        seen[tape.constants[0]] = seen[tape.time] = True
        seen[tape.results] = True
        seen[tape.index[(tape.index >= 0) & (tape.index < tape.size)]] = True
        for block in tape.blocks:
            for table in block.tables:
                seen[table.ravel()] = True
            seen[block.x : block.x + block.right.size] = True
        for _, name, rest in instructions:
            if name == "fill":
                seen[rest[2]] = True
            elif name == "rows":
                for own, operands in row_instructions(rest):
                    pairs = row_operands(own, operands)
                    for place, flag in zip(pairs[::2], pairs[1::2], strict=True):
                        seen[place : place + (rest[0] if flag > 0 else 1)] = True
        return seen

    def text(self) -> str:
        """Return the function."""
        names = sorted(self._locals)
        declared = [f"  double {', '.join(f't{p}' for p in names[k : k + 20])};" for k in range(0, len(names), 20)]
        body = "\n".join([*declared, *("  " + line for line in self.lines)])
        return (
            "int lmoc_program(double time, double *w, const lmoc_tape *t) {\n  int status = 0;\n"
            f"  w[{self.tape.time}] = time;\n{body}\n}}\n"
        )

    def _at(self, place: int) -> str:
        return f"w[{place}]" if self._seen[place] else f"t{place}"

    def _set(self, place: int, value: str) -> None:
        if not self._seen[place]:
            self._locals.add(place)
        self.lines.append(f"{self._at(place)} = {value};")

    def _write(self, at: int, name: str, rest: list[int]) -> None:
        if name in UNARY or name in BINARY or name == "if":
            self._set(rest[0], operation(name, [self._at(p) for p in rest[1:]]))
        elif name == "dot":
            terms = [f"{self._at(a)}*{self._at(b)}" for a, b in zip(rest[2::2], rest[3::2], strict=True)]
            self._set(rest[0], " + ".join(terms))
        elif name == "rows":
            if any(own in ("linear", "newton", "correct") for own, _ in row_instructions(rest)):
                self.lines.append(f"status |= t->functions->rows(t->code + {at}, w, t);")
            else:
                self._rows(rest)
        elif name == "products":
            self._products(rest)
        elif name == "fill":
            n, out, place = rest
            self.lines.append(f"for (int64_t k = 0; k < {n}; k++) w[t->index[{out} + k]] = {self._at(place)};")
        elif name == "end":
            self.lines.append("return status;")
        else:
            self._on_block(name, rest)

    def _on_block(self, name: str, rest: list[int]) -> None:
        block = f"(t->blocks + {rest[0]}, w"
        if name in _ON_BLOCKS:
            self.lines.append(f"t->functions->{name}{block});")
        elif name == "factor":
            self.lines.append(f"status |= t->functions->factor{block});")
        elif name == "newton":
            self.lines.append(f"t->functions->newton_begin{block});")
        elif name == "ready":
            self.lines.append(f"if (t->blocks[{rest[0]}].ready) goto L{rest[1]};")
        else:  # correct
            self.lines += [
                f"{{ const int64_t open = t->functions->newton_step{block});",
                f"  if (open > 0) goto L{rest[1]};",
                f"  status |= t->functions->newton_end{block}, open); }}",
            ]

    def _products(self, rest: list[int]) -> None:
        n, out, start, factor, source = rest
        term = f"w[t->index[{factor} + {{0}}]]*w[s[{{0}}]]" if factor >= 0 else "w[s[{0}]]"
        self.lines.append(f"{{ const int32_t *s = t->index + {source}, *out = t->index + {out};")
        if start < 0:
            self.lines.append(f"  for (int64_t k = 0; k < {n}; k++) w[out[k]] = {term.format('k')}; }}")
            return
        self.lines += [
            f"  const int32_t *start = t->index + {start};",
            f"  for (int64_t k = 0; k < {n}; k++) {{",
            "    double sum = 0;",
            f"    for (int32_t j = start[k]; j < start[k + 1]; j++) sum += {term.format('j')};",
            "    w[out[k]] = sum;",
            "  } }",
        ]

    def _rows(self, rest: list[int]) -> None:
        """One loop: the rows of a step do not read each other's results."""
        lines: list[str] = []
        buffers: set[int] = set()

        def at(place: int, flag: int) -> str:
            if flag:
                return f"w[{place} + i]" if flag > 0 else f"w[{place}]"
            buffers.add(place)
            return f"b{place}"

        for name, own in row_instructions(rest):
            out = at(*own[:2])
            if name == "gather":
                lines.append(f"{out} = w[t->index[{own[2]} + i]];")
            elif name == "strided":
                lines.append(f"{out} = w[{own[2]} + i*{own[3]}];")
            elif name == "scatter":
                lines.append(f"w[t->index[{own[2]} + i]] = {out};")
            elif name == "spread":
                lines.append(f"w[{own[2]} + i*{own[3]}] = {out};")
            else:
                args = [at(*own[k : k + 2]) for k in range(2, len(own), 2)]
                lines.append(f"{out} = {operation(name, args)};")
        declared = f"  double {', '.join(f'b{p}' for p in sorted(buffers))};" if buffers else ""
        self.lines += ["#pragma GCC ivdep", f"for (int64_t i = 0; i < {rest[0]}; i++) {{", declared]
        self.lines += [*("  " + line for line in lines), "}"]


def operation(name: str, args: list[str]) -> str:
    """Return an operation as C writes it."""
    return args[0] if name == "move" else FUNCTIONS[name].c.format(*args)


def compile_tape(tape: Tape) -> ctypes.CDLL | None:
    """Compile a tape; None where there is no compiler, or the tape is too long for one."""
    return None if len(tape.code) > _LONGEST else compiled(lambda: c_text(tape))


def compiled(text: Callable[[], str]) -> ctypes.CDLL | None:
    """Compile a text, which is written only where there is a compiler; None where there is none."""
    return None if find_compiler() is None else load_library(text(), OPTIONS)


class Accelerator(ABC):
    """Compiles beside its use what has been worked with for long.

    Attributes
    ----------
    library : what has been made; None as long as there is nothing
    """

    def __init__(self, cost_of_one: float, share: float = 1.0) -> None:
        """
        Parameters
        ----------
        cost_of_one : operations of an evaluation, of about a nanosecond
        share : of `WORTHWHILE`, after which it is compiled
        """
        self.library: ctypes.CDLL | None = None
        self._work, self._cost, self._share, self._begun = 0.0, cost_of_one, share, False

    def note(self, evaluations: int) -> None:
        """Take note of evaluations that have been made."""
        self._work += evaluations * self._cost
        if self._work >= self._share * WORTHWHILE and not self._begun:
            self._begun = True
            # a daemon: a program that has ended does not wait for it
            threading.Thread(target=self._compile, daemon=True).start()

    def _compile(self) -> None:
        self.library = self._make()

    @abstractmethod
    def _make(self) -> ctypes.CDLL | None:
        """Compile; None where there is no compiler, or too long a text for one."""


class TapeAccelerator(Accelerator):
    """Compiles a tape."""

    def __init__(self, tape: Tape) -> None:
        super().__init__(cost(tape))
        self.tape = tape

    def _make(self) -> ctypes.CDLL | None:
        return compile_tape(self.tape)
