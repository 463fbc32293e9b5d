"""Random affine graphs against dense linear algebra."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from oracles.flat_builder import flat_model
from structure.test_normalize_aliases import way_back

from lmoc.messages.diagnostics import Report
from lmoc.structure.linear import affine_forest
from lmoc.structure.linear.affine_forest import FIRST_IS_CHILD, SECOND_IS_CHILD, orient
from lmoc.structure.loops.dependence import dependencies
from lmoc.structure.normalize import normalize

small = st.sampled_from([-3.0, -2.0, -1.0, -0.5, 0.5, 1.0, 1.0, 2.0, 4.0])


@st.composite
def affine_graphs(draw):
    """Exact values of x_i on a line x_i = f_i·t + b_i, and edges between them (a tree, and some that close loops)."""
    n = draw(st.integers(2, 14))
    parents = [draw(st.integers(0, i - 1)) for i in range(1, n)]
    ratios = [(draw(small), draw(st.sampled_from([0.0, 0.0, 1.0, -2.0]))) for _ in parents]
    line = [(1.0, 0.0)]
    for p, (c, b) in zip(parents, ratios, strict=True):
        line.append((c * line[p][0], c * line[p][1] + b))
    extra = draw(st.lists(st.tuples(st.integers(0, n - 1), st.integers(0, n - 1)), max_size=4))
    return line, [(i + 1, p) for i, p in enumerate(parents)] + [(a, b) for a, b in extra if a != b], draw(st.randoms())


@settings(max_examples=60)
@given(affine_graphs())
def test_random_affine_graphs(graph):
    line, edges, random = graph
    lines = [f"var x{i}" for i in range(len(line))]
    order = list(edges)
    random.shuffle(order)
    for k, (a, b) in enumerate(order):
        (fa, ba), (fb, bb) = line[a], line[b]
        c = fa / fb
        lines += [f"parameter c{k} = {c!r}", f"parameter e{k} = {ba - c * bb!r}", f"x{a} = c{k}*x{b} + e{k}"]
    flat = flat_model("\n".join([*lines, "der(x0) = sin(x0)"]))
    n = normalize(flat, flat.parameter_values(), None, Report())
    # every variable is its place on the line, whatever the root
    for i, (f, b) in enumerate(line):
        root, order_, factor, offset = way_back(n, f"x{i}")
        f0, b0 = line[int(root[1:])]
        assert order_ == 0
        np.testing.assert_allclose([factor * f0, factor * b0 + offset], [f, b], rtol=1e-9, atol=1e-9)
    # n unknowns, one left: every other equation was used or repeats others
    assert n.counts["after elimination"] == 1


@settings(max_examples=60)
@given(st.integers(1, 30), st.lists(st.tuples(st.integers(0, 29), st.integers(0, 29)), max_size=50), st.randoms())
def test_forests_of_both_kinds_span_the_same(nodes, pairs, random):
    pairs = [(a % nodes, b % nodes) for a, b in pairs if a % nodes != b % nodes]
    if not pairs:
        return
    first, second = np.array(pairs).T
    known = np.array([random.random() < 0.1 for _ in range(nodes)])
    score = np.array([random.randrange(4) for _ in range(nodes)])
    roots = []
    for grow in (affine_forest._orient_small, affine_forest._orient_large):
        way = grow(first, second, known, score)
        parent = {}
        for a, b, d in zip(first.tolist(), second.tolist(), way.tolist(), strict=True):
            if d:
                child, up = (a, b) if d == FIRST_IS_CHILD else (b, a)
                assert d in (FIRST_IS_CHILD, SECOND_IS_CHILD) and child not in parent and not known[child]
                parent[child] = up
        found = []
        for v in range(nodes):
            seen = set()
            while v in parent:
                assert v not in seen
                seen.add(v)
                v = parent[v]
            found.append(v)
        roots.append(found)
    free = [v for v in range(nodes) if not known[roots[0][v]]]
    assert [roots[0][v] for v in free] == [roots[1][v] for v in free]
    assert [known[v] for v in roots[0]] == [known[v] for v in roots[1]]
    assert (orient(first, second, known, score) != 0).sum() == len(set(range(nodes))) - len(set(roots[0]))


@settings(max_examples=80)
@given(st.integers(1, 6), st.integers(1, 8), st.integers(1, 5), st.integers(0, 2**32 - 1))
def test_dependencies_are_the_left_null_space(rank, rows, columns, seed):
    random = np.random.default_rng(seed)
    matrix = random.integers(-2, 3, (rows, rank)) @ random.integers(-2, 3, (rank, columns)).astype(float)
    vectors = [{j: x for j, x in enumerate(row) if x} for row in matrix.tolist()]
    found = dependencies(vectors)
    assert len(found) == rows - np.linalg.matrix_rank(matrix)
    for number, combination in found.items():
        assert combination[number] == 1.0
        total = sum(w * matrix[i] for i, w in combination.items())
        np.testing.assert_allclose(total, 0, atol=1e-9)
