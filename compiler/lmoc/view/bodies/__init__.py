"""Free-body diagrams: each body cut out, the forces on it as arrows, and their balance."""
