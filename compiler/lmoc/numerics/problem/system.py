"""The protocol of a numeric system, x' = f(t, x): right-hand side, Jacobian, root functions, steps.

A run integrates one `System`; parameters are data of it, set by `prepare`. The implementations are
`evaluate.engine_system`, and for larger scenes with laws `laws.delassus_update`; `laws.select.make_system` chooses.
Whoever holds a system asks it what it can do and never of which class it is.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import field
from typing import NamedTuple, Protocol, TypeVar

import numpy as np

from lmoc.engine.kernel import Call, Kernel
from lmoc.numerics.plan.plan import Plan
from lmoc.numerics.problem.stepper import Stepper
from lmoc.numerics.signals.signals import Signal, sample
from lmoc.support.records import dataclass

Series = TypeVar("Series")
Programs = Sequence[tuple[Kernel, Call | None]]  # each with what remembers where it has been evaluated last


@dataclass(frozen=True)
class CasadiDAE:
    """x' = ode(t, x, p) in casadi's symbols.

    Attributes
    ----------
    equations : {"t", "x", "p", "ode"}
    parameters : (k,) values of p
    kept : integrators made for it so far, by their options
    """

    equations: dict[str, object]
    parameters: np.ndarray
    kept: dict[tuple, object] = field(default_factory=dict)


class OpenedSystem(Protocol):
    """``x' = f(t, x, z), 0 = g(t, x, z)`` for y = (x, z): what `System.opened` returns.

    Attributes
    ----------
    differential : (n,) which components of y have derivatives
    algebraic_size : least size of z for the test of Newton's method
    """

    n: int
    description: str
    differential: np.ndarray
    algebraic_size: float

    def start(self, t: float, x: np.ndarray) -> np.ndarray:
        """Return (x, z) with z consistent."""

    def rhs(self, t: float, x: np.ndarray, out: np.ndarray) -> None: ...

    def pattern(self) -> tuple[np.ndarray, np.ndarray]: ...

    def jacobian_values(self, t: float, x: np.ndarray, out: np.ndarray) -> None: ...


class InC(NamedTuple):
    """Addresses with which C functions evaluate a system (``c/evaluate.c``).

    Attributes
    ----------
    call, evaluate, mark : of the ``lmoc_call``, of ``lmoc_evaluate`` and ``lmoc_mark``
    registers : of `System.registers`
    """

    call: int
    evaluate: int
    mark: int
    registers: int


class System(ABC):
    """x' = f(t, x), with 0 = roots(t, x) at the places where something switches.

    Attributes
    ----------
    n : number of integrated components
    description : how it is evaluated, for the statistics of a run
    evaluations, jacobians : calls so far
    given : what `prepare` has been called with
    most_steps : steps that are still cheap beside what another method needs to begin
    """

    description = ""
    most_steps = 10_000

    def __init__(self, plan: Plan) -> None:
        self.plan = plan
        self.n = len(plan.states)
        self.evaluations = 0
        self.jacobians = 0
        self.samplers: list[Callable[[float], float]] = []
        self._sampled: list[tuple[Signal, int]] = []

    def prepare(self, base: np.ndarray, signals: Mapping[int, Signal]) -> None:
        """Take the parameter values of a run (`Plan.base`) and the functions behind sampled inputs."""
        self.given = base, signals
        self.evaluations = self.jacobians = 0
        self.samplers = [_sampler(signals[v], order) for v, order in self.plan.samplers]
        self._sampled = [(signals[v], order) for v, order in self.plan.samplers]

    def put(self, register: int, value: float) -> None:
        """Give a register that does not change along the motion another value: a constant input."""
        self.given[0][register] = value
        self.prepare(*self.given)

    def sample(self, t: float, out: np.ndarray) -> None:
        """Write the values of the sampled inputs at one time into `out`."""
        for k, call in enumerate(self.samplers):
            out[k] = call(t)

    def sample_many(self, times: np.ndarray, out: np.ndarray) -> None:
        """Write the values of the sampled inputs at several times into `out`, (times, inputs)."""
        for k, (signal, order) in enumerate(self._sampled):
            out[:, k] = sample(signal, order, times)

    @property
    def python_inputs(self) -> int:
        """Return how many inputs Python gives wherever the system is evaluated."""
        return len(self.samplers)

    # ------------------------------------------------------------------ what every system has

    @abstractmethod
    def rhs(self, t: float, x: np.ndarray, out: np.ndarray) -> None:
        """Write f(t, x) into `out`."""

    def rhs_near(self, t: float, x: np.ndarray, unknowns: np.ndarray, solutions: np.ndarray, out: np.ndarray) -> None:
        """Write f(t, x) on the branch of some solutions into `out`; it does not count as an evaluation of a method.

        Parameters
        ----------
        unknowns, solutions : (k,) registers of all unknowns of nonlinear blocks, and their values nearby
        """
        base, signals = self.given
        there = base.copy()
        there[unknowns] = solutions
        self.prepare(there, signals)
        self.rhs(t, x, out)

    @abstractmethod
    def pattern(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the CSC pattern (indptr, indices) of ∂f/∂x."""

    @abstractmethod
    def jacobian_values(self, t: float, x: np.ndarray, out: np.ndarray) -> None:
        """Write the entries of ∂f/∂x in the order of `pattern` into `out`."""

    def roots(self, t: float, x: np.ndarray) -> np.ndarray:
        """Return the values of the root functions."""
        return np.zeros(0)

    def jacobian(self, t: float, x: np.ndarray) -> np.ndarray:
        """Return ∂f/∂x as a dense matrix."""
        indptr, indices = self.pattern()
        values = np.empty(len(indices))
        self.jacobian_values(t, x, values)
        matrix = np.zeros((self.n, self.n))
        matrix[indices, np.repeat(np.arange(self.n), np.diff(indptr))] = values
        return matrix

    @abstractmethod
    def stepper(self) -> Stepper:
        """Return what makes steps of DOP853 with this system."""

    # ------------------------------------------------------------------ what only some have

    def mark(self) -> None:
        """Take the last evaluation for a place to go back to: that of an accepted step."""
        return

    def go_back(self) -> None:
        """Have nonlinear blocks go on from the place marked last: a step from there has been rejected.

        Where it has led too far, they may have come to another branch, which shorter steps would keep to.
        """
        return

    @property
    def unknowns(self) -> np.ndarray:
        """One register of each instance of the nonlinear blocks whose determinants are at hand."""
        return np.zeros(0, int)

    def determinants(self) -> np.ndarray:
        """Return the determinants of the Jacobians of these instances, at the evaluation made last."""
        return np.zeros(0)

    def restart(self) -> None:
        """Forget the solutions of blocks: the next evaluation is at the start again."""
        return None

    @property
    def registers(self) -> np.ndarray | None:
        """(plan.count,) all registers as the last evaluation has left them, where it keeps them."""
        return None

    def opened(self) -> OpenedSystem | None:
        """Return the index-1 form with the unknowns of large blocks as algebraic variables; None without any."""
        return None

    def callback(self, order: np.ndarray | None, implicit: bool = False):
        """Return f as a compiled callback of CVODE with its data, states in a new order, or None.

        Parameters
        ----------
        implicit : x' - f, as a callback of IDA
        """
        return None

    def with_series(self, of_plan: Callable[[Plan], Series]) -> Series:
        """Return the same system with Taylor series; `of_plan`: makes that of a plan."""
        return self.plan.once(of_plan)

    def in_c(self) -> InC | None:
        """Return what C functions evaluate it with, or None where that takes Python."""
        return None

    def programs(self) -> Programs:
        """Return what in C is given the registers that do not change between events; nothing where that is Python."""
        return ()

    def casadi_dae(self) -> CasadiDAE | None:
        """Return the equations as casadi's integrators take them, or None where they are not one function."""
        return None


def _sampler(signal: Signal, order: int) -> Callable[[float], float]:
    return lambda t: float(signal.value(t, order))
