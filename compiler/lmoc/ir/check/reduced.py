"""Check a reduced system."""

from __future__ import annotations

import numpy as np

from lmoc.ir.check.findings import Findings
from lmoc.ir.check.program import check_program
from lmoc.ir.program import Role
from lmoc.ir.reduced import Reduced


def check_reduced(reduced: Reduced) -> None:
    """Check the table of registers, that the programs fill it in order, and that the guards hold.

    Raises
    ------
    CorruptStructureError
    """
    findings = Findings()
    if _registers(reduced, findings) and _jets(reduced, findings):
        _programs(reduced, findings)
    if not findings.found:
        for guard in reduced.guards:
            findings.require(guard.holds(reduced.values), "guards", f"'{guard.text}' does not hold")
    findings.close(reduced)


def _registers(reduced: Reduced, findings: Findings) -> bool:
    table, flat = reduced.registers, reduced.flat
    count = table.count
    findings.indices(table.role, 0, len(Role), "registers.role", (count,))
    findings.indices(table.variable, -1, flat.count, "registers.variable", (count,))
    findings.indices(table.order, 0, 64, "registers.order", (count,))
    findings.require(reduced.values.shape == (flat.count,), "values", "one for each variable is needed")
    return not findings.found


def _jets(reduced: Reduced, findings: Findings) -> bool:
    """Return the registers given from outside, and those integrated."""
    count, flat = reduced.registers.count, reduced.flat.count
    if findings.indices(reduced.known, 0, max(count, flat), "known", (2, None)):
        _roles(reduced, reduced.known[0], Role.KNOWN, "known", findings)
        findings.indices(reduced.known[1], 0, flat, "known, variables", (None,))
    if findings.indices(reduced.inputs, 0, max(count, flat), "inputs", (3, None)):
        _roles(reduced, reduced.inputs[0], Role.INPUT, "inputs", findings)
        findings.indices(reduced.inputs[1], 0, flat, "inputs, variables", (None,))
    findings.require(
        reduced.required_inputs.shape == reduced.inputs.shape[1:], "required_inputs", "one for each input is needed"
    )
    pairs = (
        ("states", reduced.states, reduced.derivatives, Role.STATE),
        ("quadratures", reduced.quadratures, reduced.quadrature_derivatives, Role.QUADRATURE),
    )
    for name, registers, derivatives, role in pairs:
        if findings.indices(registers, 0, count, name, (None,)):
            _roles(reduced, registers, role, name, findings)
        findings.indices(derivatives, 0, count, f"derivatives of {name}", (len(registers),))
    guess = reduced.guess
    if guess is not None:
        findings.require(len(guess.states) == len(reduced.states), "guess", "one for each state is needed")
        findings.indices(guess.unknowns, 0, count, "guess, unknowns", (len(guess.values),))
        findings.indices(guess.tied, 0, flat, "guess, tied", (len(guess.nearest),))
        for variables, _ in guess.ways:
            findings.indices(variables, 0, flat, "guess, ways", (None,))
    findings.indices(reduced.register_of, -1, count, "register_of", (flat,))
    findings.indices(reduced.undetermined, 0, flat, "undetermined", (None,))
    return not findings.found


def _roles(reduced: Reduced, registers: np.ndarray, role: Role, where: str, findings: Findings) -> None:
    """The registers are all those of the role, each once."""
    expected = np.flatnonzero(reduced.registers.role == role)
    agree = np.array_equal(np.sort(registers), expected)
    findings.require(agree, where, f"other registers than those of role {role.name}")


def _programs(reduced: Reduced, findings: Findings) -> None:
    role = reduced.registers.role
    filled = check_program(reduced.parameter_program, role == Role.KNOWN, "parameter_program", findings)
    findings.none((role == Role.DERIVED) & ~filled, "parameter_program", "a derived parameter that is not computed")
    given = filled | (role == Role.INPUT) | (role == Role.STATE)
    filled = check_program(reduced.rhs, given, "rhs", findings)
    findings.none(~filled[reduced.derivatives], "derivatives", "a derivative that the right-hand side does not compute")
    filled = check_program(reduced.observe, filled | (role == Role.QUADRATURE), "observe", findings)
    findings.none(~filled[reduced.quadrature_derivatives], "quadratures", "a derivative that is not computed")
    there = reduced.register_of >= 0
    findings.none(there & ~filled[reduced.register_of], "register_of", "a variable whose register is never filled")
    lost = np.ones(reduced.flat.count, bool)
    lost[reduced.undetermined] = False
    findings.none(~there & lost, "register_of", "a variable without register that is not undetermined")
