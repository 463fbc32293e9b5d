"""Bodies that fly side by side under the same gravity pull and press each other with nothing: they stay together."""

import numpy as np
import pytest

import lmoc


def fallen(seed: int, law: str, gap: float, pull: float) -> list[str]:
    """The kinds of events of two masses that meet in free fall, and stay where they have met."""
    rng = np.random.default_rng(seed)
    m, n, g, speed = rng.uniform(0.2, 3, 4).tolist()
    text = f"""model Two
  Mass a(m = {m!r}, g = {-10 * g!r}, q(start = 5, fixed = true), v(start = 0, fixed = true));
  Mass b(m = {n!r}, g = {-10 * g!r}, q(start = {5 + gap!r}, fixed = true), v(start = {pull * speed!r}, fixed = true));
  {law};
equation connect(a.flange, l.a); connect(l.b, b.flange); end Two;"""
    run = lmoc.compile_text(text).simulate(stop=1.0)
    if run.events:
        apart = (run["b.q"] - run["a.q"])[run.time > run.events[0].time]
        assert np.ptp(apart) < 1e-12
    return [e.kind for e in run.events]


@pytest.mark.parametrize("seed", range(8))
def test_what_meets_in_free_fall_stays_together(seed):
    """The quotient of a weight and its mass is that gravity up to rounding, which opens no law."""
    assert fallen(seed, "Stop l(L = 0.1, e = 0)", 0.17, -1.0) == ["contact"]
    assert fallen(seed, "Cable l(L = 0.3)", 0.2, 1.0) == ["taut"]
