"""Whole turns nearest to what is wished, against all combinations."""

from itertools import product

import numpy as np
import pytest

from lmoc.structure.coordinates.turns import TURN, nearest_turns


@pytest.mark.parametrize("seed", range(20))
def test_the_nearest_turns_are_found_level_by_level(seed):
    rng = np.random.default_rng(seed)
    k, f = int(rng.integers(2, 5)), int(rng.integers(3, 9))
    steps, level = rng.integers(-1, 2, (k, f)), np.sort(rng.integers(0, 2, f))
    missed = TURN * rng.uniform(-1.2, 1.2, f)
    z = nearest_turns(missed, steps, np.full(f, TURN), level)
    tried = np.array(list(product(range(-8, 9), repeat=k)))
    left = missed + TURN * (tried @ steps)
    among = np.ones(len(tried), bool)
    for own in (level == 0, level == 1):
        cost = (left[:, own] ** 2).sum(axis=1)
        among &= cost <= cost[among].min() + 1e-9
        found = ((missed + TURN * (z @ steps))[own] ** 2).sum()
        assert found < cost[among].min() + 1e-5 * (1 + cost[among].min())
