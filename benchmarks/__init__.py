"""Measurements: each prints ratios from one run and saves them with the machine's description."""
