"""Newton's method for many small systems of equations at once.

The damping follows Deuflhard, Newton Methods for Nonlinear Problems (2004), section 3.3: a step is halved until the
next simplified Newton correction is shorter, a test that does not depend on how the equations are scaled.

At a solution the matrix may be singular: two cubic springs in a row at their own zero. There the residual alone tells.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

TIGHT = 1e-13  # of the size of the unknowns: no correction is smaller in double precision
LOOSE = 1e-8  # good enough where the corrections do not shrink any more
_ITERATIONS = 50
_FEW = 10  # enough from nearby
_HALVINGS = 12
_IN_VAIN = 8  # so many steps that halve neither the residuals nor the corrections end a search
_BESIDE = (1e-3, 0.1, 1.0, 10.0)  # how far beside a flat first guess a search begins again, on both sides
_FLAT = 100.0  # times the size of the unknowns: a guess is flat from which the first step leads that far, or nowhere
_PAUSE = 25  # evaluations after a costly search in vain in which there is no other; four times as many each time
_NEAR_SAME = 1e-6  # of the size of the unknowns: solutions found from both sides are the same
_ROUNDING = 1e-15  # of the terms of an equation: what their sum may miss zero by
NEAR = 0.25  # of the way to the solution: as much as the first step may miss it (Deuflhard, section 5.1)


def dense_solve(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """``np.linalg.solve`` for stacks of matrices where singular ones give NaN."""
    if a.shape[-1] == 1:
        with np.errstate(all="ignore"):
            x = b / a
        x[~np.isfinite(x)] = np.nan
        return x
    try:
        return np.linalg.solve(a, b)
    except np.linalg.LinAlgError:
        shape = np.broadcast_shapes(a.shape[:-2], b.shape[:-2])
        a, b = np.broadcast_to(a, shape + a.shape[-2:]), np.broadcast_to(b, shape + b.shape[-2:])
        x = np.empty(b.shape)
        for index in np.ndindex(shape):
            try:
                x[index] = np.linalg.solve(a[index], b[index])
            except np.linalg.LinAlgError:
                x[index] = np.nan
        return x


def vanishes(a: np.ndarray, r: np.ndarray, u: np.ndarray) -> np.ndarray:
    """Return which instances are solved to rounding: (instances,), from matrix, residual and unknowns.

    Where a term has overflowed, nothing is solved.
    """
    terms = (np.abs(a) @ np.abs(u)[..., None])[..., 0]
    return ((np.abs(r) <= _ROUNDING * terms) & (terms < np.inf)).all(axis=-1)


def correction(a: np.ndarray, r: np.ndarray, u: np.ndarray) -> np.ndarray:
    """Newton's correction (instances, size): none where the residual vanishes, the shortest where `a` is singular.

    NaN where a singular `a` has none.
    """
    step = -dense_solve(a, r[..., None])[..., 0]
    far = ~(np.abs(step).max(axis=1) <= LOOSE * (1.0 + np.abs(u).max(axis=1)))
    if far.any():
        step[far & vanishes(a, r, u)] = 0.0
        for k in np.flatnonzero(~np.isfinite(step).all(axis=1)):
            step[k] = -shortest_solution(a[k], r[k])[0]
    return step


def shortest_solution(a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The shortest x with ``a x = b`` for a singular matrix, and which rows of x the equations determine.

    NaN where there is none. By the singular value decomposition (Golub and Van Loan, Matrix Computations, 5.5) of the
    matrix with columns of one size, so that unknowns which count little count.
    """
    if not (np.isfinite(a).all() and np.isfinite(b).all()):
        return np.full(b.shape, np.nan), np.zeros(len(a), bool)
    size = np.abs(a).max(axis=0)
    size[size == 0] = 1.0
    left, singular, right = np.linalg.svd(a / size)
    rank = int(np.count_nonzero(singular > TIGHT * singular.max(initial=0.0)))
    x = (right[:rank] / size).T @ ((left[:, :rank].T @ b).T / singular[:rank]).T
    reach = np.multiply.outer(np.abs(a).sum(axis=1), np.abs(x).max(axis=0))
    missed = np.abs(a @ x - b) > TIGHT * (reach + np.abs(b))
    determined = np.abs(right[rank:]).max(axis=0, initial=0.0) < LOOSE
    return np.where(missed.any(axis=0), np.nan, x), determined


class Retries:
    """Decides whether a costly search for a solution is made again: ever more rarely, until one succeeds.

    Where a motion comes to the end of its solutions, each attempt at a step beyond it fails, and searching far and wide
    each time would take a hundred times as long as the run until there.
    """

    def __init__(self) -> None:
        self._failed, self._at = 0, 0

    def due(self, now: int) -> bool:
        """Return whether to search; `now` counts evaluations, and may begin anew."""
        return not self._failed or now < self._at or now - self._at >= _PAUSE * 4 ** (self._failed - 1)

    def note(self, found: bool, now: int) -> None:
        """Take note of how a search has ended."""
        self._failed, self._at = 0 if found else self._failed + 1, now


class Newton:
    """Solves ``residual(u) = 0`` for u of shape (instances, size) and starts from the last solution."""

    def __init__(self, shape: tuple[int, int]) -> None:
        self.shape = shape
        self.last: np.ndarray | None = None
        self.start = self.target = np.full(shape, np.nan)  # of the last search: its first guess, and after one step
        self.patient = True  # else only solutions nearby are sought
        self._count, self._retries = 0, Retries()

    def forget(self) -> None:
        self.last = None
        self._retries = Retries()

    @property
    def near(self) -> bool:
        """Return whether the last search has ended near where its first step pointed: at the intended solution."""
        if self.last is None:
            return False
        with np.errstate(invalid="ignore"):
            size, way = 1.0 + np.abs(self.last), np.abs(self.last - self.start)
            missed = np.abs(self.last - self.target).max()
            return bool(missed <= NEAR * way.max() + LOOSE * size.max() and (way <= NEAR * size).all())

    def solve(
        self,
        residual: Callable[[np.ndarray], np.ndarray],
        matrix: Callable[[np.ndarray], np.ndarray],
        guess: np.ndarray,
    ) -> np.ndarray:
        """The solution; NaN in every instance where none was found.

        Parameters
        ----------
        residual : (instances, size) -> (instances, size)
        matrix : Jacobian at the point where `residual` was called last, (instances, size, size)
        guess : used where there is no earlier solution
        """
        self._count += 1
        self.start = guess if self.last is None else np.where(np.isfinite(self.last), self.last, guess)
        u, good, self.target = iterate(residual, matrix, self.start, _ITERATIONS if self.patient else _FEW)
        if not good.all():
            self.target = np.full(self.shape, np.nan)  # wherever this ends, it is not near
            if self.patient and (self.last is None or self._retries.due(self._count)):
                u, good = self._from_guess(residual, matrix, guess, u, good)
                self._retries.note(bool(good.all()), self._count)
        u = np.where(good[:, None], u, np.nan)
        if good.all():
            self.last = u
        return u

    def _from_guess(self, residual, matrix, guess, u, good) -> tuple[np.ndarray, np.ndarray]:
        """Solutions from the first guess where there are none from the last solution, and from beside a flat guess."""
        if self.last is not None:
            u, good, _ = iterate(residual, matrix, guess, _ITERATIONS)
        flat = ~good
        if flat.any():
            r = residual(guess)
            step = np.abs(correction(matrix(guess), r, guess)).max(axis=1)
            flat &= np.isfinite(r).all(axis=1) & ~(step <= _FLAT * (1.0 + np.abs(guess).max(axis=1)))
        return _from_both_sides(residual, matrix, guess, u, good) if flat.any() else (u, good)


def _from_both_sides(residual, matrix, guess, u, good) -> tuple[np.ndarray, np.ndarray]:
    """Solutions of the instances whose first guess is a flat place (``e^3 = f`` at ``e = 0``), from beside it.

    One is taken where both sides lead to the same; where they part, as at ``cos(x) = 0`` from ``x = 0``, neither is
    what the model says.
    """
    for away in _BESIDE:
        aside = away * (1.0 + np.abs(guess))
        found = [iterate(residual, matrix, guess + sign * aside, _ITERATIONS) for sign in (1.0, -1.0)]
        (one, one_good, _), (other, other_good, _) = found
        with np.errstate(invalid="ignore"):
            same = np.abs(one - other).max(axis=1) <= _NEAR_SAME * (1.0 + np.abs(one).max(axis=1))
        new = ~good & one_good & other_good & same
        u, good = np.where(new[:, None], one, u), good | new
        if good.all():
            break
    return u, good


def iterate(residual, matrix, start: np.ndarray, most: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Damped Newton steps from `start`: the point reached, which instances have converged, where the first step led.

    Where there is no solution the steps wander about the place that comes nearest to one: they are given up there.
    """
    u, target = start.copy(), start
    r = residual(u)
    before = np.full(len(u), np.inf)
    best, progress = np.full((2, len(u)), np.inf), 0
    for iteration in range(most):
        a = matrix(u)
        step = correction(a, r, u)
        target = target if iteration else u + step
        size = 1.0 + np.abs(u).max(axis=1)
        length = np.abs(step).max(axis=1)
        if (length <= TIGHT * size).all():
            return u + step, np.ones(len(u), bool), target
        stuck = (length <= LOOSE * size) & (length >= 0.5 * before)
        if (stuck | (length <= TIGHT * size)).all():
            return u, np.ones(len(u), bool), target
        if not np.isfinite(length).any():
            break
        reached = np.stack([np.abs(r).max(axis=1), length])
        if (reached <= 0.5 * best).any():
            best, progress = np.fmin(best, reached), iteration
        elif iteration - progress >= _IN_VAIN:
            break
        u, r = _damped(residual, a, u, step, length)
        before = length
    return u, _converged(residual, matrix, u), target


def _damped(residual, a, u, step, length):
    """The longest of the halved steps after which the simplified correction is shorter than the one before.

    A singular matrix does not tell how far to go: the whole step is taken as long as there are residuals.
    """
    factor = np.ones(len(u))
    for _ in range(_HALVINGS):
        new = u + factor[:, None] * step
        r = residual(new)
        after = np.abs(correction(a, r, new)).max(axis=1)
        small = after <= LOOSE * (1 + np.abs(new).max(axis=1))
        told = np.isfinite(after) | ~np.isfinite(r).all(axis=1)
        bad = ~(after <= (1.0 - factor / 4.0) * length) & (length > 0) & ~small & told
        if not bad.any():
            return new, r
        factor[bad] *= 0.5
    return new, r


def _converged(residual, matrix, u: np.ndarray) -> np.ndarray:
    r = residual(u)
    step = correction(matrix(u), r, u)
    return np.abs(step).max(axis=1) <= LOOSE * (1.0 + np.abs(u).max(axis=1))
