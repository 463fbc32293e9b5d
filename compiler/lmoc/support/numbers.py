"""Numbers in texts that people and other programs write."""

from __future__ import annotations


def parsed_number(text: str) -> float:
    """Return the number that a text is: of the forms that Python knows, those that others know as well.

    Raises
    ------
    ValueError
        It is none, or has underscores or digits of other scripts, which `float` takes: 1_5 is 15 there.
    """
    if "_" in text or not text.isascii():
        raise ValueError(f"not a number: {text}")
    return float(text)
