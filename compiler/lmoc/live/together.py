"""Live scenes of one model that go on side by side.

Where each of them only integrates, one call of C takes all of them to their next times: a call of Python for each would
cost more than its step. The others go on one by one.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lmoc.live.integrator import AT_ONCE, Held
from lmoc.live.scene import Live
from lmoc.messages.diagnostics import Diagnostic, ModelError, SimulationError
from lmoc.numerics.steps.onward import Abreast


class Together:
    """Live scenes of one model, copies of one of them.

    Attributes
    ----------
    inputs : names of inputs at which numbers stand, given anew at each step
    times : (scenes,) s, where they stand
    """

    def __init__(self, lives: Sequence[Live], inputs: Sequence[str]) -> None:
        self._lives, self.inputs = list(lives), tuple(inputs)
        self.times = np.array([live.time for live in lives])
        self._given = np.zeros((len(lives), len(self.inputs)))
        self._ahead = np.zeros(len(lives), bool)  # of the `Live`, which learns of it when somebody asks for it
        self._held: list[Held | None] = [None] * len(lives)
        self._abreast: Abreast | None = None
        for k in range(len(lives)):
            self._take(k)
        self._begin()

    def _take(self, k: int) -> None:
        """Look at whether a scene goes on in C."""
        live = self._lives[k]
        self.times[k], self._ahead[k] = live.time, False
        self._given[k] = [live.inputs[name] for name in self.inputs]
        held = self._held[k] = live.held(self.inputs)
        if held is None:
            self._abreast = None
        elif self._abreast is not None:
            self._abreast.put(k, held.run)

    def _begin(self) -> None:
        """Have all go on in C if each of them can."""
        held = [own for own in self._held if own is not None]
        if len(held) == len(self._lives):
            self._abreast = Abreast([own.run for own in held], held[0].registers, AT_ONCE)

    def __getitem__(self, k: int) -> Live:
        """Return a scene as it stands; whoever changes it tells `changed`."""
        live = self._lives[k]
        if self._ahead[k]:
            live.stand_at(float(self.times[k]), dict(zip(self.inputs, self._given[k].tolist(), strict=True)))
            self._ahead[k] = False
        return live

    def changed(self, k: int) -> None:
        """Look anew at a scene that somebody else has changed."""
        self._take(k)
        if self._abreast is None:
            self._begin()

    def advance(self, values: np.ndarray, dt: float, resting: np.ndarray | None = None) -> dict[int, SimulationError]:
        """Go on by dt seconds.

        Parameters
        ----------
        values : (scenes, inputs) numbers at the inputs, which hold from now on
        resting : (scenes,) which do not go on

        Returns
        -------
        dict
            The errors with which scenes have stopped on the way, by their numbers.

        Raises
        ------
        ModelError
            E0621: a value is no finite number; nothing has moved.
        """
        if not np.isfinite(values).all():
            k, i = np.argwhere(~np.isfinite(values))[0]
            found, message = f"{values[k, i]!r}", f"'{self.inputs[i]}' cannot be set to this value"
            raise ModelError([Diagnostic("E0621", message, expected="a finite number", found=found)])
        ends = self.times + dt
        if resting is not None:
            ends[resting], values = self.times[resting], np.where(resting[:, None], self._given, values)
        self._given[:] = values
        behind = self._go(values, ends)
        errors = {}
        for k in [] if behind is None else np.flatnonzero(behind).tolist():
            try:
                self._follow(k, float(ends[k]))
            except SimulationError as error:
                errors[k] = error
        return errors

    def _go(self, values: np.ndarray, ends: np.ndarray) -> np.ndarray | None:
        """Go on in C; returns which scenes (scenes,) have not come to their ends, None where all have."""
        own, held = self._abreast, self._held[0]
        if own is None or held is None:
            return ends > self.times
        own.values[:], own.ends[:] = values[:, held.places], ends
        behind = own.go()
        self._ahead[:] = True
        if behind is None:
            self.times[:] = ends
            return None
        self.times[~behind] = ends[~behind]
        return behind

    def _follow(self, k: int, end: float) -> None:
        """Have a scene go on by itself."""
        if self._ahead[k]:  # it has begun its way in C
            held = self._held[k]
            assert held is not None
            self.times[k] = held.run.t
            live = self[k]
        else:
            live = self._lives[k]
            for name, value in zip(self.inputs, self._given[k].tolist(), strict=True):
                live.inputs[name] = value
        try:
            live.reach(end)
        finally:
            self.changed(k)

    def values(self, names: Sequence[str]) -> np.ndarray:
        """Return the values (scenes, names) of variables now.

        Raises
        ------
        UnknownNameError
            A KeyError, as of a single scene.
        """
        places = None if self._abreast is None else self._lives[0].places(names)
        if places is not None and self._abreast is not None:
            found: np.ndarray = self._abreast.x[:, places]
            return found
        return np.array([self[k].values(names) for k in range(len(self._lives))])
