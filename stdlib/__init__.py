"""The library of parts, as data."""
