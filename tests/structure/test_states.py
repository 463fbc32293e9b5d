"""Which variables become states, how many, and that the programs compute their derivatives."""

from __future__ import annotations

import numpy as np
import pytest
from oracles.flat_builder import flat_model
from oracles.register_machine import Machine, flat_residuals

from lmoc.ir.program import Solve
from lmoc.messages.diagnostics import ModelError
from lmoc.structure.reduce import reduce

PENDULUM = """
    parameter m = 2
    parameter L = 0.5
    parameter g = 9.81
    var x y F
    m*der(der(x)) = -F*x
    m*der(der(y)) = -F*y - m*g
    x**2 + y**2 = L**2
    start x = 0.3
    start y = -0.4
"""

LEVER = """
    parameter J = 0.5
    parameter m1 = 1
    parameter m2 = 0.6
    parameter l1 = 0.4
    parameter l2 = 0.7
    var q1 q2 theta f1 f2
    q1 = l1*sin(theta)
    q2 = l2*sin(theta)
    m1*der(der(q1)) = f1 - m1*9.81
    m2*der(der(q2)) = f2 + m2*9.81
    J*der(der(theta)) = -cos(theta)*(l1*f1 + l2*f2)
"""


def checked(flat, states=None, seed=0, values=None):
    """The reduced system, after its programs have been put to the test."""
    reduced = reduce(flat, states=states)
    y = np.random.default_rng(seed).uniform(0.1, 0.3, len(reduced.states) + len(reduced.quadratures))
    assert np.abs(flat_residuals(reduced, y, 0.4)).max() < 1e-6
    return reduced


def test_pendulum_in_cartesian_coordinates():
    reduced = reduce(flat_model(PENDULUM))
    assert reduced.state_names == ["x", "der(x)"]  # where it starts x changes the faster: y is computed from it
    machine = Machine(reduced)
    x, v = 0.2, 0.7
    y = -np.sqrt(0.25 - x**2)
    dy = -x * v / y
    force = 2 * (v**2 + dy**2 - 9.81 * y) / 0.25
    assert machine.derivative(np.array([x, v]), 0.0) == pytest.approx([v, -force * x / 2], rel=1e-9)
    assert machine.w[reduced.register_of[reduced.flat.find("y")]] == pytest.approx(y)
    assert machine.w[reduced.register_of[reduced.flat.find("F")]] == pytest.approx(force)


def test_pendulum_hanging_down_must_not_divide_by_what_is_zero():
    reduced = reduce(flat_model(PENDULUM.replace("start x = 0.3", "start x = 0").replace("-0.4", "-0.5")))
    assert reduced.state_names == ["x", "der(x)"]
    reduced = reduce(flat_model(PENDULUM.replace("start x = 0.3", "start x = 0.5").replace("-0.4", "0")))
    assert reduced.state_names == ["y", "der(y)"]


def test_start_values_are_the_first_guess():
    reduced = reduce(flat_model(PENDULUM))
    solve = next(s for s in (*reduced.rhs, *reduced.observe) if isinstance(s, Solve) and not s.linear)
    machine = Machine(reduced)
    assert machine.w[solve.guess[0]] == pytest.approx([-0.4])


def test_lever_with_masses_turns_by_its_angle():
    reduced = checked(flat_model(LEVER))
    assert reduced.state_names == ["theta", "der(theta)"]
    assert not any(isinstance(s, Solve) for s in reduced.rhs)
    theta, omega = 0.3, 2.0
    masses = 0.4**2 + 0.6 * 0.7**2
    inertia = 0.5 + masses * np.cos(theta) ** 2
    force = masses * np.sin(theta) * np.cos(theta) * omega**2 + (0.6 * 0.7 - 0.4) * 9.81 * np.cos(theta)
    assert Machine(reduced).derivative(np.array([theta, omega]), 0.0)[1] == pytest.approx(force / inertia)


def test_the_user_chooses_other_coordinates():
    reduced = checked(flat_model(LEVER), ["q2"])
    assert reduced.state_names == ["q2", "der(q2)"]
    reduced = checked(flat_model(LEVER + "prefer q1"))
    assert reduced.state_names == ["q1", "der(q1)"]


def test_two_masses_on_a_rigid_link_between_guides():
    """x² + y² = L²: one coordinate; the first mass, declared first."""
    flat = flat_model("""
        parameter L = 1
        var x y s
        2*der(der(x)) = s*x
        3*der(der(y)) = s*y - 3*9.81
        x**2 + y**2 = L**2
        start x = 0.6
        start y = 0.8
    """)
    reduced = reduce(flat)
    assert reduced.state_names == ["x", "der(x)"]
    machine = Machine(reduced)
    x, v = 0.6, 0.5
    y, dy = 0.8, -0.6 * 0.5 / 0.8
    # eliminating s: y·(2 x'') - x·(3 y'' + 3 g) = 0 and x x'' + y y'' = -(x'² + y'²)
    a = np.linalg.solve([[2 * y, -3 * x], [x, y]], [3 * 9.81 * x, -(v**2) - dy**2])
    assert machine.derivative(np.array([x, v]), 0.0) == pytest.approx([v, a[0]], rel=1e-8)


FOUR_BARS = """
    input u
    var a b c s t
    start a = 1
    start b = 0.3
    start c = 1.2
    0.4*cos(a) + 1.2*cos(b) - 0.9*cos(c) = 1
    0.4*sin(a) + 1.2*sin(b) - 0.9*sin(c) = 0
    0.1*der(der(a)) = u + 0.4*sin(a)*s - 0.4*cos(a)*t
    0.2*der(der(b)) = 1.2*sin(b)*s - 1.2*cos(b)*t
    0.3*der(der(c)) = -0.9*sin(c)*s + 0.9*cos(c)*t
"""


def test_four_bar_linkage_turns_by_its_crank():
    """Closed by iteration for positions, by linear equations for velocities and for the two reactions."""
    reduced = reduce(flat_model(FOUR_BARS))
    assert reduced.state_names == ["a", "der(a)"]
    blocks = [(s.unknowns.shape[1], s.linear) for s in reduced.rhs if isinstance(s, Solve)]
    assert blocks == [(2, False), (2, True), (2, True)]
    assert np.abs(flat_residuals(reduced, np.array([1.0, 0.7]), 0.3)).max() < 1e-6


def test_planetary_gear_has_two_coordinates():
    flat = flat_model("""
        parameter r = 2
        input u
        var sun carrier ring t
        (1 + r)*carrier = sun + r*ring
        0.1*der(der(sun)) = t + u
        0.3*der(der(carrier)) = -(1 + r)*t
        0.2*der(der(ring)) = r*t
    """)
    reduced = checked(flat)
    assert reduced.state_names == ["sun", "der(sun)", "carrier", "der(carrier)"]
    machine = Machine(reduced)
    derivative = machine.derivative(np.array([0.1, 0.2, 0.3, 0.4]), 0.5)
    u = machine.w[reduced.inputs[0, 0]]
    a = np.linalg.solve([[0.1, 0, 0, -1], [0, 0.3, 0, 3], [0, 0, 0.2, -2], [-1, 3, -2, 0]], [u, 0, 0, 0])
    assert derivative[[1, 3]] == pytest.approx(a[:2])


def test_coordinate_relative_to_a_moving_frame_is_preferred():
    text = """
        var x1 x2 q
        x2 = x1 + q
        1*der(der(x1)) = -x1 + q
        2*der(der(x2)) = -q
    """
    assert checked(flat_model(text)).state_names == ["x1", "der(x1)", "x2", "der(x2)"]
    assert checked(flat_model(text + "prefer q")).state_names == ["x1", "der(x1)", "q", "der(q)"]
    text = text.replace("= -q", "= -q - der(q)")
    assert checked(flat_model(text), ["q", "x2"]).state_names == ["x2", "der(x2)", "q", "der(q)"]


def test_avoided_variables_are_computed():
    text = """
        var a b c F
        a + b = 2*c
        der(der(a)) = -a + F
        der(der(b)) = -b + F
        der(der(c)) = -2*F
    """
    assert checked(flat_model(text)).state_names == ["a", "der(a)", "b", "der(b)"]
    assert checked(flat_model(text + "\navoid a")).state_names == ["b", "der(b)", "c", "der(c)"]


def test_massless_junction_between_springs_is_no_state():
    """Three springs meet in a massless point: a linear equation for its position, solved as a formula."""
    flat = flat_model("""
        parameter k = 3
        var x y z p
        der(der(x)) = k*(p - x)
        der(der(y)) = 2*k*(p - y)
        der(der(z)) = -k*z + 3*k*(p - z)
        k*(p - x) + 2*k*(p - y) + 3*k*(p - z) = 0
    """)
    reduced = checked(flat)
    assert len(reduced.states) == 6
    assert not any(isinstance(s, Solve) for s in reduced.rhs)


def test_dampers_in_series_leave_their_junction_to_a_quadrature():
    flat = flat_model("""
        input f
        var x p
        2*der(der(x)) = f - 2*(der(x) - der(p))
        3*der(p) = 2*(der(x) - der(p))
    """)
    reduced = checked(flat)
    assert reduced.state_names == ["x", "der(x)"]
    assert [reduced.register_name(int(q)) for q in reduced.quadratures] == ["p"]


def test_a_state_that_only_its_own_derivative_reads_stays():
    reduced = checked(flat_model("input u\nvar a b\nder(a) = u*b\nder(b) = u - b**3"))
    assert reduced.state_names == ["b"]
    assert [reduced.register_name(int(q)) for q in reduced.quadratures] == ["a"]


def test_algebraic_loop_with_a_curved_law():
    """x' = y with y³ + y = u - x: a scalar equation for Newton's method."""
    reduced = checked(flat_model("input u\nvar x y\nder(x) = y\ny**3 + y = u - x"))
    assert reduced.state_names == ["x"]
    machine = Machine(reduced)
    (derivative,) = machine.derivative(np.array([0.5]), 0.2)
    u = machine.w[reduced.inputs[0, 0]]
    assert derivative**3 + derivative == pytest.approx(u - 0.5)


def test_a_prescribed_motion_needs_the_derivatives_of_its_signal():
    reduced = reduce(flat_model("input u\nvar q f a b\nq = u + sin(u)*b\nb = 1\na = der(der(q))\nf = 3*a"))
    assert not len(reduced.states)
    assert reduced.inputs[2].max() == 2
    assert not reduced.required_inputs.any()  # nothing is integrated: only what is looked at needs them
    machine = Machine(reduced)
    w = machine.variables(np.zeros(0), 0.7)
    u, du, ddu = (machine.w[reduced.inputs[0, k]] for k in range(3))
    assert w[reduced.flat.find("f")] == pytest.approx(3 * (ddu + np.cos(u) * ddu - np.sin(u) * du**2))


@pytest.mark.parametrize("seed", range(12))
def test_trees_of_links_have_one_coordinate_a_joint(seed):
    """x = Σ l sin φ, y = Σ l cos φ with masses at the ends: whatever the masses, the angles are the states."""
    random = np.random.default_rng(seed)
    n = int(random.integers(1, 4))
    length, mass = random.uniform(0.5, 1, n), random.uniform(0.5, 2, n)
    lines = []
    for i in range(n):
        lines.append(f"var p{i} x{i} y{i} X{i} Y{i}")
        lines.append(f"start p{i} = {random.uniform(0.2, 1.2)}")
    for i in range(n):
        x, y = (f"x{i - 1} + ", f"y{i - 1} + ") if i else ("", "")
        fx, fy = (f" - X{i + 1}", f" - Y{i + 1}") if i + 1 < n else ("", "")
        lines.append(f"x{i} = {x}{length[i]}*sin(p{i})")
        lines.append(f"y{i} = {y}-{length[i]}*cos(p{i})")
        lines.append(f"{mass[i]}*der(der(x{i})) = X{i}{fx}")
        lines.append(f"{mass[i]}*der(der(y{i})) = Y{i}{fy} - {9.81 * mass[i]}")
        lines.append(f"X{i}*cos(p{i}) + Y{i}*sin(p{i}) = 0")
    reduced = reduce(flat_model("\n".join(lines)))
    assert reduced.state_names == [name for i in range(n) for name in (f"p{i}", f"der(p{i})")]
    y = random.uniform(0.2, 0.6, 2 * n)
    assert np.abs(flat_residuals(reduced, y, 0.0)).max() < 1e-5


@pytest.mark.parametrize(
    "text", ["parameter a = 1", "var x\nx = 1", "input u\nvar x\nx = u", "parameter a\ninput u\nvar x\nx = sin(u) + a"]
)
def test_nothing_to_integrate(text):
    reduced = reduce(flat_model(text))
    assert not len(reduced.states) and not reduced.rhs
    assert (reduced.register_of >= 0).all()


def test_parameters_without_values_are_taken_for_generic_numbers():
    reduced = reduce(flat_model("parameter m\nparameter k\nvar x\nm*der(der(x)) = -k*x**3"))
    assert reduced.state_names == ["x", "der(x)"]


def test_states_that_cannot_be():
    with pytest.raises(ModelError) as caught:
        reduce(flat_model(LEVER), states=["f1"])
    (error,) = caught.value.diagnostics
    assert error.code == "E0406"
    assert "'f1' cannot be a state" in error.message
    with pytest.raises(ModelError) as caught:
        reduce(flat_model(LEVER), states=["theta", "q1"])
    assert "'q1' cannot be a state: it follows from the others through 'q1 = l1*sin(theta)'" in str(caught.value)


def test_a_spring_between_two_dampers_is_one_state():
    """Two masses, four states, and the stretch of the spring; where its ends are is a quadrature."""
    flat = flat_model("""
        parameter k = 3
        var x y a b f
        2*der(der(x)) = f
        3*der(der(y)) = -f
        f = k*(b - a)
        f = 0.5*(der(a) - der(x))
        f = 0.7*(der(y) - der(b))
    """)
    reduced = checked(flat)
    assert reduced.state_names == ["x", "der(x)", "y", "der(y)", "f"]
    assert len(reduced.quadratures) == 1


MOTOR = """
    parameter J = 0.1
    parameter k = 2
    parameter L = 3
    var theta omega alpha tau i
    der(theta) = omega
    der(omega) = alpha
    J*alpha = tau
    tau = k*i
    L*der(i) + 4*i + k*omega = 1
"""


def test_what_has_its_own_derivative_is_a_state_before_an_acceleration():
    """The current of a motor, not the acceleration that is proportional to it."""
    assert set(checked(flat_model(MOTOR)).state_names) == {"theta", "omega", "i"}


@pytest.mark.parametrize("asked", ["i", "tau"])
def test_the_one_asked_for_of_several_proportional_ones(asked):
    states = ["theta", "omega", asked]
    assert set(checked(flat_model(MOTOR), states=states).state_names) == set(states)


def test_an_acceleration_asked_for_is_refused():
    with pytest.raises(ModelError, match="'alpha' cannot be a state"):
        reduce(flat_model(MOTOR), states=["theta", "omega", "alpha"])


def test_a_force_with_its_own_derivative():
    """A spring and a damper in series on a mass, written by the force."""
    flat = flat_model("""
        parameter m = 2
        var x v F
        der(x) = v
        m*der(v) = F
        der(F) = -5*v - 7*F
    """)
    assert set(checked(flat).state_names) - {"x"} == {"v", "F"}
