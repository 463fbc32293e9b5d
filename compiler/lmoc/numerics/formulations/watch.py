"""The watch over a run in all coordinates of its loops: drift, projection, and places where closures lose rank.

Where one freedom is left, closures and tangent of the motion make a square matrix whose determinant changes its sign at
a simple bifurcation (Allgower & Georg, Numerical Continuation Methods, 1990, chapter 8); so do closures and tangent
space with more of them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lmoc.numerics.formulations.manifold import Manifold
from lmoc.numerics.observe.observer import Observer
from lmoc.numerics.options.formulations import Formulation
from lmoc.numerics.options.options import TimeSpan
from lmoc.numerics.problem.status import Status
from lmoc.support.records import dataclass

if TYPE_CHECKING:
    from lmoc.numerics.formulations.index_two import IndexTwo

# smallest singular value of a loop's closures, in rows of the lengths that they have had: below which steps are looked
# at closely, below which a place without a way on is singular, below which shorter steps are no way past it, and below
# which it is singular in any case
_NEAR, _DEPENDENT, _CLOSE, _SINGULAR = 0.3, 1e-2, 1e-3, 1e-4
_CHANGE, _TURN = 2.0, 0.9  # most change of that value in one step there, and least cosine between the tangent spaces
_STALLED = 1e-9  # of the run: a step as short does not come past a place where they do


class LoopWatch:
    """Looks at every accepted step of a run in all coordinates of its loops.

    Attributes
    ----------
    correction : moves the end of a step onto the closures; None where the formulation does not
    index_one : the equations for IDA, where closures are among them
    position, velocity : largest residuals so far at the ends of steps
    reason : why the run cannot go on
    """

    def __init__(self, observer: Observer, scale: np.ndarray, form: Formulation, span: TimeSpan) -> None:
        """
        Parameters
        ----------
        scale : (n,) sizes of the states
        """
        plan, base, signals = observer.plan, observer.base, observer.signals
        self.manifold = Manifold(plan, base, signals, scale)
        self.form, self.span = form, span.end - span.start
        self.correction = self.correct if form.name == "projected" else None
        self.landing = self.manifold.landing if self.correction is not None else None
        self.index_one: IndexTwo | None = None
        if form.implicit:
            from lmoc.numerics.formulations import index_two

            self.index_one = plan.once(index_two.stabilized if form.name == "ggl" else index_two.unstabilized)
            self.index_one.prepare(base, signals, self.manifold)
        self.position = self.velocity = 0.0
        self.reason = ""
        self._sizes = [np.full((*own.rows.shape, 1), 1e-300) for own in self.manifold.stages[0].loops]
        self.longest, self._least = np.inf, 1.0
        self._left: tuple[float, np.ndarray] | None = None  # by steps in C, not taken for the last place yet
        self._beyond = -np.inf  # where the steps that were too long have led to

    def begin(self, t: float, x: np.ndarray) -> None:
        """Take a place for the end of the last step: where a run begins, or where steps in C have led to."""
        self._left = None
        self._accept(t, x, self._look(t, x))
        self._firm = self.landing is not None and self.landing.begin(t, x)

    def enter(self, most: int) -> int | None:
        """Return what judges and corrects steps in C; None where closures have to be looked at more closely."""
        return self.landing.address if self._firm and self.longest == np.inf else None

    def leave(self, t: float, x: np.ndarray) -> None:
        """Take the place that steps judged in C have led to for the last one, when it is needed."""
        self._left = t, x.copy()

    def __call__(self, t: float, x: np.ndarray) -> Status:
        """Judge an accepted step: COORDINATES where it is to be made again, of another length (`length`)."""
        if self._left is not None:
            self.begin(*self._left)
        if self._firm and self.longest == np.inf and self.landing.follows(t, x):
            self._accept(t, x, None)
            return Status.OK
        last, now = self._last or self._look(*self._place), self._look(t, x)
        if last.margin < _SINGULAR:
            self.reason = _BRANCH
            return Status.SINGULAR
        if self._turned(last, now):
            self._least = min(now.margin, last.margin)
            self.longest, self._beyond = (t - self.before) / 4, max(t, self._beyond)
            return Status.COORDINATES
        far = self._firm or min(now.margin, last.margin) > _NEAR
        if self.longest < np.inf and self.before > self._beyond and far:
            self.longest = np.inf
            return Status.COORDINATES
        self._accept(t, x, now)
        self._firm = self.landing is not None and self.landing.begin(t, x)
        if self.correction is None:
            self._note(t, x)
        return Status.OK

    def stuck(self, status: Status) -> Status:
        """Return SINGULAR where no step was short enough and the closures nearly depend on each other."""
        if self._least < _DEPENDENT:
            self.reason = _BRANCH
            return Status.SINGULAR
        return status

    @property
    def is_near(self) -> bool:
        """Return whether the closures come to a place where they depend on each other, or there is no way on."""
        return bool(self.reason) or self._least < _CLOSE

    def why(self, status: Status) -> str:
        """Return why a run could not go on, where more is known than its status."""
        if not self.reason and self.form.name == "index3":
            return f"{status.value}: {_INDEX_THREE}"
        return self.reason

    def length(self) -> float | None:
        """Return the longest step from where the last one began; None where shorter ones do not help."""
        if self.longest > _STALLED * self.span:
            return self.longest
        self.reason = _BRANCH
        return None

    def correct(self, t: float, x: np.ndarray) -> np.ndarray:
        """Return the end of a step moved onto the closures; NaN where there is no way."""
        moved = self.manifold.project(np.array([t]), x[None])[0]
        if self._firm:  # what is left has been noted in C
            return moved
        if not np.isfinite(moved).all():
            self.reason = "the state cannot be projected onto the closures of its loops"
            return moved
        self._note(t, moved)
        return moved

    def output(self, times: np.ndarray, states: np.ndarray) -> np.ndarray:
        """Return states at output times as the run shows them."""
        own = times[: len(states)]
        return states if self.correction is None else self.manifold.project(own, states)

    @property
    def stats(self) -> dict[str, object]:
        """For the statistics of the run."""
        position, velocity = (0.0, 0.0) if self.landing is None else self.landing.residuals
        return {
            "position_residual": max(self.position, position), "velocity_residual": max(self.velocity, velocity)
        }  # fmt: skip

    def _note(self, t: float, x: np.ndarray) -> None:
        position, velocity = self.manifold.residuals(np.array([t]), x[None])
        self.position, self.velocity = max(self.position, position), max(self.velocity, velocity)

    def _accept(self, t: float, x: np.ndarray, look: _Look | None) -> None:
        """Take the end of a step for the last place; how the closures stand there is found out when it is needed."""
        self._place, self._last, self.before = (t, x.copy()), look, t
        self._least = 1.0 if look is None else look.margin

    def _look(self, t: float, x: np.ndarray) -> _Look:
        """Return how the closures stand at a place."""
        stage = self.manifold.stages[0]
        _, entries = self.manifold.values(np.array([t]), x[None])[0]
        across, tangents, margin = [], [], 1.0
        for k, own in enumerate(stage.loops):
            matrix = own.matrices(entries)[0] * self.manifold.scale[own.columns][:, None, :]
            self._sizes[k] = np.fmax(self._sizes[k], np.linalg.norm(matrix, axis=-1, keepdims=True))
            rows = matrix / self._sizes[k]
            q, r = np.linalg.qr(np.swapaxes(rows, -1, -2), mode="complete")
            m = rows.shape[-2]
            margin = min(margin, float(np.linalg.svd(r[..., :m, :], compute_uv=False).min(initial=1.0)))
            across.append(np.swapaxes(rows, -1, -2))
            tangents.append(q[..., m:])
        return _Look(across, tangents, margin)

    def _turned(self, last: _Look, now: _Look) -> bool:
        """Return whether a step may have led over a singular place: closures that turn, or change much near to it."""
        least = min(now.margin, last.margin)
        if not least >= 0:  # no number
            return True
        if least < _NEAR and max(now.margin, last.margin) > _CHANGE * least:
            return True
        for k, tangent in enumerate(last.tangents):
            turned = _orientation(now.across[k], tangent) * _orientation(last.across[k], tangent)
            kept = np.linalg.svd(np.swapaxes(tangent, -1, -2) @ now.tangents[k], compute_uv=False).min(initial=1.0)
            if (turned < 0).any() or (least < _NEAR and kept < _TURN):
                return True
        return False


@dataclass(frozen=True, eq=False)
class _Look:
    """The closures of a scene at a place, by shape of loops.

    Attributes
    ----------
    across : (loops, n, m) closures, rows of the lengths that they have had
    tangents : (loops, n, n - m) orthonormal
    margin : smallest singular value of the closures
    """

    across: list[np.ndarray]
    tangents: list[np.ndarray]
    margin: float


def _orientation(across: np.ndarray, tangent: np.ndarray) -> np.ndarray:
    """The sign of the determinant of closures (loops, n, m) and tangent space (loops, n, n-m) side by side."""
    return np.linalg.slogdet(np.concatenate([across, tangent], axis=-1))[0]


_INDEX_THREE = (
    "rounding in the closures is divided by the square of the step where they are not differentiated (index 3), so "
    "shorter steps are no more accurate"
)
_BRANCH = (
    "the closures of its loops depend on each other here: a singular position, beyond which the motion may continue "
    "along another branch (the formulation reduced passes most such positions)"
)
