"""The engine's shared library, built where the package was installed (``compiler/building/lmoc_build.py``)."""

from __future__ import annotations

import ctypes
from functools import lru_cache
from importlib import import_module

_POINTER, _COUNT, _INT, _REAL = ctypes.c_void_p, ctypes.c_int64, ctypes.c_int, ctypes.c_double
# Functions with their results and arguments, in the order of the headers in `c/`.
_FUNCTIONS = {
    "lmoc_lu_new": (_POINTER, [_COUNT, _POINTER, _POINTER]),
    "lmoc_lu_free": (None, [_POINTER]),
    "lmoc_lu_forget": (None, [_POINTER]),
    "lmoc_lu_choose": (_INT, [_POINTER, _POINTER]),
    "lmoc_lu_refactor": (_INT, [_POINTER, _POINTER, _POINTER]),
    "lmoc_lu_factor": (_INT, [_POINTER, _POINTER, _POINTER]),
    "lmoc_lu_solve": (None, [_POINTER, _POINTER]),
    "lmoc_operations": (ctypes.c_char_p, []),
    "lmoc_tape_run": (_INT, [_REAL, _POINTER, _POINTER]),
    "lmoc_evaluate": (_INT, [_POINTER, _REAL, _POINTER]),
    "lmoc_evaluate_near": (_INT, [_POINTER, _REAL, _POINTER]),
    "lmoc_mark": (None, [_POINTER]),
    "lmoc_go_back": (None, [_POINTER]),
    "lmoc_evaluate_many": (None, [_POINTER, _COUNT, *[_POINTER] * 3, _COUNT, *[_POINTER] * 3]),
    "lmoc_rhs": (_INT, [_REAL, *[_POINTER] * 3]),
    "lmoc_residual": (_INT, [_REAL, *[_POINTER] * 4]),
    "lmoc_radau_place": (_COUNT, [_POINTER] * 2),
    "lmoc_radau_jump": (None, [_POINTER]),
    "lmoc_radau_step": (_INT, [_POINTER]),
    "lmoc_dop853_attempt": (None, [_POINTER, _REAL, _REAL, _REAL, *[_POINTER] * 8]),
    "lmoc_dop853_more": (None, [_POINTER, _REAL, _REAL, *[_POINTER] * 5]),
    "lmoc_dop853_walk": (_INT, [_POINTER]),
    "lmoc_dop853_restart": (None, [_POINTER]),
    "lmoc_dop853_abreast": (_COUNT, [_POINTER]),
    "lmoc_dop853_pass": (None, [_POINTER] * 2),
    "lmoc_taylor_pass": (None, [_POINTER] * 3),
    "lmoc_look": (_INT, [_POINTER, _REAL, _POINTER, _INT]),
    "lmoc_land_many": (_INT, [_POINTER, _COUNT, _POINTER, _POINTER]),
    "lmoc_keep": (None, [_POINTER]),
    "lmoc_equilibrate": (None, [_POINTER, *[_COUNT] * 3, *[_POINTER] * 3, _INT, *[_POINTER] * 4]),
    "lmoc_rows_of_one_size": (None, [*[_COUNT] * 3, *[_POINTER] * 4]),
    "lmoc_states_by_pivots": (_INT, [_POINTER, *[_COUNT] * 2, *[_POINTER] * 2]),
    "lmoc_coordinates_lay_out": (_COUNT, [_POINTER] * 2),
    "lmoc_coordinates_begin": (_INT, [_POINTER, _REAL, _POINTER]),
    "lmoc_coordinates_judge": (_INT, [_POINTER, _REAL, _POINTER]),
    "lmoc_coordinates_margin": (_REAL, [_POINTER, _COUNT]),
    "lmoc_coordinates_vanish": (_INT, [_POINTER, _COUNT]),
    "lmoc_coordinates_passed": (_INT, [_POINTER]),
    "lmoc_coordinates_tolerate": (None, [_POINTER]),
    "lmoc_coordinates_shorter": (_REAL, [_POINTER, _COUNT, _REAL, _POINTER]),
    "lmoc_coordinates_better": (_INT, [_POINTER] * 2),
    "lmoc_coordinates_stuck": (_INT, [_POINTER, _REAL]),
    "lmoc_coordinates_lost": (_COUNT, [_POINTER]),
    "lmoc_passage_lay_out": (_COUNT, [_POINTER] * 2),
    "lmoc_passage_find": (_INT, [_POINTER, _REAL, _POINTER]),
    "lmoc_passage_beside": (_INT, [*[_REAL] * 3, *[_POINTER] * 2]),
    "lmoc_lagrange": (None, [_COUNT, _POINTER, _REAL, _POINTER]),
    "lmoc_recurrences": (ctypes.c_char_p, []),
    "lmoc_taylor_series": (_INT, [_POINTER, _REAL, _POINTER, _POINTER]),
    "lmoc_taylor_walk": (_INT, [_POINTER, _POINTER]),
    "lmoc_first_trial": (_REAL, [_COUNT, *[_REAL] * 4, *[_POINTER] * 3]),
    "lmoc_first_step": (_REAL, [_COUNT, *[_REAL] * 3, *[_POINTER] * 4]),
    "lmoc_lanes_walk": (None, [_POINTER, _COUNT, _POINTER]),
    "lmoc_at_once": (_POINTER, []),
    "lmoc_lanes_differences": (None, [_POINTER, _COUNT, *[_POINTER] * 3]),
    "lmoc_roots": (_COUNT, [_POINTER]),
    "lmoc_relations": (None, [_POINTER]),
    "lmoc_root_sides": (None, [_POINTER, _POINTER]),
    "lmoc_follow": (None, [_POINTER, _COUNT, _POINTER, _POINTER]),
    "lmoc_rounding": (_INT, [_POINTER, _REAL, _POINTER]),
    "lmoc_quiet": (_INT, [_POINTER, _REAL, *[_POINTER] * 3]),
    "lmoc_take": (_INT, [_POINTER, _REAL, _POINTER]),
    "lmoc_remember": (None, [_POINTER]),
    "lmoc_assign": (None, [_POINTER]),
    "lmoc_turn": (_COUNT, [_POINTER, _POINTER]),
    "lmoc_solve_instant": (_INT, [_POINTER, _POINTER]),
    "lmoc_step_states": (None, [_POINTER, _REAL, _POINTER]),
    "lmoc_events_start": (_INT, [_POINTER, _REAL, _POINTER, _INT]),
    "lmoc_events_after": (_INT, [_POINTER, _REAL, _POINTER, _INT]),
    "lmoc_events_settle": (_INT, [_POINTER, _REAL, _POINTER]),
    "lmoc_next_time": (_REAL, [_POINTER, _REAL, _INT]),
    "lmoc_zeros_read": (_COUNT, [_POINTER] * 3),
    "lmoc_try": (_INT, [*[_POINTER] * 3, _COUNT, _POINTER, _COUNT, _COUNT, _POINTER]),
    "lmoc_taylor_values": (None, [_COUNT, _COUNT, _COUNT, *[_POINTER] * 3]),
    "lmoc_steps_between": (_INT, [_COUNT, *[_POINTER] * 3]),
    "lmoc_jump_states": (_INT, [_POINTER] * 5),
    "lmoc_jump_work": (_INT, [_POINTER] * 4),
    "lmoc_jump_reason": (ctypes.c_char_p, [_INT]),
    "lmoc_roots_of_step": (None, [_POINTER, _REAL, _REAL]),
    "lmoc_next_root": (_INT, [_POINTER, _POINTER]),
    "lmoc_roots_free": (None, [_POINTER]),
    "lmoc_locate": (_INT, [_POINTER, _POINTER, *[_REAL] * 4, _COUNT, *[_POINTER] * 3]),
    "lmoc_lowest_about": (_INT, [_POINTER, _POINTER, _COUNT, *[_POINTER] * 3]),
    "lmoc_complementarity": (_INT, [_COUNT, *[_POINTER] * 8]),
    "lmoc_with_cones": (_INT, [_COUNT, *[_POINTER] * 8]),
    "lmoc_collide": (_INT, [_COUNT, *[_POINTER] * 10]),
    "lmoc_settle": (_INT, [_POINTER] * 8),
    "lmoc_free_at": (_INT, [_POINTER, _REAL, *[_POINTER] * 3]),
    "lmoc_mode_input": (_REAL, [_POINTER, *[_COUNT] * 2]),
    "lmoc_law_place": (_COUNT, [_POINTER] * 2),
    "lmoc_law_open": (None, [_POINTER]),
    "lmoc_law_renew": (_INT, [_POINTER]),
    "lmoc_law_values": (_COUNT, [_POINTER, _COUNT, *[_POINTER] * 2]),
    "lmoc_law_watch": (None, [_POINTER] * 2),
    "lmoc_law_start": (_INT, [_POINTER, _REAL, _POINTER]),
    "lmoc_law_happen": (_INT, [_POINTER, _REAL, *[_POINTER] * 2, _INT]),
    "lmoc_law_go_on": (_INT, [_POINTER, _REAL, _POINTER, _INT]),
    "lmoc_law_settle": (_INT, [*[_POINTER] * 2, _REAL, *[_POINTER] * 2]),
    "lmoc_law_look": (_INT, [_POINTER, _REAL, _POINTER]),
    "lmoc_law_parts": (_INT, [_POINTER, _REAL, *[_POINTER] * 2]),
    "lmoc_law_strike": (_INT, [_POINTER, _REAL, *[_POINTER] * 2]),
    "lmoc_law_keep": (_INT, [_POINTER, _REAL, _REAL, _POINTER]),
    "lmoc_law_drifts": (_INT, [_POINTER]),
    "lmoc_segments_go": (_COUNT, [_POINTER]),
    "lmoc_held_velocities": (_INT, [_COUNT, _COUNT, *[_POINTER] * 2]),
}


class Many(ctypes.Structure):
    """What goes through the engine several runs at a time (``lmoc_many`` in ``c/many.h``)."""

    _fields_ = [
        *[(name, ctypes.c_int64) for name in ("lanes", "length")],
        *[(name, ctypes.c_void_p) for name in ("run", "blocks", "order", "open", "solve")],
        ("walk", ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_int64, ctypes.c_void_p)),
    ]


@lru_cache(maxsize=1)
def library() -> ctypes.CDLL:
    """Return the engine with the types of its functions.

    Raises
    ------
    ImportError
        The package has not been installed, so that its engine has not been built, or not from these sources.
    """
    built = import_module("lmoc.engine._engine")
    loaded = ctypes.CDLL(built.__file__)
    for name, (result, arguments) in _FUNCTIONS.items():
        try:
            function = getattr(loaded, name)
        except AttributeError:  # its structures are others, too
            text = f"lmoc's engine has no {name}: it was built from other sources, install lmoc again"
            raise ImportError(text) from None
        function.restype, function.argtypes = result, arguments
    return loaded


def address(name: str) -> int:
    """Return where a function of the engine, or a table of functions, stands."""
    return ctypes.addressof(ctypes.c_char.in_dll(library(), name))


@lru_cache(maxsize=1)
def at_once() -> Many:
    """Return what takes as many runs at a time as suit this processor; the bits are the same for any number."""
    return Many.from_address(library().lmoc_at_once())
