"""Small systems with nonlinear blocks while their C code is being compiled: another evaluation serves until then.

The compiler takes longer than many a short run. So it works beside, and what it has made takes over between two steps
of a long run, and is found in the cache by the next.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from lmoc.numerics.evaluate.native.compiler import Compilation, find_compiler, kept_library
from lmoc.numerics.evaluate.native.kernel import Source, source_of
from lmoc.numerics.evaluate.native.system import NativeSystem, has_branches
from lmoc.numerics.evaluate.stepper import Stepper
from lmoc.numerics.evaluate.system import CasadiDAE, InC, System
from lmoc.numerics.plan import Plan
from lmoc.numerics.signals.signals import Signal


def compiled_or(plan: Plan, other: Callable[[Plan], System]) -> System:
    """Return the compiled system where it is in the cache, else `other`, which gives way to it when it is compiled.

    Raises
    ------
    c_code.Unsupported
        The program has a block that is not written as C.
    OSError
        There is no compiler.
    """
    if find_compiler() is None:
        raise OSError("no C compiler")
    source = source_of(plan.program, plan.count, has_branches(plan))
    library = kept_library(source.text, source.optimization)
    return CompiledLater(plan, other(plan), source) if library is None else NativeSystem(plan, source, library)


class CompiledLater(System):
    """Evaluated in another way until the C code is there.

    Attributes
    ----------
    current : System
        What evaluates it now.
    """

    def __init__(self, plan: Plan, other: System, source: Source) -> None:
        self.current = other
        self._source, self._compilation = source, Compilation(source.text, source.optimization)
        self.plan, self.n = plan, other.n

    @property
    def description(self) -> str:
        return self.current.description

    def prepare(self, base: np.ndarray, signals: Mapping[int, Signal]) -> None:
        self.given = base, signals
        self.current.prepare(base, signals)
        self.take_over()

    def take_over(self) -> bool:
        """Go on with the C code if it is there; whether it has just been taken."""
        library, before = self._compilation.library, self.current
        if library is None or isinstance(before, NativeSystem):
            return False
        self.current = NativeSystem(self.plan, self._source, library)
        self.current.prepare(*self.given)
        self.current.evaluations, self.current.jacobians = before.evaluations, before.jacobians
        if before.registers is not None:
            solved = self.current.kernel.unknowns
            found, own = before.registers[solved], self.current.w[solved]
            self.current.w[solved] = np.where(np.isfinite(found), found, own)
        return True

    def stepper(self) -> Stepper:
        own = isinstance(self.current, NativeSystem)
        return self.current.stepper() if own else _Stepper(self)

    # ------------------------------------------------------------------ what the current one does

    def rhs(self, t: float, x: np.ndarray, out: np.ndarray) -> None:
        self.current.rhs(t, x, out)

    def pattern(self) -> tuple[np.ndarray, np.ndarray]:
        return self.current.pattern()

    def jacobian_values(self, t: float, x: np.ndarray, out: np.ndarray) -> None:
        self.current.jacobian_values(t, x, out)

    def mark(self) -> None:
        self.current.mark()

    def opened(self):
        return self.current.opened()

    def callback(self, order: np.ndarray | None, implicit: bool = False):
        self.take_over()
        return self.current.callback(order, implicit)

    def determinants(self) -> np.ndarray:
        return self.current.determinants()

    def restart(self) -> None:
        self.current.restart()

    @property
    def unknowns(self) -> np.ndarray:
        return self.current.unknowns

    @property
    def registers(self) -> np.ndarray | None:
        return self.current.registers

    @property
    def samplers(self) -> list:
        return self.current.samplers

    @property
    def evaluations(self) -> int:
        return self.current.evaluations

    @evaluations.setter
    def evaluations(self, count: int) -> None:
        self.current.evaluations = count

    @property
    def jacobians(self) -> int:
        return self.current.jacobians

    @property
    def most_steps(self) -> int:
        return self.current.most_steps

    def in_c(self) -> InC | None:
        return self.current.in_c()

    def casadi_dae(self) -> CasadiDAE | None:
        return self.current.casadi_dae()


class _Stepper(Stepper):
    """The stepper of the current system."""

    def __init__(self, system: CompiledLater) -> None:
        self.system = system
        self.inner: Stepper = system.current.stepper()

    @property
    def x(self) -> np.ndarray:
        return self.inner.x

    @property
    def f(self) -> np.ndarray:
        return self.inner.f

    @property
    def x_new(self) -> np.ndarray:
        return self.inner.x_new

    @property
    def k(self) -> np.ndarray:
        return self.inner.k

    def start(self, t, x, rtol, atol) -> None:
        self.tolerances = rtol, atol
        self.inner.start(t, x, rtol, atol)

    def attempt(self, t: float, h: float) -> tuple[float, float]:
        if self.system.take_over():
            x = self.inner.x.copy()
            self.inner = self.system.current.stepper()
            self.inner.start(t, x, *self.tolerances)
        return self.inner.attempt(t, h)

    def stages(self, t: float, h: float) -> np.ndarray:
        return self.inner.stages(t, h)

    def accept(self) -> None:
        self.inner.accept()
