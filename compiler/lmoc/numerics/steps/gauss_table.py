"""Coefficients of Gauss collocation with four stages (order 8), computed from Legendre's polynomials.

Stages are given as differences z (4, n) from the state x at the beginning of a step, so that ``z = h·A·f``.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.polynomial import Polynomial
from numpy.polynomial.legendre import leggauss, legval

_ROOTS, _WEIGHTS = leggauss(4)
NODES, WEIGHTS = (_ROOTS + 1) / 2, _WEIGHTS / 2


def _lagrange(nodes: np.ndarray) -> list[Polynomial]:
    """The polynomials that are 1 at one node and 0 at the others."""
    return [
        Polynomial.fromroots(np.delete(nodes, k)) / np.prod(nodes[k] - np.delete(nodes, k)) for k in range(len(nodes))
    ]


def _integrated(nodes: np.ndarray) -> list[Polynomial]:
    """Their integrals from 0."""
    return [p.integ() for p in _lagrange(nodes)]


A = np.array([[p(c) for p in _integrated(NODES)] for c in NODES])
INVERSE = np.linalg.inv(A)
ENDS = WEIGHTS @ INVERSE  # x at the end less x = ENDS @ z

# the eigenvalues of A⁻¹ in the upper half plane; the others are their conjugates
_VALUES, _VECTORS = np.linalg.eig(INVERSE)
_UPPER = np.flatnonzero(_VALUES.imag > 0)
SHIFTS = _VALUES[_UPPER]
TO_STAGES = _VECTORS[:, _UPPER]
TO_MODES = np.linalg.inv(_VECTORS)[_UPPER]

# the first and the third Legendre coefficient of a function from its values at the nodes
LEGENDRE = np.array([(2 * k + 1) * WEIGHTS * legval(_ROOTS, np.eye(4)[k]) for k in (1, 3)])

# Lobatto's nodes, six of them: the ends and the zeros of P5'
LOBATTO = (np.concatenate([[-1.0], np.polynomial.legendre.Legendre.basis(5).deriv().roots().real, [1.0]]) + 1) / 2
_LOBATTO_INTEGRALS = _integrated(LOBATTO)
INTEGRALS = np.array([[p(c) for p in _LOBATTO_INTEGRALS] for c in LOBATTO])

# the Legendre coefficients 2 to 5 of a function from its values there
LOBATTO_LEGENDRE = np.linalg.inv(np.polynomial.legendre.legvander(2 * LOBATTO - 1, 5))[2:]

_STAGE_BASIS = _lagrange(np.append(0.0, NODES))[1:]  # of a polynomial that is 0 at the beginning
FROM_STAGES = np.array([[p(c) for p in _STAGE_BASIS] for c in LOBATTO])


def integrals(theta: np.ndarray) -> np.ndarray:
    """Return the integrals from 0 to theta (k,) of the polynomials of Lobatto's nodes, (k, 6)."""
    return np.stack([p(theta) for p in _LOBATTO_INTEGRALS], axis=1)


def stage_values(theta: np.ndarray) -> np.ndarray:
    """Return the matrix (k, 4) that gives the polynomial of collocation at theta (k,) from z."""
    return np.stack([p(theta) for p in _STAGE_BASIS], axis=1)


@lru_cache(maxsize=64)
def extrapolation(ratio: float) -> np.ndarray:
    """Return the matrix that continues z over the next step, `ratio` times as long."""
    return stage_values(1 + ratio * NODES) - ENDS
