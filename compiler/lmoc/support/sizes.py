"""The sizes from which something large is done in another way, each with the measurement that has chosen it."""

from __future__ import annotations

# Edges or entries up to which a graph algorithm in Python costs less than importing SciPy.
WITHOUT_SCIPY = 30_000

# Unknowns up to which a matrix is stored and factorized as a dense one, by LAPACK or SUNDIALS.
# One factorization and four solutions of a band of seven, LAPACK against SuperLU: 36 µs against 41 µs at 40 unknowns,
# 56 against 58 at 80, 74 against 64 at 100, 201 against 87 at 160. A run of CVODE, dense against band: 3.7 ms against
# 4.5 ms at 60 states (a chain), 6.7 against 8.5 at 98 (a lattice); against sparse: 16 ms against 98 ms at 72 (a
# network).
DENSE = 100

# Unknowns up to which generated C eliminates the rows of a dense matrix whose size the compiler knows. An evaluation of
# a chain of bars, dense against a fixed sparse pattern: 19.6 µs against 21.8 µs at 9 unknowns, 22.1 against 24.5 at 11.
DENSE_IN_C = 12

# Unknowns from which a block is treated by the graph of its equations: not torn one equation at a time, not solved
# inside casadi's functions, left open for IDA's sparse matrix. Below, equations that differ from each other run seven
# times as fast in casadi as in numpy (0.12 s against 0.78 s for 87 evaluations of 58 equations).
LARGE_BLOCK = 60

# Columns up to which a rank is found by singular values, which take 1.3 ms at 100, 18 ms at 200 and 0.12 s at 400;
# what is larger is left as it is.
RANK = 400

# Numbers up to which an array is written out, a shape for each; more become a column of numbers of one shape, without
# which a table of 10⁵ points is 10⁵ expressions.
WRITTEN_OUT = 16
