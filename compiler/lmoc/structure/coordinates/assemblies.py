"""The ways in which closed loops can be put together, and the one nearest to what is wished.

A loop of given lengths closes in several ways: a four-bar in two, a six-bar in up to six. All are looked for by
Newton's method from many places at once (steps of least weighted length, no longer than a radian), until each has been
found several times; solutions of polynomials come in pairs, so that an odd number of them is looked at for longer.
Where loops can move, what is found is moved to where it is nearest to what is wished. Of all that is found, turned by
whole turns where that leaves the loops closed, the nearest one is taken: first to the values that are given, then to
angles of zero. Where two are equally near a fixed rule decides, so that rounding does not.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property

import numpy as np

from lmoc.structure.coordinates.nearest_place import Surface, Wish, can_move, nearest_places
from lmoc.structure.coordinates.turns import TURN, Turns, nearest_turns, turns
from lmoc.structure.linear.generic import spread
from lmoc.support.distinct import distinct
from lmoc.support.records import dataclass

# places of one round, the rounds at most, how often each assembly must have been found for the search to be complete
PLACES, ROUNDS, SEEN = 16, 6, 3
_ROUNDS = 4  # of moving a point nearer, then turning it
AWAY = 2  # rounds at least where loops can move: the nearest place may be far from what is wished
PATIENCE = 2  # rounds after which it is given up if none has been found
# Newton's steps, the longest one in radians, the size of a step (of the values) at which it has converged
_STEPS, _RADIAN, _CLOSED = 30, 1.0, 1e-9
_MET = 1e-8  # of the terms of a row: what is left of it where a loop is closed
_DAMPED = 1e-11  # of rows of length 1: keeps the equations regular where constraints repeat each other
_SAME = 1e-5  # of a turn, of a length: as near two assemblies are one
_EQUAL = 1e-6  # of a turn, squared: as little the distances of two must differ to be the same
# of its size: what may be zero but for rounding, if the constraints then hold but for as much of their terms
_ZERO, _ROUNDING = 1e-6, 1e-13
_DEPENDENT = 1e-5  # singular values of rows of length 1 below which something can move
_GIVEN = 1e-4  # how easily what is given gives way at those places at which it is kept

Dense = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]


@dataclass(frozen=True, eq=False)
class Wishes:
    """What variables of the model shall be near to: ``factor·x[place] + offset``, each of one unknown.

    Attributes
    ----------
    level : (w,) what counts first: 0 for what is given, 1 for other coordinates, 2 for everything else; -1 where a
        place has been found at which further constraints hold that follow from these
    rank : (w,) what counts first among what is given
    """

    place: np.ndarray
    factor: np.ndarray
    offset: np.ndarray
    target: np.ndarray
    level: np.ndarray
    rank: np.ndarray

    def missed(self, x: np.ndarray) -> np.ndarray:
        """Return the differences (…, w) from what is wished at points (…, n)."""
        result: np.ndarray = self.factor * x[..., self.place] + self.offset - self.target
        return result


@dataclass(frozen=True, eq=False)
class Assemblies:
    """What has been found.

    Attributes
    ----------
    points : (k, n) the nearest first
    isolated : whether each is alone: nothing can move while what is held stays
    loose : whether something can move at the first one while what is held and given stays
    """

    points: np.ndarray
    isolated: bool
    loose: bool


@dataclass(frozen=True, eq=False)
class Loops:
    """Constraints that depend on each other, as functions of their unknowns.

    Attributes
    ----------
    dense : residual (…, rows) and Jacobian (…, rows, n) at points (…, n)
    residual : the first of them
    begin : (n,) a first guess
    held : (n,) mask of the unknowns that stay
    wishes : Wishes
    guessed : whether guesses are among what stays: what they leave open comes as near to angles of zero as it can
    """

    dense: Dense
    residual: Callable[[np.ndarray], np.ndarray]
    begin: np.ndarray
    held: np.ndarray
    wishes: Wishes
    guessed: bool = False

    @cached_property
    def turns(self) -> Turns:
        return turns(self.residual, self.dense, self.begin, self.held)

    @cached_property
    def given(self) -> np.ndarray:
        """(n,) mask of the unknowns with a guess."""
        mask = np.zeros(len(self.begin), bool)
        mask[self.wishes.place[self.wishes.level <= 0]] = True
        result: np.ndarray = mask & ~self.held
        return result

    @cached_property
    def aims(self) -> np.ndarray:
        """(n,) the values wished for."""
        aims, w = self.begin.copy(), self.wishes
        own = np.lexsort((-w.rank, -w.level))  # of several for the same, what counts most last
        own = own[(~self.held[w.place] & (self.turns.angle[w.place] | (w.level <= 0)))[own]]
        aims[w.place[own]] = (w.target[own] - w.offset[own]) / w.factor[own]
        return aims

    @cached_property
    def size(self) -> np.ndarray:
        """(n,) the sizes of the unknowns: 1 for angles, and one for all lengths."""
        angle = self.turns.angle
        lengths = self.aims[~angle & (self.held | self.given)]
        if not lengths.any():  # of links, as far as they follow from the angles that are wished for
            first = self._with_lengths(self.aims[None].copy(), (~self.held)[None].astype(float))
            lengths = first[0, ~angle]
        return np.where(angle, 1.0, max(float(np.abs(lengths).max(initial=0.0)), 1e-300))

    def found(self) -> Assemblies | None:
        """Return the ways in which the loops close; None where none is found."""
        points, counts, isolated = np.zeros((0, len(self.begin))), np.zeros(0, int), False
        for turn in range(ROUNDS):
            ended = self._closed(*self._places(turn, drive=len(points) > 0 and not isolated))
            if len(ended) and not isolated:
                isolated = self._isolated(ended[0])
            ended = ended if isolated else self._moved(ended)
            points, counts = self._distinct(points, counts, ended)
            if not len(points):
                if turn == PATIENCE - 1:
                    return None
                continue
            seen = counts.min() >= SEEN and len(points) % 2 == 0 and (isolated or turn >= AWAY)
            if seen or not (isolated or self.given.any() or self.guessed):
                break
        return self._ordered(points, isolated)

    def sorted(self, points: np.ndarray) -> Assemblies | None:
        """Return ways that have been found elsewhere, the nearest first; None where the loops are not closed there."""
        if not self._met(points, _MET).all():
            return None
        none = np.zeros((0, len(self.begin))), np.zeros(0, int)
        points, _ = self._distinct(*none, points)
        return self._ordered(points, self._isolated(points[0]))

    def _ordered(self, points: np.ndarray, isolated: bool) -> Assemblies:
        order = self._by_distance(points)
        loose = not isolated and can_move(
            self._surface, points[order[0]], self.held, self._given_first(points[order[:1]])
        )
        return Assemblies(np.array([self._rounded(x) for x in points[order]]), isolated, loose)

    def _places(self, turn: int, drive: bool) -> tuple[np.ndarray, np.ndarray]:
        """First guesses (k, n), and how easily each unknown gives way there.

        Parameters
        ----------
        drive : whether one angle after the other stays where it is put, anywhere on its circle, at half of the places:
            loops that can move are so looked at in all their positions
        """
        n, free, angle = len(self.begin), ~self.held, self.turns.angle
        kept = PLACES // 2  # at so many of them what is given stays near
        # on all sides of what is wished, first near it, then anywhere
        away = np.stack([2 * spread(n, turn * PLACES + k + 1) - 1 for k in range(PLACES)])
        near = np.linspace(0.0, 1.0, kept + 1)[1:]
        away *= np.concatenate([near, near])[:, None]
        first = self.aims + away * np.where(angle, np.pi, 1.0) * self.size * free
        first[:kept, self.given] = self.aims[self.given]
        weight = np.tile(free.astype(float), (PLACES, 1))
        weight[:kept, self.given] = _GIVEN
        if drive:
            driver = np.flatnonzero(free & angle)
            driver = np.resize(np.roll(driver, -turn * (PLACES - kept)), PLACES - kept) if len(driver) else driver
            rows = np.arange(kept, kept + len(driver))
            first[rows, driver] = self.aims[driver] + np.pi * (2 * spread(len(driver), turn) - 1)
            weight[rows, driver] = _GIVEN
        if not turn:
            more = np.stack([self.begin, self.aims])
            eased = np.tile(np.where(self.given, _GIVEN, free.astype(float)), (len(more), 1))
            first, weight = np.concatenate([more, first]), np.concatenate([eased, weight])
        moved = self._with_lengths(first, weight)
        moved[:2] = first[:2]  # the guesses themselves stay as they are
        return moved, weight

    def _with_lengths(self, first: np.ndarray, weight: np.ndarray) -> np.ndarray:
        """Points whose lengths fit their angles as well as can be: most constraints are linear in them."""
        lengths = np.flatnonzero(~self.turns.angle & ~self.held)
        if not len(lengths):
            return first
        with np.errstate(all="ignore"):
            residual, jacobian = self.dense(first)
            own = np.zeros_like(weight)
            own[:, lengths] = weight[:, lengths]
            step = _steps(residual, jacobian, own)
        return first + np.where(np.isfinite(step), step, 0.0)

    def _closed(self, x: np.ndarray, weight: np.ndarray) -> np.ndarray:
        """The points (k, n) at which Newton's method ends, from those places from which it converges."""
        ended, good = self._descended(x, weight)
        result: np.ndarray = ended[good]
        return result

    def _descended(self, x: np.ndarray, weight: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The points (k, n) at which Newton's method ends, and whether the loops are closed there (k,)."""
        x = x.copy()
        angle = self.turns.angle
        done = np.zeros(len(x), bool)
        with np.errstate(all="ignore"):
            for _ in range(_STEPS):
                residual, jacobian = self.dense(x[~done])
                step = _steps(residual, jacobian, weight[~done])
                longest = np.abs(step[:, angle]).max(axis=1, initial=0.0)
                step *= np.minimum(1.0, _RADIAN / np.maximum(longest, 1e-300))[:, None]
                x[~done] += step
                ended = ~(np.abs(step) > _CLOSED * np.maximum(self.size, np.abs(x[~done]))).any(axis=1)
                done[np.flatnonzero(~done)[ended]] = True
                if done.all():
                    break
            return x, np.isfinite(x).all(axis=1) & self._met(x, _MET)

    def _met(self, x: np.ndarray, share: float) -> np.ndarray:
        """Return whether the constraints hold at points (k, n), but for a share of their terms."""
        residual, jacobian = self.dense(x)
        size = (np.abs(jacobian) * np.maximum(self.size, np.abs(x))[:, None, :]).sum(axis=2) + 1e-300
        result: np.ndarray = (np.abs(residual) <= share * size).all(axis=1)
        return result

    def _rounded(self, x: np.ndarray) -> np.ndarray:
        """Return a point with zeros for what only rounding keeps from being zero."""
        small = ~self.held & ~self.given & (np.abs(x) <= _ZERO * self.size)
        zeroed = np.where(small, 0.0, x)
        return zeroed if small.any() and self._met(zeroed[None], _ROUNDING)[0] else x

    def _isolated(self, x: np.ndarray) -> bool:
        """Return whether nothing can move while what is held stays."""
        jacobian = self.dense(x)[1] * self.size
        size = np.linalg.norm(jacobian, axis=1)
        own = (jacobian / np.where(size > 0, size, 1.0)[:, None])[:, ~self.held]
        return bool(np.linalg.matrix_rank(own, _DEPENDENT) == own.shape[1])

    def _moved(self, points: np.ndarray) -> np.ndarray:
        """Return points (k, n) moved to where they are nearest to what is given, by whole turns, too.

        What that leaves open comes as near to angles of zero as it can.
        """
        wishes = self._given_first(points)
        points, moving = points.copy(), np.arange(len(points) if wishes or self.guessed else 0)
        wishes += self._unset(points)
        for _ in range(_ROUNDS):
            if not len(moving):
                break
            turned = np.array([self.turned(x) for x in points[moving]])
            points[moving] = nearest_places(self._surface, turned, self.held, wishes)
            moving = np.array([k for k in moving.tolist() if (self.turned(points[k]) != points[k]).any()], int)
        return points

    @cached_property
    def _surface(self) -> Surface:
        return Surface(self.dense, self._closed_at, self.size)

    def _closed_at(self, x: np.ndarray, held: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return self._descended(x, np.tile((~held).astype(float), (len(x), 1)))

    def _given_first(self, points: np.ndarray) -> list[Wish]:
        """What is given, by its levels."""
        return self._wished(points, [mask for mask in self._levels() if (self.wishes.level[mask] <= 0).all()])

    def _unset(self, points: np.ndarray) -> list[Wish]:
        """Angles that nobody has given, which are best zero, coordinates first."""
        w, angle = self.wishes, self.turns.angle[self.wishes.place]
        return self._wished(points, [(w.level == level) & angle for level in (1, 2)])

    def _wished(self, points: np.ndarray, masks: list[np.ndarray]) -> list[Wish]:
        w, size = self.wishes, self._sizes(points)
        slope, aim = w.factor / size, (w.target - w.offset) / size
        own = [mask & ~self.held[w.place] for mask in masks]
        return [Wish(w.place[mask], slope[mask], aim[mask]) for mask in own if mask.any()]

    def _distinct(
        self, points: np.ndarray, counts: np.ndarray, ended: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Add further ends to those found so far, turned to where they are nearest to what is wished."""
        angle = self.turns.angle
        for x in ended:
            for turned in (False, True):  # most are where one has been found, and need not be turned
                x = self.turned(x) if turned else x
                allowed = _SAME * np.where(angle, TURN, np.maximum(self.size, np.abs(x)))
                same = (np.abs(points - x) <= allowed).all(axis=1)
                if same.any():
                    counts[np.flatnonzero(same)[0]] += 1
                    break
            else:
                points, counts = np.vstack([points, x]), np.append(counts, 1)
        return points, counts

    def turned(self, x: np.ndarray) -> np.ndarray:
        """Return a point with its angles as many whole turns away as they are nearest to what is wished."""
        basis, w = self.turns.basis, self.wishes
        if not len(basis):
            return x
        own = self.turns.angle[w.place]
        weight = np.where(w.level == 0, 0.1 ** np.minimum(w.rank, 2), 1.0)[own]
        steps, size, level = basis[:, w.place[own]], TURN * (weight * w.factor[own]), np.maximum(w.level[own], 0)
        z = nearest_turns(weight * w.missed(x)[own], steps, size, level)
        result: np.ndarray = x + TURN * z @ basis
        return result

    def _by_distance(self, points: np.ndarray) -> np.ndarray:
        """Numbers of the points, the nearest first."""
        w, levels = self.wishes, self._levels()
        with np.errstate(all="ignore"):
            missed = np.where(self.held[w.place], 0.0, w.missed(points) / self._sizes(points))
        cost = np.stack([(missed[:, own] ** 2).sum(axis=1) for own in levels], axis=1)
        order, left = [], list(range(len(points)))
        while left:
            among = left
            for k in range(len(levels)):
                least = min(cost[i, k] for i in among)
                among = [i for i in among if cost[i, k] <= least + _EQUAL]
            best = max(among, key=lambda i: tuple(np.round(points[i, w.place], 4).tolist()))
            order.append(best)
            left.remove(best)
        return np.array(order)

    def _levels(self) -> list[np.ndarray]:
        """Masks (w,) of what is wished for, what counts first first."""
        w, angle = self.wishes, self.turns.angle[self.wishes.place]
        first = [(w.level == 0) & (w.rank == rank) for rank in distinct(w.rank[w.level == 0]).tolist()]
        return [w.level == -1, *first, (w.level == 1) & angle, (w.level == 2) & angle, (w.level == 1) & ~angle]

    def _sizes(self, points: np.ndarray) -> np.ndarray:
        """What each wish (w,) is measured by: a turn, and the largest length at points (k, n)."""
        length = np.abs(points[:, ~self.turns.angle]).max(initial=0.0) or 1.0  # all points may lie at the origin
        result: np.ndarray = np.where(self.turns.angle[self.wishes.place], TURN, length)
        return result


def _steps(residual: np.ndarray, jacobian: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """The smallest weighted steps (k, n) on which the linearized constraints vanish."""
    size = np.sqrt(np.einsum("kmn,kn->km", jacobian**2, weight))
    size = np.where(size > 0, size, 1.0)
    scaled = jacobian / size[..., None]
    normal = np.einsum("kmn,kn,kpn->kmp", scaled, weight, scaled)
    normal[:, np.arange(normal.shape[1]), np.arange(normal.shape[1])] += _DAMPED
    lost = ~(np.isfinite(normal).all(axis=(1, 2)) & np.isfinite(residual).all(axis=1))
    normal[lost] = np.eye(normal.shape[1])
    multiplier = np.linalg.solve(normal, -(residual / size)[..., None])[..., 0]
    step: np.ndarray = weight * np.einsum("kmn,km->kn", scaled, multiplier)
    step[lost] = np.nan
    return step
