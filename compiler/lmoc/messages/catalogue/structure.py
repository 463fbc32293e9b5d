"""Catalogue entries for the structure of a model (04xx)."""

from __future__ import annotations

from lmoc.messages.diagnostics import Entry

STRUCTURE: dict[str, Entry] = {
    "E0401": Entry(
        "too many equations",
        "More equations than unknowns: something is prescribed twice, for instance the motion of one point by two\n"
        "parts. The equations and their common unknowns are listed (the over-determined part of Dulmage and\n"
        "Mendelsohn). Remove one, or make one of the prescribed values an unknown.",
    ),
    "E0402": Entry(
        "nothing fixes a position",
        "Only differences of some positions occur in the equations, so the whole group can be anywhere. Connect\n"
        "one of its parts to a `Fixed`, or give one a mass or an inertia.",
    ),
    "E0403": Entry(
        "too few equations",
        "Fewer equations than unknowns: no equation determines the unknowns that are listed. Often a connection or a\n"
        "binding is missing.",
    ),
    "E0404": Entry(
        "constraints that cannot be solved near the start",
        "The positions of a mechanism do not follow from its coordinates at the start: it is at a dead\n"
        "centre, or one constraint is redundant. Start elsewhere, or remove the constraint.",
    ),
    "E0405": Entry(
        "equations that depend on each other",
        "There are as many equations as unknowns, but with these parameter values they are linearly dependent.\n"
        "Look for a parameter that is zero, or for two that cancel.",
    ),
    "E0406": Entry(
        "not possible as a state",
        "A variable requested as a state is prescribed, or follows from others that were requested as well.",
    ),
    "N0407": Entry(
        "coordinates were chosen",
        "Constraints leave fewer coordinates than there are positions; this note lists those that are integrated.\n"
        "`states=[…]`, `--states` or the attribute `stateSelect` choose others.",
    ),
    "E0411": Entry(
        "constraints contradict each other",
        "Rigid connections form a loop, or end at places that are fixed, and their lengths and offsets do not add up: "
        "two rods of different lengths side by side, a rod between two walls that are further apart. Every place on "
        "the loop is listed. Change one of them, or add a spring where the real system is compliant.",
    ),
    "E0412": Entry(
        "a loop that cannot move",
        "Two ways through ideal gears, drums or levers lead from one coordinate to the same other one with different "
        "ratios: only rest satisfies both. Where the ratios are meant to be equal, give them the same value.",
    ),
    "E0413": Entry(
        "a motion is prescribed twice",
        "Two given functions of time (an input, a prescribed motion, a fixed place) act on the same coordinate through "
        "rigid connections. Prescribe it once, or put a spring between them.",
    ),
    "E0414": Entry(
        "unknown state",
        "A name given as a preferred state is not a variable of the model.",
    ),
    "E0416": Entry(
        "a force that nothing balances",
        "A given force or weight acts on connections without mass that no spring, damper or support holds: the forces "
        "there cannot balance. Connect the force to a part with mass, or to something that holds it.",
        "model A\n  Force push(f = 2);\n  Rod rod;\nequation\n  connect(push.flange, rod.a);\nend A;",
    ),
    "E0420": Entry(
        "nothing determines a discrete variable",
        "A variable that changes at events only needs an equation with itself alone on one side, or a `when` that "
        "assigns it.",
    ),
    "E0422": Entry(
        "a discrete variable depends on itself",
        "With the continuous variables given, the equations between Boolean, Integer and other discrete variables must "
        "have an order in which each uses only what is known: `a = not b; b = not a;` has none. `pre(b)`, the value "
        "before the event, breaks the cycle.",
    ),
    "E0423": Entry(
        "a discrete equation that is not solved for a variable",
        "An equation between discrete variables has the variable that it determines alone on one side.",
    ),
    "N0415": Entry(
        "a constraint is redundant",
        "A loop of rigid connections gives one constraint more than there are coordinates, and they are consistent. It "
        "is dropped: the motion is the same, but the forces inside the loop are not unique. They are reported as "
        "undetermined (NaN); their combined effect on the bodies is correct.",
    ),
    "N0424": Entry(
        "a body that cannot move",
        "Parameters alone say where the body is: it is connected to a wall, or rigidly to something that is. Whatever\n"
        "acts on it, nothing happens. The message names the connection that holds it.",
        "model A\n  Fixed wall;\n  Spring spring(k = 50);\n  Mass mass(m = 2);\nequation\n"
        "  connect(wall.flange, spring.a);\n  connect(spring.b, mass.flange);\n  connect(mass.flange, wall.flange);\n"
        "end A;",
    ),
    "W0417": Entry(
        "something that cannot move",
        "Constraints hold a mass or an inertia in one place: an arm of different length beside the first, a linkage "
        "with a rod too many, a point on two straight guides that cross. It stays at rest. Two ratios between the same "
        "shafts or flanges are an error (E0412).",
    ),
    "N0418": Entry(
        "the derivative of what may jump without an event",
        "What varies decides on the value of an expression inside `noEvent(...)` or `smooth(...)` that prescribes a\n"
        "motion and is differentiated. A jump of its value is not seen there, so that the velocities do not jump with\n"
        "it. Where the value is continuous, nothing is missing: `smooth(1, …)` and beyond say so. The same of the\n"
        "second derivative of `abs`, `min` and `max` of time, where the slope jumps: `if time < 1 then 0 else\n"
        "time - 1` is what `max(0, time - 1)` is not.",
    ),
    "E0440": Entry(
        "a law without effect on its own motion",
        "A law relates a force to a gap or a velocity: the force must be able to change it. That fails where "
        "both ends\n"
        "are fixed or prescribed, or where the force enters no balance of forces.",
    ),
    "E0441": Entry(
        "friction of a contact between springs alone",
        "Where the friction of a contact and a spring are joined without a mass or a damper, the sliding velocity\n"
        "depends on the rate of the friction force, and its limit on the force of the contact. That is not supported;\n"
        "friction with a limit of its own (`DryFriction`, `Clutch`, …) may stand between springs.",
    ),
}
