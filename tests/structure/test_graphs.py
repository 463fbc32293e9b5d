"""Graph algorithms of reduction on small literal graphs, with independent oracles."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import linear_sum_assignment
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components

from lmoc.expression.dag import function, slot
from lmoc.structure.blocks import blocks
from lmoc.structure.blocks.small_blocks import first_occurrence
from lmoc.structure.blocks.tearing import tear
from lmoc.structure.index import matching
from lmoc.structure.index.dulmage_mendelsohn import components, decompose, least_connected
from lmoc.structure.index.incidence import Incidence
from lmoc.structure.index.sigma import highest_value_transversal, offsets
from lmoc.structure.linear.explicit import solved


def signature(rows: list[dict[int, int]], columns: int) -> Incidence:
    entries = [(i, j, order) for i, row in enumerate(rows) for j, order in row.items()]
    return Incidence.of(len(rows), columns, *np.array(entries, np.int64).reshape(-1, 3).T)


def test_entries_are_sorted_and_the_highest_order_counts():
    i = Incidence.of(2, 3, np.array([1, 0, 1, 1]), np.array([2, 1, 0, 2]), np.array([0, 1, 2, 1]))
    assert i.row.tolist() == [0, 1, 1]
    assert i.column.tolist() == [1, 0, 2]
    assert i.order.tolist() == [1, 2, 1]
    assert i.of_columns(np.array([2])).tolist() == [2]


def test_pendulum_by_the_sigma_method():
    """Pryce's example: x'' + x λ = 0, y'' + y λ = g, x² + y² = L²; index 3, two degrees of freedom."""
    pendulum = signature([{0: 2, 2: 0}, {1: 2, 2: 0}, {0: 0, 1: 0}], 3)
    match = highest_value_transversal(pendulum)
    c, d = offsets(pendulum, match, np.zeros(3, np.int64))
    assert c.tolist() == [0, 0, 2]
    assert d.tolist() == [2, 2, 0]
    assert d.sum() - c.sum() == 2


def test_a_derivative_that_is_only_looked_at_costs_no_freedom():
    """y = f(x), x'' = y, and somebody wants y'."""
    system = signature([{0: 0, 1: 0}, {1: 2, 0: 0}], 2)
    match = highest_value_transversal(system)
    c, d = offsets(system, match, np.array([1, 0]))
    assert (c.tolist(), d.tolist()) == ([1, 0], [1, 2])
    assert d.sum() - c.sum() == 2


def test_no_transversal():
    assert highest_value_transversal(signature([{0: 0}, {0: 1}], 2)) is None
    assert highest_value_transversal(signature([{0: 0, 1: 0}], 2)) is None


@pytest.mark.parametrize("seed", range(150))
def test_transversals_and_offsets_of_random_systems(seed):
    random = np.random.default_rng(seed)
    n = int(random.integers(1, 12))
    mask, order = random.random((n, n)) < random.uniform(0.15, 0.7), random.integers(0, 4, (n, n))
    rows, columns = np.nonzero(mask)
    i = Incidence.of(n, n, rows, columns, order[rows, columns])
    pairs = linear_sum_assignment(np.where(mask, 0, 1))
    largest = n - np.where(mask, 0, 1)[pairs].sum()
    assert (matching.maximum_matching(i) >= 0).sum() == largest
    match = highest_value_transversal(i)
    if largest < n:
        assert match is None
        return
    best = linear_sum_assignment(np.where(mask, -order, 1000))
    value = order[best].sum()
    assert order[np.arange(n), match].sum() == value
    c, d = offsets(i, match, np.zeros(n, np.int64))
    assert (d[columns] - c[rows] >= order[rows, columns]).all()
    assert (c >= 0).all() and d.sum() - c.sum() == value


def test_matchings_of_large_graphs_agree(monkeypatch):
    """SciPy's matching and our own, on graphs in which nothing is forced: as many pairs, all of them edges.

    In the second graph the rows of one part share fewer columns than they are.
    """
    n = 400
    rows = np.repeat(np.arange(n), 3)
    whole = np.stack([np.arange(n), (np.arange(n) + 1) % n, (np.arange(n) * 7 + 3) % n], axis=1)
    narrow = np.where(np.arange(n)[:, None] < 100, whole % 60, whole)
    own, other = [], []
    for columns, size in ((whole, n), (narrow, n - 40)):
        graph = Incidence.of(n, n, rows, columns.ravel(), np.zeros(3 * n, np.int64))
        edges = set(zip(graph.row.tolist(), graph.column.tolist(), strict=True))
        for small, found in ((10**6, own), (0, other)):
            monkeypatch.setattr(matching, "WITHOUT_SCIPY", small)
            match = matching.maximum_matching(graph)
            used = np.flatnonzero(match >= 0)
            assert set(zip(used.tolist(), match[used].tolist(), strict=True)) <= edges
            assert len(set(match[used].tolist())) == len(used) <= size
            found.append(len(used))
    assert own == other and own[0] == n and own[1] < n


def test_over_and_under_determined_parts():
    """Rows 0 and 1 ask for column 0; row 2 is well; column 2 and 3 have one row for two."""
    i = signature([{0: 0}, {0: 0}, {1: 0}, {2: 0, 3: 0}], 4)
    parts = decompose(i, matching.maximum_matching(i))
    assert parts.over_rows.tolist() == [0, 1]
    assert parts.over_columns.tolist() == [0]
    assert parts.under_rows.tolist() == [3]
    assert parts.under_columns.tolist() == [2, 3]


def test_parts_fall_into_connected_pieces():
    i = signature([{0: 0}, {0: 0}, {1: 0}, {1: 0}], 2)
    pieces = components(i, np.arange(4), np.arange(2))
    assert [(r.tolist(), c.tolist()) for r, c in pieces] == [([0, 1], [0]), ([2, 3], [1])]


@pytest.mark.parametrize("seed", range(6))
def test_connected_pieces_of_random_graphs(seed):
    random = np.random.default_rng(seed)
    count, edges = 300, (0, 100, 200, 299, 400, 299)[seed]
    a, b = random.integers(0, count, (2, edges))
    if seed == 5:  # a path in a random order
        order = random.permutation(count)
        a, b = order[:-1], order[1:]
    label = connected_components(csr_matrix((np.ones(edges), (a, b)), (count, count)), False)[1]
    smallest = np.full(count, count)
    np.minimum.at(smallest, label, np.arange(count))
    assert least_connected(a, b, count).tolist() == smallest[label].tolist()


def test_blocks_and_levels():
    """0 and 1 read each other; 2 reads 1; 3 reads 2 and 4."""
    found = blocks.blocks_of(np.array([0, 1, 2, 3, 3]), np.array([1, 0, 1, 2, 4]), 5)
    assert found.block[0] == found.block[1]
    assert found.size[found.block].tolist() == [2, 2, 1, 1, 1]
    assert found.level[found.block].tolist() == [0, 0, 1, 2, 0]


@pytest.mark.parametrize("limit", [0, 10**6])
@pytest.mark.parametrize("seed", range(10))
def test_blocks_are_strongly_connected(seed, limit, monkeypatch):
    monkeypatch.setattr(blocks, "WITHOUT_SCIPY", limit)
    random = np.random.default_rng(seed)
    user, source = random.integers(0, 30, (2, 50))
    found = blocks.blocks_of(user, source, 30)
    count, label = connected_components(csr_matrix((np.ones(50), (user, source)), (30, 30)), connection="strong")
    assert len(found.size) == count
    assert len(set(zip(label.tolist(), found.block.tolist(), strict=True))) == count
    across = found.block[user] != found.block[source]
    assert (found.level[found.block[user]] > found.level[found.block[source]])[across].all()


def test_tearing_ends_at_the_favourite():
    """q'' follows from theta'', f from q'', tau from f; theta'' from tau closes the ring."""
    rows = [frozenset({0, 1}), frozenset({1, 2}), frozenset({2, 3}), frozenset({3, 0})]
    found = tear(rows, rows, frozenset({0}))
    assert found.torn == (0,)
    assert len(found.steps) == 3 and len(found.residuals) == 1


def test_tearing_divides_by_safe_coefficients_only():
    rows = [frozenset({0, 1}), frozenset({0, 1})]
    found = tear(rows, [frozenset(), frozenset({1})], frozenset({1}))
    assert found.torn == (0,)
    assert found.steps == ((1, 1),) and found.residuals == (0,)
    found = tear(rows, [frozenset(), frozenset()], frozenset({1}))
    assert found.torn == (1, 0)
    assert not found.steps and found.residuals == (0, 1)


def test_tearing_keeps_substitutions_shallow():
    """A ladder in which each unknown follows from the two before it: errors would grow from rung to rung."""
    n = 40
    rows = [frozenset({i, i + 1, i + 2}) for i in range(n - 2)] + [frozenset({0, 1}), frozenset({n - 2, n - 1})]
    found = tear(rows, rows, frozenset(), deepest=4)
    assert len(found.torn) >= n // 6
    assert len(found.torn) + len(found.steps) == n
    depth = dict.fromkeys(found.torn, 0)
    for e, v in found.steps:
        depth[v] = 1 + max(depth[w] for w in rows[e] if w != v)
    assert max(depth.values()) <= 4


def test_equal_numbers_are_found_in_each_row():
    table = np.array([[5, 7, 5, 7], [1, 1, 2, 1]])
    assert first_occurrence(table).tolist() == [[0, 1, 0, 1], [0, 0, 2, 0]]


def test_only_the_factor_with_the_unknown_must_vanish():
    """A massless lever at its dead centre: cos(theta)*(l1*f1 + l2*f2) = 0."""
    theta, l1, f1, l2, f2 = (slot(i) for i in range(5))
    assert solved(-(function("cos", theta) * (l1 * f1 + l2 * f2)), f2) is -(l1 * f1 / l2)
    assert solved(f2 * f2, f2) is None
    assert solved(function("sin", f2) - f1, f2) is None
