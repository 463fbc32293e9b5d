"""The chain rule on a tape (`chain_rule`), in the same sweep as the values or after it."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from lmoc.ir.program import Program, Solve, Step, Total
from lmoc.lower.chain_rule import ChainRule, Implicit, Product
from lmoc.lower.matrices import write_implicit
from lmoc.lower.steps import coefficients, write_shapes, write_step, write_total
from lmoc.lower.writer import Writer

_FEW = 64  # products of a stage up to which they are single operations


class Ahead:
    """The stages in order; a step without derivatives has none."""

    def __init__(self, rule: ChainRule) -> None:
        self._stages: Iterator[Product | Implicit] = iter(rule.stages)
        self._next = next(self._stages, None)

    def take(self, step: Step) -> Product | Implicit | None:
        if self._next is None or self._next.step is not step:
            return None
        found, self._next = self._next, next(self._stages, None)
        return found


class Derivatives:
    """The derivatives of a program on a tape.

    Attributes
    ----------
    place : (size,) where each entry stands that has been written so far
    """

    def __init__(self, writer: Writer, rule: ChainRule) -> None:
        self.writer, self.rule = writer, rule
        self.place = np.full(rule.size, -1)
        for a, b in rule.ones:
            self.place[a:b] = writer.one

    @property
    def results(self) -> np.ndarray:
        """Return where the entries of the Jacobian stand."""
        found: np.ndarray = self.place[self.rule.source]
        return found

    def product(self, stage: Product, values: bool) -> None:
        """Write the entries of an explicit step, and its values."""
        step, writer = stage.step, self.writer
        if isinstance(step, Total):
            if values:
                write_total(writer, step)
            factors = coefficients(writer, step)
        else:
            shapes = [step.shape] * values + [partial for partial, _ in stage.partials]
            factors = np.concatenate(write_shapes(writer, step, shapes, values)[values:])
        factor, source = factors[stage.which], self.place[stage.source]
        if stage.single:
            self.place[stage.first : stage.stop] = self._products(factor, source)
        else:
            self._sums(stage, factor, source)

    def _products(self, factor: np.ndarray, source: np.ndarray) -> np.ndarray:
        """Write products; where they stand."""
        writer = self.writer
        place = np.where(source == writer.one, factor, source)
        real = np.flatnonzero((source != writer.one) & (factor != writer.one))
        if len(real) > _FEW:
            place[real] = writer.reserve(len(real)) + np.arange(len(real))
            writer.products(place[real], None, factor[real], source[real])
        else:
            for k in real.tolist():
                place[k] = writer.product(int(factor[k]), int(source[k]))
        return place

    def _sums(self, stage: Product, factor: np.ndarray, source: np.ndarray) -> None:
        writer, count = self.writer, stage.stop - stage.first
        edges = np.append(stage.start, len(factor))
        if len(factor) > _FEW:
            place = writer.reserve(count) + np.arange(count)
            writer.products(place, edges, factor, source)
            self.place[stage.first : stage.stop] = place
            return
        pairs, ends = list(zip(factor.tolist(), source.tolist(), strict=True)), edges.tolist()
        for k in range(count):
            self.place[stage.first + k] = writer.dot(pairs[ends[k] : ends[k + 1]])


def write_derivatives(
    found: Derivatives, program: Program, ahead: Ahead, values: bool, solve: Callable[[Writer, Solve], None]
) -> None:
    """Write the derivatives of a program.

    Parameters
    ----------
    values : whether the registers themselves are computed as well, else they are as the program has left them
    solve : writes a block
    """
    for step in program:
        if isinstance(step, Solve):
            if values:
                solve(found.writer, step)
            write_derivatives(found, step.inner, ahead, False, solve)
            stage = ahead.take(step)
            assert isinstance(stage, Implicit)
            write_implicit(found.writer, stage, found.place)
            write_derivatives(found, step.inner, ahead, False, solve)
        else:
            own = ahead.take(step)
            if isinstance(own, Product):
                found.product(own, values)
            elif values and len(step.out):
                write_step(found.writer, step)
