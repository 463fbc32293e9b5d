"""Scenes that are stepped from a loop, one or many side by side."""
