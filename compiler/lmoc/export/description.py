"""The model descriptions of FMI 3.0 and 2.0, and the description of how the sources are built."""

from __future__ import annotations

from fractions import Fraction
from xml.etree import ElementTree as Xml

from lmoc.export.executable import Executable
from lmoc.export.variables import Place, Type, Variable
from lmoc.expression.units import BASE, UnitError, parse_unit
from lmoc.support.version import __version__

TYPES = ("me", "cs")
_TIME = "time"
_TYPES = (("Float64", "Real"), ("Int32", "Integer"), ("Boolean", "Boolean"))  # by `Type`, in 3.0 and 2.0

_CATEGORIES = ("logEvents", "logStatusWarning", "logStatusError")


def model_description(
    own: Executable, fmi: int, types: tuple[str, ...], identifier: str, token: str, sources: list[str], tolerance: float
) -> str:
    """Return the text of ``modelDescription.xml``.

    Parameters
    ----------
    fmi : 3 or 2
    types : of `TYPES`
    sources : names of the C files, which FMI 2.0 lists here
    tolerance : relative, by default
    """
    root = Xml.Element("fmiModelDescription", {
        "fmiVersion": "3.0" if fmi == 3 else "2.0",
        "modelName": own.dae.name,
        "instantiationToken" if fmi == 3 else "guid": token,
        "generationTool": f"lmoc {__version__}",
        "variableNamingConvention": "flat",
    })  # fmt: skip
    if own.dae.flat.description:
        root.set("description", own.dae.flat.description)
    if fmi == 2:
        root.set("numberOfEventIndicators", str(sum(v.place == Place.INDICATOR for v in own.variables)))
    _kinds(root, fmi, types, identifier, sources)
    _units(root, own.variables)
    categories = Xml.SubElement(root, "LogCategories")
    for name in _CATEGORIES:
        Xml.SubElement(categories, "Category", {"name": name})
    _experiment(root, own, tolerance)
    (_variables_of_3 if fmi == 3 else _variables_of_2)(root, own)
    _structure(root, own, fmi)
    Xml.indent(root)
    return Xml.tostring(root, encoding="unicode", xml_declaration=True)


def build_description(identifier: str, sources: list[str], options: str) -> str:
    """Return the text of ``buildDescription.xml`` (FMI 3.0)."""
    root = Xml.Element("fmiBuildDescription", {"fmiVersion": "3.0"})
    configuration = Xml.SubElement(root, "BuildConfiguration", {"modelIdentifier": identifier})
    files = Xml.SubElement(configuration, "SourceFileSet", {"language": "C11", "compilerOptions": options})
    for name in sources:
        Xml.SubElement(files, "SourceFile", {"name": name})
    Xml.SubElement(files, "IncludeDirectory", {"name": "."})
    Xml.indent(root)
    return Xml.tostring(root, encoding="unicode", xml_declaration=True)


def _kinds(root: Xml.Element, fmi: int, types: tuple[str, ...], identifier: str, sources: list[str]) -> None:
    state, states = ("FMUState", "FMUState") if fmi == 3 else ("FMUstate", "FMUstate")
    common = {
        "modelIdentifier": identifier,
        f"canGetAndSet{state}": "true",
        f"canSerialize{states}": "true",
        "providesDirectionalDerivatives" if fmi == 3 else "providesDirectionalDerivative": "true",
    }
    if fmi == 3:
        common["providesAdjointDerivatives"] = "true"
    for name, element in (("me", "ModelExchange"), ("cs", "CoSimulation")):
        if name in types:
            more = {"canHandleVariableCommunicationStepSize": "true"} if name == "cs" else {}
            if name == "me" and fmi == 3:
                more = {"needsCompletedIntegratorStep": "true"}
            made = Xml.SubElement(root, element, {**common, **more})
            if fmi == 2:
                files = Xml.SubElement(made, "SourceFiles")
                for source in sources:
                    Xml.SubElement(files, "File", {"name": source})


def _units(root: Xml.Element, variables: tuple[Variable, ...]) -> None:
    units = list(dict.fromkeys(["s", *(v.unit for v in variables if v.unit)]))
    found = Xml.SubElement(root, "UnitDefinitions")
    for text in units:
        made = Xml.SubElement(found, "Unit", {"name": text})
        try:
            unit = parse_unit(text)
        except UnitError:
            continue
        if unit is None or any(isinstance(e, Fraction) for e in unit.exponents):
            continue
        base = {name: str(e) for name, e in zip(BASE, unit.exponents, strict=True) if e}
        if unit.factor != 1:
            base["factor"] = repr(unit.factor)
        if unit.offset:
            base["offset"] = repr(unit.offset)
        Xml.SubElement(made, "BaseUnit", base)


def _experiment(root: Xml.Element, own: Executable, tolerance: float) -> None:
    start, stop = float(own.run.time[0]), float(own.run.time[-1])
    if stop > start:
        times = {"startTime": repr(start), "stopTime": repr(stop), "tolerance": repr(tolerance)}
        Xml.SubElement(root, "DefaultExperiment", times)


def _start(own: Executable, v: Variable) -> float | None:
    values = {
        Place.PARAMETER: own.dae.values[own.parameters],
        Place.STATE: own.start,
        Place.INPUT: own.input_start,
    }
    given = v.place in values and v.initial != "calculated"
    return float(values[v.place][v.index]) if given else None


def _attributes(own: Executable, v: Variable) -> tuple[dict[str, str], dict[str, str]]:
    """Return what describes a variable, and what belongs to its being real."""
    what = {"causality": v.causality, "variability": v.variability}
    if v.description:
        what["description"] = v.description
    if v.initial:
        what["initial"] = v.initial
    real = {"unit": v.unit} if v.unit and v.type == Type.REAL else {}
    start = _start(own, v)
    if start is not None:
        real["start"] = repr(start)
    if v.place == Place.STATE and own.nominal[v.index] != 1:
        real["nominal"] = repr(float(own.nominal[v.index]))
    return what, real


def _reference_of_states(own: Executable) -> dict[int, int]:
    """Return {state: value reference}."""
    return {v.index: k for k, v in enumerate(own.variables, 1) if v.place == Place.STATE}


def _variables_of_3(root: Xml.Element, own: Executable) -> None:
    found, of = Xml.SubElement(root, "ModelVariables"), _reference_of_states(own)
    time = {"name": _free(own, _TIME), "valueReference": "0", "causality": "independent", "variability": "continuous"}
    Xml.SubElement(found, "Float64", {**time, "unit": "s"})
    for k, v in enumerate(own.variables, 1):
        what, real = _attributes(own, v)
        if v.state >= 0:
            real["derivative"] = str(of[v.state])
        Xml.SubElement(found, _TYPES[v.type][0], {"name": v.name, "valueReference": str(k), **what, **real})


def _variables_of_2(root: Xml.Element, own: Executable) -> None:
    found, of = Xml.SubElement(root, "ModelVariables"), _reference_of_states(own)
    for k, v in enumerate(own.variables, 1):
        if v.place == Place.INDICATOR:
            break  # 2.0 has their number alone
        what, real = _attributes(own, v)
        if v.state >= 0:
            real["derivative"] = str(of[v.state])  # an index, which is the value reference here
        made = Xml.SubElement(found, "ScalarVariable", {"name": v.name, "valueReference": str(k), **what})
        Xml.SubElement(made, _TYPES[v.type][1], real)


def _free(own: Executable, name: str) -> str:
    names = {v.name for v in own.variables}
    while name in names:
        name += "'"
    return name


def _is_initial(v: Variable) -> bool:
    """Return whether a variable that is calculated is an unknown of initialization."""
    return v.causality in ("output", "calculatedParameter") or v.state >= 0 or v.place == Place.STATE


def _structure(root: Xml.Element, own: Executable, fmi: int) -> None:
    found = Xml.SubElement(root, "ModelStructure")
    outputs = [k for k, v in enumerate(own.variables, 1) if v.causality == "output"]
    by_state = {v.state: k for k, v in enumerate(own.variables, 1) if v.state >= 0}
    derivatives = [by_state[i] for i in sorted(by_state)]
    unknown = [k for k, v in enumerate(own.variables, 1) if v.initial == "calculated" and _is_initial(v)]
    indicators = [k for k, v in enumerate(own.variables, 1) if v.place == Place.INDICATOR]
    groups = (("Outputs", "Output", outputs), ("Derivatives", "ContinuousStateDerivative", derivatives),
              ("InitialUnknowns", "InitialUnknown", unknown), ("", "EventIndicator", indicators))  # fmt: skip
    for of_2, of_3, rows in groups:
        if fmi == 3:
            for k in rows:
                Xml.SubElement(found, of_3, {"valueReference": str(k)})
        elif rows and of_2:
            group = Xml.SubElement(found, of_2)
            for k in rows:
                Xml.SubElement(group, "Unknown", {"index": str(k)})
