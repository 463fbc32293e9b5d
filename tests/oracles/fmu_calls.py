"""Calls of FMI in any order and with any value, and what has to come back to the bit: for FMUs of both versions."""

from __future__ import annotations

import random
from ctypes import c_double

import fmpy
import numpy as np
from fmpy.fmi1 import FMICallException

NUMBERS = 0.0, 1.0, -3.0, 1e-300, 1e300, float("nan"), float("inf")
AHEAD = 0.1, 0.5, 0.0, -1.0, 1e-12, float("nan"), float("inf")  # s, of communication steps


class Caller:
    """An FMU under the names of FMI 3, whichever its version is; what it is called with may be wrong."""

    def __init__(self, description, folder: str, kind: str) -> None:
        self.description, self.kind, self.three = description, kind, description.fmiVersion.startswith("3")
        self.fmu = fmpy.instantiate_fmu(folder, description, fmi_type=kind)
        self.n, self.indicators = description.numberOfContinuousStates, description.numberOfEventIndicators
        self.references = [v.valueReference for v in description.modelVariables]
        self.inputs = [v.valueReference for v in description.modelVariables if v.causality == "input"]

        self.time = 0.0  # which Co-Simulation has come to, as far as it has been told

    def start(self, time: float = 0.0) -> None:
        """Initialize."""
        self.time = time
        if self.three:
            self.fmu.enterInitializationMode(startTime=time)
        else:
            self.fmu.setupExperiment(startTime=time)
            self.fmu.enterInitializationMode()
        self.fmu.exitInitializationMode()

    def get(self, references: list[int]) -> list[float]:
        """Return values of numbers."""
        return list((self.fmu.getFloat64 if self.three else self.fmu.getReal)(references))

    def set(self, references: list[int], values: list[float]) -> None:
        """Set values of numbers."""
        (self.fmu.setFloat64 if self.three else self.fmu.setReal)(references, values)

    def step(self, time: float, ahead: float) -> None:
        """Go on, as Co-Simulation."""
        self.fmu.doStep(time, ahead)
        self.time = time + ahead

    def saved(self):
        """Return the state, and the state as bytes."""
        if self.three:
            state = self.fmu.getFMUState()
            return state, self.fmu.serializeFMUState(state)
        state = self.fmu.getFMUstate()
        return state, self.fmu.serializeFMUstate(state)

    def restore(self, state) -> None:
        """Go back to a state of this instance."""
        (self.fmu.setFMUState if self.three else self.fmu.setFMUstate)(state)

    def restore_bytes(self, saved: bytes) -> None:
        """Go to a state of any instance."""
        self.restore((self.fmu.deserializeFMUState if self.three else self.fmu.deSerializeFMUstate)(saved))

    def anything(self, states: list, rng: random.Random) -> None:
        """One of the calls of FMI, with any value."""
        fmu, number, room = self.fmu, rng.choice(NUMBERS), (c_double * max(self.n, self.indicators, 1))()
        calls = [
            self.start,
            lambda: fmu.enterInitializationMode(),
            lambda: fmu.exitInitializationMode(),
            lambda: self.get([rng.choice(self.references)]),
            lambda: self.set([rng.choice(self.references)], [number]),
            lambda: self.inputs and self.set([rng.choice(self.inputs)], [number]),
            lambda: self.get([10**6]),
            lambda: states.append(self.saved()[0]),
            lambda: states and self.restore(rng.choice(states)),
            lambda: fmu.reset(),
            lambda: fmu.terminate(),
        ]
        if self.kind == "CoSimulation":
            calls += [lambda: self.step(rng.choice([self.time, self.time, number]), rng.choice(AHEAD))] * 5
        else:
            calls += [
                lambda: fmu.enterEventMode(),
                lambda: fmu.updateDiscreteStates() if self.three else fmu.newDiscreteStates(),
                lambda: fmu.enterContinuousTimeMode(),
                lambda: fmu.setTime(rng.choice([3 * rng.random(), number])),
                lambda: fmu.getContinuousStates(room, self.n),
                lambda: fmu.setContinuousStates((c_double * max(self.n, 1))(*[number] * self.n), self.n),
                lambda: (fmu.getContinuousStateDerivatives if self.three else fmu.getDerivatives)(room, self.n),
                lambda: fmu.getEventIndicators(room, self.indicators),
                lambda: fmu.completedIntegratorStep(),
            ] * 2
        rng.choice(calls)()


def anything_goes(description, folder: str, kind: str, seeds: range, calls: int = 60) -> tuple[int, int]:
    """How many of random calls were carried out, and how many refused; a crash ends the process."""
    answered = refused = 0
    for seed in seeds:
        rng, states, caller = random.Random(seed), [], Caller(description, folder, kind)
        if seed % 2:
            caller.start()
        for _ in range(calls):
            try:
                caller.anything(states, rng)
                answered += 1
            except FMICallException:
                refused += 1
        caller.fmu.freeInstance()
    return answered, refused


def goes_on_to_the_bit(description, folder: str, stop: float) -> list[str]:
    """What is not the same: after a state is restored, in another instance, after a reset, beside another instance.

    To save a state is no part of the motion: after a reset it goes on without that, to the same bits.
    """
    shown = [v.valueReference for v in description.modelVariables if v.type in ("Real", "Float64")]
    one, other = (Caller(description, folder, "CoSimulation") for _ in range(2))
    wrong = []

    def expect(what: str, caller: Caller, expected: list[float]) -> None:
        found = caller.get(shown)
        if not np.array_equal(found, expected, equal_nan=True):
            names = [v.name for v in description.modelVariables if v.valueReference in shown]
            differ = [n for n, a, b in zip(names, found, expected, strict=True) if a != b and not (a != a and b != b)]
            wrong.append(f"{what}: {', '.join(differ[:4])}")

    one.start()
    one.step(0.0, 0.37 * stop)
    middle = one.get(shown)
    state, saved = one.saved()
    one.step(0.37 * stop, 0.4 * stop)
    expected = one.get(shown)
    one.step(0.77 * stop, 0.1 * stop)
    one.restore(state)
    expect("what is restored", one, middle)
    other.start()
    other.step(0.0, 0.9 * stop)
    other.restore_bytes(saved)
    expect("what is restored from bytes", other, middle)
    for caller in (one, other):
        caller.step(0.37 * stop, 0.4 * stop)
    expect("after a restored state", one, expected)
    expect("after a state from bytes", other, expected)
    for caller in (one, other):
        caller.fmu.reset()
        caller.start()
    one.step(0.0, 0.37 * stop)  # in turns with the other one
    other.step(0.0, 0.37 * stop)
    one.step(0.37 * stop, 0.4 * stop)
    other.step(0.37 * stop, 0.4 * stop)
    expect("after a reset", one, expected)
    expect("after a reset of another one", other, expected)
    for caller in (one, other):
        caller.fmu.freeInstance()
    return wrong
