"""What a simulator reads of a model: modelDescription.xml of FMI 3.0 and FMI 2.0, and buildDescription.xml."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from lxml import etree

from dtwin import __version__
from dtwin.fmu.sources import Subject
from dtwin.fmu.variables import Variable
from dtwin.parameters import PERIOD

_UNITS: Final[dict[str, dict[str, int]]] = {
    "s": {"s": 1},
    "rad": {"rad": 1},
    "rad/s": {"rad": 1, "s": -1},
    "rad/s^2": {"rad": 1, "s": -2},
    "kg": {"kg": 1},
    "m": {"m": 1},
    "kg m^2": {"kg": 1, "m": 2},
    "V": {"kg": 1, "m": 2, "s": -3, "A": -1},
    "N m": {"kg": 1, "m": 2, "s": -2},
    "N m/V": {"A": 1, "s": 1},
    "N m/A": {"kg": 1, "m": 2, "s": -2, "A": -1},
    "N/V": {"A": 1, "s": 1, "m": -1},
    "N/A": {"kg": 1, "m": 1, "s": -2, "A": -1},
    "A": {"A": 1},
    "N": {"kg": 1, "m": 1, "s": -2},
    "N s/m": {"kg": 1, "s": -1},
    "kg m": {"kg": 1, "m": 1},
    "m/s": {"m": 1, "s": -1},
    "m/s^2": {"m": 1, "s": -2},
    "N m s/rad": {"kg": 1, "m": 2, "s": -1, "rad": -1},
}
"""Exponents of the base units."""
_LOG_CATEGORIES: Final = {
    "logStatusDiscard": "A number that is out of its range, which changed nothing",
    "logStatusError": "A call that is not allowed or could not be done, which changed nothing",
}
"""The categories of messages, by the names that the standard gives them."""
_KINDS_2: Final = {"Float64": "Real", "Int32": "Integer", "Boolean": "Boolean", "String": "String"}
DURATION: Final = 10.0
"""Duration of a simulation unless another one is asked for, s."""
COMPILER_OPTIONS: Final = "-std=c99 -ffp-contract=off"


@dataclass(frozen=True, slots=True)
class Description:
    """A model as simulators see it.

    Attributes:
        subject: which model.
        summary: what it is, in a line.
        token: what tells it from others.
        variables: its variables; the value reference is the place.
        has_derivatives: whether it gives directional derivatives.
        period: time from one sample of its controller to the next, s.
    """

    subject: Subject
    summary: str
    token: str
    variables: Sequence[Variable]
    has_derivatives: bool
    period: float = PERIOD

    @property
    def identifier(self) -> str:
        """The name of its binary and, in FMI 2.0, of its functions."""
        return f"dtwin_{self.subject}"


def model_description_3(model: Description) -> bytes:
    """modelDescription.xml of FMI 3.0."""
    root = _root(model, {"fmiVersion": "3.0", "instantiationToken": model.token})
    able = ("canGetAndSetFMUState", "canSerializeFMUState", "hasEventMode")
    simulation = _simulation(model) | dict.fromkeys(able, "true")
    if model.has_derivatives:
        simulation["providesDirectionalDerivatives"] = "true"
    if model.subject != "twin":
        simulation["fixedInternalStepSize"] = repr(model.period)
    etree.SubElement(root, "CoSimulation", simulation)
    _units(root, model.variables)
    _log_categories(root)
    _experiment(root, model.period)
    references = {variable.name: str(k) for k, variable in enumerate(model.variables)}
    listed = etree.SubElement(root, "ModelVariables")
    for variable in model.variables:
        attributes = {"name": variable.name, "valueReference": references[variable.name]}
        attributes |= _attributes(variable) | _unit(variable) | _range(variable)
        if variable.derivative_of:
            attributes["derivative"] = references[variable.derivative_of]
        if isinstance(variable.start, str):
            text = etree.SubElement(listed, variable.kind, attributes)
            etree.SubElement(text, "Start", value=variable.start)
        else:
            etree.SubElement(listed, variable.kind, attributes | _start(variable))
    structure = etree.SubElement(root, "ModelStructure")
    for element, unknowns in _unknowns(model):
        for name, knowns in unknowns.items():
            etree.SubElement(structure, element, valueReference=references[name], **_dependencies(knowns, references))
    return _text(root)


def model_description_2(model: Description, sources: Iterable[str]) -> bytes:
    """modelDescription.xml of FMI 2.0, which names the source files."""
    root = _root(model, {"fmiVersion": "2.0", "guid": model.token})
    able = ("canGetAndSetFMUstate", "canSerializeFMUstate", "canNotUseMemoryManagementFunctions")
    simulation = _simulation(model) | dict.fromkeys(able, "true")
    if model.has_derivatives:
        simulation["providesDirectionalDerivative"] = "true"
    together = etree.SubElement(root, "CoSimulation", simulation)
    files = etree.SubElement(together, "SourceFiles")
    for name in _compiled(sources):
        etree.SubElement(files, "File", name=name)
    _units(root, model.variables)
    _log_categories(root)
    _experiment(root, model.period)
    # time is listed in FMI 3.0 alone; here some importers ask for its start value, which it cannot have
    numbered = [pair for pair in enumerate(model.variables) if pair[1].causality != "independent"]
    places = {variable.name: str(k) for k, (_, variable) in enumerate(numbered, 1)}
    listed = etree.SubElement(root, "ModelVariables")
    for reference, variable in numbered:
        attributes = {"name": variable.name, "valueReference": str(reference)} | _attributes(variable)
        scalar = etree.SubElement(listed, "ScalarVariable", attributes)
        value = _unit(variable) | _range(variable) | _start(variable)
        if variable.derivative_of:
            value["derivative"] = places[variable.derivative_of]
        etree.SubElement(scalar, _KINDS_2[variable.kind], value)
    structure = etree.SubElement(root, "ModelStructure")
    plural = {"Output": "Outputs", "ContinuousStateDerivative": "Derivatives", "InitialUnknown": "InitialUnknowns"}
    for element, unknowns in _unknowns(model):
        if unknowns:
            group = etree.SubElement(structure, plural[element])
            for name, knowns in unknowns.items():
                etree.SubElement(group, "Unknown", index=places[name], **_dependencies(knowns, places))
    return _text(root)


def build_description(model: Description, sources: Iterable[str]) -> bytes:
    """sources/buildDescription.xml of FMI 3.0."""
    root = etree.Element("fmiBuildDescription", fmiVersion="3.0")
    configuration = etree.SubElement(root, "BuildConfiguration", modelIdentifier=model.identifier)
    files = etree.SubElement(configuration, "SourceFileSet", language="C99", compilerOptions=COMPILER_OPTIONS)
    for name in _compiled(sources):
        etree.SubElement(files, "SourceFile", name=name)
    etree.SubElement(configuration, "Library", name="m", external="true")
    return _text(root)


def _root(model: Description, version: dict[str, str]) -> etree._Element:
    attributes = {
        **version,
        "modelName": f"dtwin {model.subject}",
        "description": model.summary,
        "version": __version__,
        "license": "Apache-2.0",
        "generationTool": f"dtwin {__version__}",
        "variableNamingConvention": "structured",
    }
    return etree.Element("fmiModelDescription", attributes)


def _simulation(model: Description) -> dict[str, str]:
    return {"modelIdentifier": model.identifier, "canHandleVariableCommunicationStepSize": "true"}


def _units(root: etree._Element, variables: Sequence[Variable]) -> None:
    used = dict.fromkeys(variable.unit for variable in variables if variable.unit)
    definitions = etree.SubElement(root, "UnitDefinitions")
    for unit in used:
        element = etree.SubElement(definitions, "Unit", name=unit)
        etree.SubElement(element, "BaseUnit", {base: str(power) for base, power in _UNITS[unit].items()})


def _log_categories(root: etree._Element) -> None:
    categories = etree.SubElement(root, "LogCategories")
    for name, text in _LOG_CATEGORIES.items():
        etree.SubElement(categories, "Category", name=name, description=text)


def _experiment(root: etree._Element, period: float) -> None:
    etree.SubElement(root, "DefaultExperiment", startTime="0.0", stopTime=repr(DURATION), stepSize=repr(period))


def _attributes(variable: Variable) -> dict[str, str]:
    attributes = {"description": variable.description} if variable.description else {}
    return attributes | {"causality": variable.causality, "variability": variable.variability} | _initial(variable)


def _initial(variable: Variable) -> dict[str, str]:
    by_causality = {"parameter": {"initial": "exact"}, "output": {"initial": "calculated"}}
    return by_causality.get(variable.causality, {})


def _unit(variable: Variable) -> dict[str, str]:
    return {"unit": variable.unit} if variable.unit else {}


def _range(variable: Variable) -> dict[str, str]:
    return {} if variable.bounds is None else {"min": str(variable.bounds[0]), "max": str(variable.bounds[1])}


def _start(variable: Variable) -> dict[str, str]:
    if variable.start is None:
        return {}
    value = variable.start
    return {"start": str(value).lower() if isinstance(value, bool) else str(value)}


def _unknowns(model: Description) -> list[tuple[str, dict[str, tuple[str, ...] | None]]]:
    """The elements of the model structure: outputs, derivatives of states, and what is computed at first.

    Each has its unknowns with the knowns that they depend on, None for all.
    """
    outputs = [variable for variable in model.variables if variable.causality == "output"]
    derivatives = [variable for variable in outputs if variable.derivative_of and model.has_derivatives]
    return [
        ("Output", {variable.name: variable.depends_on for variable in outputs}),
        ("ContinuousStateDerivative", {variable.name: variable.depends_on for variable in derivatives}),
        ("InitialUnknown", {variable.name: variable.starts_from for variable in outputs}),
    ]


def _dependencies(knowns: tuple[str, ...] | None, places: Mapping[str, str]) -> dict[str, str]:
    return {} if knowns is None else {"dependencies": " ".join(places[name] for name in knowns)}


def _compiled(sources: Iterable[str]) -> list[str]:
    return sorted(name for name in sources if name.endswith(".c"))


def _text(root: etree._Element) -> bytes:
    text: bytes = etree.tostring(root, xml_declaration=True, encoding="UTF-8", pretty_print=True)
    return text
