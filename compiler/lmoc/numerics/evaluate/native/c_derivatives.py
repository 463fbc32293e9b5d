"""Derivatives of a program's registers in C: the stages of `evaluate.jacobian` as text.

In a small program every entry is a variable of its own and the compiler sees through all of them; in a large one the
entries are an array that loops over index tables fill.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from lmoc.ir.program import Apply, Program, Solve, Step, Total
from lmoc.numerics.evaluate.jacobian import Implicit, Jacobian, Product
from lmoc.numerics.evaluate.native.c_code import (
    Unsupported,
    Writer,
    expression_lines,
    is_short,
    number_text,
    with_loop,
    write_step,
)
from lmoc.numerics.evaluate.native.c_matrices import write_implicit

_STRAIGHT = 3000  # products up to which every entry is a variable


def sweep(writer: Writer, program: Program, jacobian: Jacobian, values: bool) -> Straight | Looped:
    """Write the derivatives of a program; where they stand afterwards.

    Parameters
    ----------
    jacobian : of this program
    values : whether the registers themselves are computed as well, else they are as the program has left them

    Raises
    ------
    Unsupported
        For values of a program with an implicit block.
    """
    found = Straight(writer, jacobian) if _is_small(writer, jacobian) else Looped(writer, jacobian)
    stages = iter(jacobian.stages)
    _write(found, program, _Ahead(stages), values)
    return found


def _is_small(writer: Writer, jacobian: Jacobian) -> bool:
    products = [s for s in jacobian.stages if isinstance(s, Product)]
    short = all(is_short(writer, s.step) for s in jacobian.stages)
    return writer.literal and short and sum(len(p.which) for p in products) <= _STRAIGHT


class _Ahead:
    """The stages in order; a step without derivatives has none."""

    def __init__(self, stages: Iterator[Product | Implicit]) -> None:
        self.stages = stages
        self.next = next(stages, None)

    def take(self, step: Step) -> Product | Implicit | None:
        if self.next is None or self.next.step is not step:
            return None
        found, self.next = self.next, next(self.stages, None)
        return found


def _write(found: Straight | Looped, program: Program, stages: _Ahead, values: bool) -> None:
    for step in program:
        if isinstance(step, Solve):
            if values:
                raise Unsupported("a block inside a block")
            _write(found, step.inner, stages, False)
            found.implicit(stages.take(step))
            _write(found, step.inner, stages, False)
        else:
            stage = stages.take(step)
            if stage is not None:
                found.product(stage, values)
            elif values and len(step.out):
                write_step(found.writer, step)


class Straight:
    """Every entry is a C variable."""

    def __init__(self, writer: Writer, jacobian: Jacobian) -> None:
        self.writer = writer
        self.entry = {k: "1.0" for a, b in jacobian.ones for k in range(a, b)}

    def product(self, stage: Product, values: bool) -> None:
        """The entries of an explicit step."""
        factors = self._total(stage, values) if isinstance(stage.step, Total) else self._apply(stage, values)
        which, source = stage.which.tolist(), stage.source.tolist()
        edges = [*stage.start.tolist(), len(which)]
        for k in range(stage.stop - stage.first):
            terms = [_product(factors[which[j]], self.entry[source[j]]) for j in range(edges[k], edges[k + 1])]
            self._set(stage.first + k, " + ".join(terms))

    def _set(self, k: int, text: str) -> None:
        if text.replace(".", "", 1).isalnum():  # a number or a name
            self.entry[k] = text
        else:
            self.entry[k] = self.writer.name("v")
            self.writer.add(f"const double {self.entry[k]} = {text};")

    def _apply(self, stage: Product, values: bool) -> list[str]:
        step, n = stage.step, len(stage.step.out)
        factors = [""] * (len(stage.partials) * n)
        shapes = [step.shape] * values + [partial for partial, _ in stage.partials]
        for i, row in enumerate(step.slots.tolist()):
            lines, results = expression_lines(shapes, {k: f"w[{r}]" for k, r in enumerate(row)}, self.writer)
            self.writer.add(*lines)
            if values:
                self.writer.add(f"w[{step.out[i]}] = {results[0]};")
            for p, text in enumerate(results[values:]):
                factors[p * n + i] = text
        return factors

    def _total(self, stage: Product, values: bool) -> list[str]:
        if values:
            write_step(self.writer, stage.step)
        return [number_text(float(c)) for c in stage.step.coefficient]

    def implicit(self, stage: Implicit) -> None:
        """The derivatives of the unknowns of a block."""
        x, places = write_implicit(self, stage)
        for k, place in enumerate(places.tolist()):
            self.entry[stage.first + k] = f"{x}[{place}]"

    def copy(self, target: str, places: np.ndarray, sources: np.ndarray) -> None:
        """Write entries to places of an array."""
        lines = [f"{target}[{p}] = {self.entry[s]};" for p, s in zip(places.tolist(), sources.tolist(), strict=True)]
        self.writer.add(*lines)


class Looped:
    """The entries are an array."""

    def __init__(self, writer: Writer, jacobian: Jacobian) -> None:
        self.writer = writer
        products = [s for s in jacobian.stages if isinstance(s, Product)]
        largest = max((len(p.partials) * len(p.step.out) for p in products if isinstance(p.step, Apply)), default=0)
        self.v, self.f = writer.name("v"), writer.name("f")
        writer.add(f"double *{self.v} = {writer.space(jacobian.size)}, *{self.f} = {writer.space(largest)};")
        writer.add(f"(void){self.f};")
        for a, b in jacobian.ones:
            low, high = writer.number(a), writer.number(b)
            writer.add(f"for (int64_t k = {low}; k < {high}; k++) {self.v}[k] = 1;")

    def product(self, stage: Product, values: bool) -> None:
        """The entries of an explicit step."""
        writer, step = self.writer, stage.step
        if isinstance(step, Total):
            if values:
                write_step(writer, step)
            factors = f"((const double *){writer.table(np.ascontiguousarray(step.coefficient, np.float64))})"
        else:
            factors = self.f
            shapes = [step.shape] * values + [partial for partial, _ in stage.partials]

            def use(results: list[str], out: str) -> list[str]:
                lines = [f"w[{out}] = {results[0]};"] if values else []
                return lines + [f"{self.f}[{p}*n + i] = {text};" for p, text in enumerate(results[values:])]

            with_loop(writer, step, shapes, use)
        self._products(stage, factors)

    def _products(self, stage: Product, factors: str) -> None:
        writer, v = self.writer, self.v
        which, source = writer.indices(stage.which), writer.indices(stage.source)
        count, first = writer.number(stage.stop - stage.first), writer.number(stage.first)
        writer.add("{", f"  const int32_t *which = {which}, *source = {source};")
        if stage.single:
            writer.add(
                "#pragma GCC ivdep",
                f"  for (int64_t k = 0; k < {count}; k++) {v}[{first} + k] = {factors}[which[k]] * {v}[source[k]];",
                "}",
            )
            return
        start = writer.indices(np.append(stage.start, len(stage.which)))
        writer.add(
            f"  const int32_t *start = {start};",
            f"  for (int64_t k = 0; k < {count}; k++) {{",
            "    double s = 0;",
            f"    for (int32_t j = start[k]; j < start[k + 1]; j++) s += {factors}[which[j]] * {v}[source[j]];",
            f"    {v}[{first} + k] = s;",
            "  }",
            "}",
        )

    def implicit(self, stage: Implicit) -> None:
        """The derivatives of the unknowns of a block."""
        x, places = write_implicit(self, stage)
        writer = self.writer
        place, count, first = writer.indices(places), writer.number(len(places)), writer.number(stage.first)
        writer.add(f"for (int64_t k = 0; k < {count}; k++) {self.v}[{first} + k] = {x}[{place}[k]];")

    def copy(self, target: str, places: np.ndarray, sources: np.ndarray) -> None:
        """Write entries to places of an array."""
        writer = self.writer
        place, source, count = writer.indices(places), writer.indices(sources), writer.number(len(places))
        writer.add(f"for (int64_t k = 0; k < {count}; k++) {target}[{place}[k]] = {self.v}[{source}[k]];")


def _product(a: str, b: str) -> str:
    if a == "1.0":
        return b
    if b == "1.0":
        return a
    return f"{a}*{b}"
