"""Compare lmoc with other tools on the same scenes at equal error (`python -m benchmarks.peers --scenes`)."""
