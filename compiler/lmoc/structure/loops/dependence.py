"""Linear dependence among sparse vectors, with the combination that shows it."""

from __future__ import annotations

import numpy as np

# A combination vanishes when it is this small beside what it was made of.
RANK_TOLERANCE = 1e-10

Vector = dict[int, float]


def dependencies(vectors: list[Vector]) -> dict[int, Vector]:
    """A basis of the combinations that vanish, each named by a vector that only it contains, with weight 1 there.

    What depends on nothing at sight, and vectors that are parallel to another, are set aside first, again and again:
    of ten thousand pairs of parallel rods nothing is left to be eliminated.
    """
    found: dict[int, Vector] = {}
    active = list(range(len(vectors)))
    while active:
        active = _with_company(vectors, active)
        parallel = _parallel(vectors, active)
        if not parallel:
            break
        found.update(parallel)
        active = [number for number in active if number not in parallel]
    found.update(_eliminate(vectors, active))
    return found


def _with_company(vectors: list[Vector], active: list[int]) -> list[int]:
    """The vectors left when every one that has a key to itself is taken away, again and again."""
    users: dict[int, set[int]] = {}
    for number in active:
        for key in vectors[number]:
            users.setdefault(key, set()).add(number)
    alive = set(active)
    queue = [key for key, who in users.items() if len(who) == 1]
    while queue:
        for number in tuple(users[queue.pop()]):
            alive.discard(number)
            for key in vectors[number]:
                users[key].discard(number)
                if len(users[key]) == 1:
                    queue.append(key)
    return [number for number in active if number in alive]


def _parallel(vectors: list[Vector], active: list[int]) -> dict[int, Vector]:
    """Of the vectors that point the same way all but the first, as combinations with that one."""
    first: dict[tuple[tuple[int, float], ...], int] = {}
    found: dict[int, Vector] = {}
    for number in active:
        entries = sorted(vectors[number].items())
        if not entries:
            found[number] = {number: 1.0}
            continue
        head = entries[0][1]
        direction = tuple((key, round(x / head, 9)) for key, x in entries)
        other = first.setdefault(direction, number)
        if other != number:
            found[number] = {number: 1.0, other: -head / vectors[other][entries[0][0]]}
    return found


def _eliminate(vectors: list[Vector], active: list[int]) -> dict[int, Vector]:
    """For each vector that depends on those before it: the combination of all that vanishes.

    Gaussian elimination row by row, rows as dictionaries; the pivot of a row is the entry met in the fewest
    vectors among those not small (threshold pivoting, Duff, Erisman & Reid, Direct Methods for Sparse Matrices, 5).
    """
    met: dict[int, int] = {}
    for number in active:
        for key in vectors[number]:
            met[key] = met.get(key, 0) + 1
    pivots: dict[int, tuple[Vector, Vector]] = {}  # pivot -> (reduced vector with 1 at the pivot, combination)
    found: dict[int, Vector] = {}
    for number in active:
        vector, combination = dict(vectors[number]), {number: 1.0}
        scale = max((abs(x) for x in vector.values()), default=0.0)
        while (hit := next((key for key in vector if key in pivots), None)) is not None:
            weight = vector[hit]
            _subtract(vector, weight, pivots[hit][0])
            _subtract(combination, weight, pivots[hit][1])
            vector.pop(hit, None)
            scale = max(scale, abs(weight))
        vector = {key: x for key, x in vector.items() if abs(x) > RANK_TOLERANCE * scale}
        if not vector:
            found[number] = combination
            continue
        largest = max(abs(x) for x in vector.values())
        pivot = min((key for key, x in vector.items() if abs(x) >= 0.1 * largest), key=met.__getitem__)
        head = vector[pivot]
        pivots[pivot] = {k: x / head for k, x in vector.items()}, {k: x / head for k, x in combination.items()}
    return found


def _subtract(vector: Vector, weight: float, other: Vector) -> None:
    for key, x in other.items():
        vector[key] = vector.get(key, 0.0) - weight * x


def peel(row: np.ndarray, column: np.ndarray, rows: int, columns: int) -> np.ndarray:
    """The entries left when every row that has a column to itself is taken away, again and again; a mask.

    Such a row is independent of all others whatever the numbers are.
    """
    alive = np.arange(len(row))
    while len(alive):
        count = np.bincount(column[alive], minlength=columns)
        lonely = row[alive][count[column[alive]] == 1]
        if not len(lonely):
            break
        gone = np.zeros(rows, bool)
        gone[lonely] = True
        alive = alive[~gone[row[alive]]]
    mask = np.zeros(len(row), bool)
    mask[alive] = True
    return mask


def as_vectors(row: np.ndarray, column: np.ndarray, value: np.ndarray) -> dict[int, Vector]:
    """The rows of a sparse matrix as dictionaries, equal entries added up, without zeros."""
    vectors: dict[int, Vector] = {}
    for i, j, x in zip(row.tolist(), column.tolist(), value.tolist(), strict=True):
        vector = vectors.setdefault(i, {})
        vector[j] = vector.get(j, 0.0) + x
    return {i: {j: x for j, x in vector.items() if x} for i, vector in vectors.items()}
