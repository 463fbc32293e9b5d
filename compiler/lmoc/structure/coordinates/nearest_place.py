"""Of all places that loops can be moved to, one that is nearest to what is wished.

Newton's method on the surface on which the constraints hold: a step leads to where the squares of what is missed are
least in the tangent space, the bending of the surface included (the Hessian of the Lagrangian function there), then
back onto the surface; it is shortened until it leads nearer (Gabay, J. Optimization Theory and Applications 37, 1982).
What counts first is brought nearest first, and stays while the rest is.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from lmoc.support.records import dataclass

_STEPS, _SHORTER = 40, 12  # Newton's steps, and how often one of them is shortened
_ENDED = 1e-10  # of a radian, of a length: a step that is none
_NEARER = 1e-13  # of what is missed, squared: by less nothing is nearer
_LAST = 1e-3  # radians, lengths: by steps so short Newton's method ends; what is missed tells no more how near it is
_DEPENDENT = 1e-5  # singular values of rows of length 1 below which something can move
_FLAT = 1e-9  # of the largest curvature: along such a direction no step is taken
_STILL = 1e-6  # of the curvature of a wish by itself: along such a direction nothing wished for changes
_BESIDE = 1e-5  # radians, lengths: where the slopes are looked at for the bending


@dataclass(frozen=True, eq=False)
class Wish:
    """What counts alike: ``slope·x[place] - aim`` shall be small."""

    place: np.ndarray
    slope: np.ndarray
    aim: np.ndarray

    def missed(self, x: np.ndarray) -> np.ndarray:
        """Return the squares of what is missed (…), added up, at points (…, n)."""
        result: np.ndarray = ((self.slope * x[..., self.place] - self.aim) ** 2).sum(axis=-1)
        return result


@dataclass(frozen=True, eq=False)
class Surface:
    """The places at which constraints hold.

    Attributes
    ----------
    dense : residual (k, rows) and Jacobian (k, rows, n) at points (k, n)
    closed : the places (k, n) of the surface that Newton's method reaches from others beside it while unknowns with a
        mask (n,) stay, and whether it reaches one (k,)
    size : (n,) a radian, a length
    """

    dense: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]
    closed: Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]
    size: np.ndarray


def nearest_places(surface: Surface, x: np.ndarray, held: np.ndarray, wishes: list[Wish]) -> np.ndarray:
    """Return places (k, n) of the surface at which nothing nearby is nearer to what is wished.

    Parameters
    ----------
    x : (k, n) places of the surface
    held : (n,) mask of the unknowns that stay
    wishes : those that count first, first
    """
    held = held.copy()
    for wish in wishes:
        x = _downhill(surface, x, held, wish)
        held[wish.place] = True
    return x


def _downhill(surface: Surface, x: np.ndarray, held: np.ndarray, wish: Wish) -> np.ndarray:
    x, moving = x.copy(), np.arange(len(x))
    for _ in range(_STEPS):
        step = _steps(surface, x[moving], ~held, wish)
        longest = np.abs(step / surface.size).max(axis=1, initial=0.0)
        going = longest > _ENDED
        moving, step = moving[going], step[going] * np.minimum(1.0, 1.0 / longest[going])[:, None]
        moving = moving[_nearer(surface, x, moving, step, held, wish)]
        if not len(moving):
            break
    return x


def _nearer(
    surface: Surface, x: np.ndarray, moving: np.ndarray, step: np.ndarray, held: np.ndarray, wish: Wish
) -> np.ndarray:
    """Carry out steps of those points that are moving, shortened until they lead nearer; a mask of those that do."""
    left, missed = np.arange(len(moving)), wish.missed(x[moving])
    for k in range(_SHORTER):
        if not len(left):
            break
        others, reached = surface.closed(x[moving[left]] + step[left] / 3.0**k, held)
        last = np.abs(step[left] / surface.size).max(axis=1, initial=0.0) <= _LAST
        good = reached & (wish.missed(others) < (1.0 + np.where(last, _NEARER, -_NEARER)) * missed[left])
        x[moving[left[good]]] = others[good]
        left = left[~good]
    return ~np.isin(np.arange(len(moving)), left)


def can_move(surface: Surface, x: np.ndarray, held: np.ndarray, wishes: list[Wish]) -> bool:
    """Return whether something can move at a nearest place (n,) that leaves the wishes met as well as they are.

    Where one is at its extreme, it has no slope, but it bends: its place is determined all the same.
    """
    held = held.copy()
    for wish in wishes:
        if not _bent(surface, x[None], ~held, wish).flat.any():
            return False
        held[wish.place] = True
    none = Wish(np.zeros(0, int), np.zeros(0), np.zeros(0))
    return bool(_bent(surface, x[None], ~held, none).flat.any())


@dataclass(frozen=True, eq=False)
class _Bent:
    """The squares of what is missed along a surface, at points of it.

    Attributes
    ----------
    tangent : (k, w, free) directions, of length 1 or 0, along which the surface goes on
    along, curvature : (k, w, w) and (k, w) principal directions among these, and the curvatures along them
    slope : (k, w) along the principal directions
    flat : (k, w) mask of those along which nothing changes
    """

    tangent: np.ndarray
    along: np.ndarray
    curvature: np.ndarray
    slope: np.ndarray
    flat: np.ndarray


def _steps(surface: Surface, x: np.ndarray, free: np.ndarray, wish: Wish) -> np.ndarray:
    """The steps (k, n) in the tangent spaces to where what is missed would be least, downhill in any case."""
    steps, size = np.zeros_like(x), surface.size[free]
    if len(x) and len(size):
        bent = _bent(surface, x, free, wish)
        curvature = np.abs(bent.curvature)
        still = curvature <= _FLAT * curvature.max(axis=1, initial=0.0, keepdims=True)
        inside = np.where(still, 0.0, -bent.slope / np.where(still, 1.0, curvature))
        steps[:, free] = size * np.einsum("kvn,kvw,kw->kn", bent.tangent, bent.along, inside)
    return steps


def _bent(surface: Surface, x: np.ndarray, free: np.ndarray, wish: Wish) -> _Bent:
    size = surface.size[free]
    jacobian = surface.dense(x)[1][:, :, free] * size
    length = np.linalg.norm(jacobian, axis=2)
    length = np.where(length > 0, length, 1.0)
    left, singular, base = np.linalg.svd(jacobian / length[..., None])
    rank = (singular > _DEPENDENT).sum(axis=1)
    width = int(base.shape[2] - rank.min())
    within = np.arange(base.shape[2] - width, base.shape[2]) >= rank[:, None]
    tangent = base[:, base.shape[2] - width :] * within[..., None]
    change = np.zeros((len(wish.place), len(free)))
    change[np.arange(len(wish.place)), wish.place] = wish.slope
    change = change[:, free] * size
    gradient = (wish.slope * x[:, wish.place] - wish.aim) @ change
    inverse = np.where(singular > _DEPENDENT, 1.0 / np.where(singular > 0, singular, 1.0), 0.0)
    count = singular.shape[1]
    force = -np.einsum("kms,ks,ksn,kn->km", left[:, :, :count], inverse, base[:, :count], gradient) / length
    beside = np.zeros((len(x), width, len(free)))
    beside[..., free] = _BESIDE * tangent * size
    ahead, behind = (_slopes(surface, x[:, None] + beside * sign, force, free, size) for sign in (1.0, -1.0))
    bending = np.einsum("kwn,kvn->kwv", ahead - behind, tangent) / (2 * _BESIDE)
    across = tangent @ change.T
    hessian = across @ across.swapaxes(1, 2) + (bending + bending.swapaxes(1, 2)) / 2
    hessian[~np.isfinite(hessian).all(axis=(1, 2))] = 0.0
    curvature, along = np.linalg.eigh(hessian)
    slope = np.einsum("kvw,kvn,kn->kw", along, tangent, gradient)
    inside = np.einsum("kvw,kv->kw", along**2, within.astype(float)) > 0.5  # not one of the directions of length 0
    flat = inside & (np.abs(curvature) <= _STILL * (change**2).sum())
    return _Bent(tangent, along, curvature, slope, flat)


def _slopes(surface: Surface, x: np.ndarray, force: np.ndarray, free: np.ndarray, size: np.ndarray) -> np.ndarray:
    """The constraints' slopes (k, width, free), weighted by forces (k, rows), at points (k, width, n)."""
    jacobian = surface.dense(x.reshape(-1, x.shape[2]))[1]
    jacobian = jacobian.reshape(*x.shape[:2], *jacobian.shape[1:])[..., free] * size
    result: np.ndarray = np.einsum("km,kwmn->kwn", force, jacobian)
    return result
