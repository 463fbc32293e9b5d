"""Random values of parameters and start values, spread evenly: Latin hypercubes and Sobol sequences.

McKay, Beckman, Conover, Technometrics 21 (1979); Sobol, USSR Comput. Math. Math. Phys. 7 (1967); both by SciPy.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Mapping

import numpy as np

from lmoc.support.numbers import parsed_number
from lmoc.support.records import dataclass

METHODS = ("latin", "sobol", "random")
MOST_ROWS = 100_000_000
_INSIDE = 2.0**-54  # normal values of the ends 0 and 1 would be infinite


@dataclass(frozen=True)
class Distribution:
    """How a number is distributed.

    Attributes
    ----------
    name, numbers : what it is called, and its parameters
    quantile : from shares (n,) in (0, 1) to values (n,)
    """

    name: str
    numbers: tuple[float, ...]
    quantile: Callable[[np.ndarray], np.ndarray]

    def __repr__(self) -> str:
        return f"{self.name}({', '.join(f'{number:g}' for number in self.numbers)})"


def normal(mean: float, deviation: float) -> Distribution:
    """Return the normal distribution.

    Raises
    ------
    ValueError
        The numbers are not finite, or the deviation is not positive.
    """
    from scipy.special import ndtri

    own = _finite("normal", mean, deviation)
    if not own[1] > 0:
        raise ValueError(f"the standard deviation of a normal distribution is positive, found {deviation!r}")
    return Distribution("normal", own, lambda share: own[0] + own[1] * ndtri(share))


def lognormal(median: float, deviation: float) -> Distribution:
    """Return the distribution of positive numbers whose logarithm is normal.

    Parameters
    ----------
    deviation : of the natural logarithm: 0.1 is about 10 %
    """
    from scipy.special import ndtri

    own = _finite("lognormal", median, deviation)
    if not (own[0] > 0 and own[1] > 0):
        raise ValueError(f"median and deviation are positive, found lognormal({median!r}, {deviation!r})")
    return Distribution("lognormal", own, lambda share: own[0] * np.exp(own[1] * ndtri(share)))


def uniform(low: float, high: float) -> Distribution:
    """Return the uniform distribution between two numbers."""
    own = _finite("uniform", low, high)
    if not own[0] < own[1]:
        raise ValueError(f"the bounds of a uniform distribution increase, found uniform({low!r}, {high!r})")
    return Distribution("uniform", own, lambda share: own[0] + (own[1] - own[0]) * share)


def triangular(low: float, most_likely: float, high: float) -> Distribution:
    """Return the triangular distribution."""
    own = a, b, c = _finite("triangular", low, most_likely, high)
    if not (a <= b <= c and a < c):
        raise ValueError(f"the numbers of a triangular distribution increase, found {own}")
    below = (b - a) / (c - a)

    def quantile(share: np.ndarray) -> np.ndarray:
        rising, falling = a + np.sqrt(share * (c - a) * (b - a)), c - np.sqrt((1 - share) * (c - a) * (c - b))
        return np.where(share < below, rising, falling)

    return Distribution("triangular", own, quantile)


DISTRIBUTIONS: Mapping[str, tuple[Callable[..., Distribution], int]] = {
    "normal": (normal, 2), "lognormal": (lognormal, 2), "uniform": (uniform, 2), "triangular": (triangular, 3),
}  # fmt: skip


def parsed(text: str) -> Distribution:
    """Return the distribution that a text such as ``normal(1.6e5, 1.6e4)`` names.

    Raises
    ------
    ValueError
        There is none of that name, or its numbers do not fit.
    """
    found = re.fullmatch(r"\s*(\w+)\s*\((.*)\)\s*", text)
    if found is None or found[1] not in DISTRIBUTIONS:
        forms = "normal(mean,deviation), lognormal(median,deviation), uniform(low,high), triangular(low,mode,high)"
        raise ValueError(f"expected {forms}; found '{text}'")
    make, count = DISTRIBUTIONS[found[1]]
    words = [word.strip() for word in found[2].split(",")]
    if len(words) != count:
        raise ValueError(f"{found[1]} takes {count} numbers, found '{text}'")
    try:
        numbers = [parsed_number(word) for word in words]
    except ValueError:
        raise ValueError(f"{found[1]} takes {count} numbers, found '{text}'") from None
    return make(*numbers)


@dataclass(frozen=True, eq=False)
class Sample(Mapping):
    """Random values: a mapping {name: (n,) values}, which `DAE.ensemble` takes as `parameters` or `initial`.

    Attributes
    ----------
    distributions : {name: how it is distributed}
    seed, method : with which they were drawn; the same ones give the same values
    """

    values_of: Mapping[str, np.ndarray]
    distributions: Mapping[str, Distribution]
    seed: int
    method: str

    def __getitem__(self, name: str) -> np.ndarray:
        return self.values_of[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self.values_of)

    def __len__(self) -> int:
        return len(self.values_of)

    def only(self, names: set[str]) -> dict[str, np.ndarray]:
        """Return the values of some of the names."""
        return {name: values for name, values in self.values_of.items() if name in names}

    def __repr__(self) -> str:
        own = ", ".join(f"{name} = {how!r}" for name, how in self.distributions.items())
        count = len(next(iter(self.values_of.values())))
        return f"<Sample of {count}: {own}; {self.method}, seed {self.seed}>"


def sample(
    distributions: Mapping[str, Distribution | float] | None = None,
    /,
    *,
    n: int,
    seed: int = 0,
    method: str = "latin",
    **more: Distribution | float,
) -> Sample:
    """Draw values of several quantities together.

    >>> lmoc.sample(k1=lmoc.normal(1.6e5, 1.6e4), c1=lmoc.uniform(80, 120), n=10_000, seed=1)

    Parameters
    ----------
    distributions, more : {name: distribution, or a number that stays}; the first for names with dots
    n : how many rows
    seed : the same seed gives the same values
    method : "latin" (hypercube), "sobol" (scrambled; n is best a power of two), or "random"

    Raises
    ------
    ValueError
        Nothing to draw, a method or a number that does not fit.
    """
    given = {**(distributions or {}), **more}
    count, own = _whole("n", n, 1), _whole("seed", seed, 0)
    if not given:
        raise ValueError("a sample needs a distribution, such as k1=lmoc.normal(1.6e5, 1.6e4)")
    if count > MOST_ROWS:
        raise ValueError(f"a sample has {MOST_ROWS} rows at most, found {count}")
    drawn = {name: how for name, how in given.items() if isinstance(how, Distribution)}
    shares = _shares(len(drawn), count, own, method) if drawn else np.zeros((count, 0))
    found = {}
    for name, how in given.items():
        if isinstance(how, Distribution):
            found[name] = how.quantile(np.clip(shares[:, list(drawn).index(name)], _INSIDE, 1 - _INSIDE))
        else:
            found[name] = np.full(count, _finite(name, how)[0])
    return Sample(found, drawn, own, method)


def _shares(width: int, count: int, seed: int, method: str) -> np.ndarray:
    """Return (count, width) numbers between 0 and 1."""
    from scipy.stats import qmc

    if method == "latin":
        return qmc.LatinHypercube(width, rng=seed).random(count)
    if method == "random":
        return np.random.default_rng(seed).random((count, width))
    if method != "sobol":
        raise ValueError(f"method is one of {', '.join(METHODS)}; found {method!r}")
    whole = qmc.Sobol(width, rng=seed).random_base2(math.ceil(math.log2(count)))  # else it warns of its balance
    return whole[:count]


def _finite(what: str, *numbers: float) -> tuple[float, ...]:
    try:
        found = tuple(float(number) for number in numbers)
    except (TypeError, ValueError):
        found = (math.nan,)
    if not all(map(math.isfinite, found)):
        raise ValueError(f"{what} takes finite numbers, found {', '.join(map(repr, numbers))}")
    return found


def _whole(name: str, value: object, least: int) -> int:
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or value < least:
        raise ValueError(f"{name} is a whole number of at least {least}, found {value!r}")
    return int(value)
