"""The numbers that several folders of numerics share: what each bounds, and where it shows.

What one file alone decides by stands there, with its reason. `python tests/many_constants.py` changes each of all these
numbers by a factor of ten and tells which runs notice.
"""

# ------------------------------------------------------------------ rounding
ULP = 2.0**-52  # relative distance of neighbouring numbers
HALF_ULP = 2.0**-53  # relative rounding of one operation
LOCATED = 1e-14  # s, or this share of the time: so exactly are instants located (`tests/numerics/test_limits.py`)
INFINITE = 1e7  # m; lengths beyond stand for none
AGREE = 1e-11  # relative difference of two ways of a Runge–Kutta method, of which the second has twice as many steps

# ------------------------------------------------------------------ tolerances and steps
FINEST = 1e-14  # relative tolerance of a run; beyond, every step meets rounding
FINEST_SMOOTH = 1e-13  # the same, of methods whose tolerance is chosen for them, and where Newton's method solves steps
LEFT_BY_NEWTON = 1e-9  # of the states: what rounding may leave of the equations of a step that are stiff
PACE = 1e-8  # of what lies ahead: steps, and changes of coordinates, that come on by less on average do not get on
NO_STEP = 1e-9  # of a step: a remainder before the end that is no step of its own

# ------------------------------------------------------------------ time and memory; these change no result
LOOK = 32  # steps between two looks at the clock
NUMBERS = 2_000_000  # held at once: 16 MB
SMALL_PLAN = 10_000  # registers of a plan up to which values are kept for another run
KEPT_NAMES = 100  # variables up to which what they are read from is kept with the plan
