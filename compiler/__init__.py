"""lmoc: from an acausal scene to the smallest system of equations, solved and trusted."""
