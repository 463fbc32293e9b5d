"""Linear algebra of Modelica's library, and its way to end with a message: against NumPy."""

import numpy as np
import pytest

import lmoc

# how much of the library the native functions need around them: their places and names
LIBRARY = """package Modelica
  package Math package Matrices package LAPACK
    function dgesv end dgesv;
    function dgesv_vec end dgesv_vec;
    function dgglse_vec end dgglse_vec;
  end LAPACK; end Matrices; end Math;
  package Utilities package Streams function error end error; end Streams; end Utilities;
end Modelica;
"""
SOLVED = """model Solved
  import Modelica.Math.Matrices.LAPACK.*;
  parameter Real A[3, 3] = [0, 2, 1; 1, 3, -1; 4, 0, 2];
  Real u = 1 + time;
  Real x[3], X[3, 2], z[3];
  Integer info, info2, info3, singular;
  Real unused[2];
equation
  (x, info) = dgesv_vec(A, {u, 2*u, 1});
  (X, info2) = dgesv(A, [u, 1; 0, u; 3, 2]);
  (z, info3) = dgglse_vec([1, 2, 0; 0, 1, 1; 2, 0, 1; 1, 1, 1], {u, 1, 2, 3}, [1, 1, 1; 0, 1, -1], {u, 1});
  (unused, singular) = dgesv_vec([1, 2; 2, 4], {u, 1});
end Solved;
"""


def test_linear_equations_and_least_squares() -> None:
    run = lmoc.compile_text(LIBRARY + SOLVED, model="Solved").simulate(stop=1, points=3)

    def last(name: str) -> list[float]:
        return [float(run[f"{name}[{k}]"][-1]) for k in (1, 2, 3)]

    a = np.array([[0, 2, 1], [1, 3, -1], [4, 0, 2.0]])
    assert last("x") == pytest.approx(np.linalg.solve(a, [2, 4, 1]), abs=1e-14)
    found = np.stack([[float(run[f"X[{i},{j}]"][-1]) for j in (1, 2)] for i in (1, 2, 3)])
    assert found == pytest.approx(np.linalg.solve(a, [[2, 1], [0, 2], [3, 2]]), abs=1e-14)
    m, b = np.array([[1, 2, 0], [0, 1, 1], [2, 0, 1], [1, 1, 1.0]]), np.array([[1, 1, 1], [0, 1, -1.0]])
    normal = np.block([[m.T @ m, b.T], [b, np.zeros((2, 2))]])
    right = np.concatenate([m.T @ [2, 1, 2, 3], [2, 1]])
    assert last("z") == pytest.approx(np.linalg.solve(normal, right)[:3], abs=1e-13)
    assert [run[name][-1] for name in ("info", "info2", "info3", "singular")] == [0, 0, 0, 2]


def test_a_function_ends_with_its_message() -> None:
    text = """function half input Real x; output Real y; algorithm
        if x < 0 then Modelica.Utilities.Streams.error("negative: " + String(x)); end if;
        y := x/2; end half;
      model M parameter Real p = 4; Real y = half(p); end M;"""
    assert lmoc.compile_text(LIBRARY + text, model="M").simulate(stop=1)["y"][-1] == 2
    with pytest.raises(lmoc.ModelError, match="negative: -3"):
        lmoc.compile_text(LIBRARY + text.replace("p = 4", "p = -3"), model="M")
    with pytest.raises(lmoc.ModelError, match="negative: -3"):
        lmoc.compile_text(LIBRARY + text, model="M").simulate(stop=1, parameters={"p": -3})
    lost = text.replace("y := x/2", "one(x); y := 1")
    lost += "function one input Real x; output Real y = x; algorithm end one;"
    with pytest.raises(lmoc.ModelError, match="E0203"):
        lmoc.compile_text(LIBRARY + lost, model="M")
