"""Distances in time that do not count."""


def near_to(t: float) -> float:
    """Return a distance in time that does not count: some units of the last digit."""
    return 4e-15 * max(abs(t), 1e-300)


def located(t: float, start: float) -> float:
    """Return by what the place of a root may be wrong: some units of the time's last digit, and of a sum of steps."""
    return 1e-14 * max(abs(t), abs(start)) + 1e-12 * (t - start)
