"""OMSimulator's command-line tool as a process; tests run it where the environment says where it is."""

import os
import subprocess
import zipfile
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np
import scipy.io
from lxml import etree

from dtwin.parameters import PERIOD
from dtwin.twin.dynamics import Array

OMSIMULATOR: Final = os.environ.get("OMSIMULATOR", "")
NO_OMSIMULATOR: Final = "set OMSIMULATOR to the path of OMSimulator's command-line tool, version 3, to run this"
_STANDARD: Final = "http://ssp-standard.org/SSP1/SystemStructure"
_NAMESPACES: Final = {
    "ssd": f"{_STANDARD}Description",
    "ssc": f"{_STANDARD}Common",
    "ssv": f"{_STANDARD}ParameterValues",
    "oms": "https://raw.githubusercontent.com/OpenModelica/OMSimulator/master/schema/oms.xsd",
}


@dataclass(frozen=True, slots=True)
class Component:
    """A part of a system: an FMU, or a table in CSV whose columns are its outputs.

    Attributes:
        file: the FMU or table.
        inputs: names of real inputs that are connected.
        outputs: names of real outputs that are connected.
        start: start values of real variables.
    """

    file: Path
    inputs: Sequence[str] = ()
    outputs: Sequence[str] = ()
    start: Mapping[str, float] = field(default_factory=dict)


def simulate_system(
    folder: Path, components: Mapping[str, Component], connections: Iterable[tuple[str, str, str]], ticks: int
) -> tuple[dict[str, Array], str]:
    """Simulates components that are stepped at once and exchange values after each tick.

    Args:
        folder: where files are written.
        components: the components by name.
        connections: of one component's output with another one's input of the same name: from, to, name.
        ticks: number of ticks.

    Returns:
        The values of `component.variable` at the start and after each tick, and what OMSimulator printed.
    """
    system = folder / "model.ssp"
    with zipfile.ZipFile(system, "w") as archive:
        archive.writestr("SystemStructure.ssd", _structure(components, connections))
        for component in components.values():
            archive.write(component.file, f"resources/{component.file.name}")
    return simulate(folder, system, ticks)


def simulate(folder: Path, model: Path, ticks: int) -> tuple[dict[str, Array], str]:
    """Simulates an FMU, whose variables keep their names, or a system, in a process without an environment."""
    results = folder / "results.mat"
    options = (f"--stepSize={PERIOD}", f"--stopTime={ticks_in_time(ticks)[-1]!r}", f"--resultFile={results}")
    command = [OMSIMULATOR, str(model), *options, "--suppressPath=true"]
    done = subprocess.run(command, env={}, cwd=folder, capture_output=True, text=True)
    printed = done.stdout + done.stderr
    assert done.returncode == 0, printed
    return _read(results), printed


def ticks_in_time(ticks: int) -> list[float]:
    """The times of ticks as OMSimulator adds them up, so that its tables are read where they have rows, s."""
    times: list[float] = np.add.accumulate([0.0, *[PERIOD] * ticks]).tolist()
    return times


def _structure(components: Mapping[str, Component], connections: Iterable[tuple[str, str, str]]) -> bytes:
    """SystemStructure.ssd of SSP 1.0 with OMSimulator's annotation of its master algorithm."""
    root = etree.Element(_tag("ssd:SystemStructureDescription"), nsmap=_NAMESPACES, name="model", version="1.0")
    system = _below(root, "ssd:System", name="root")
    elements = _below(system, "ssd:Elements")
    for name, component in components.items():
        kind = "x-fmu-sharedlibrary" if component.file.suffix == ".fmu" else "table"
        source = f"resources/{component.file.name}"
        element = _below(elements, "ssd:Component", name=name, type=f"application/{kind}", source=source)
        connectors = _below(element, "ssd:Connectors")
        for causality, variables in (("input", component.inputs), ("output", component.outputs)):
            for variable in variables:
                _below(_below(connectors, "ssd:Connector", name=variable, kind=causality), "ssc:Real")
        if component.start:
            binding = _below(_below(element, "ssd:ParameterBindings"), "ssd:ParameterBinding")
            values = _below(_below(binding, "ssd:ParameterValues"), "ssv:ParameterSet", version="1.0", name="start")
            parameters = _below(values, "ssv:Parameters")
            for variable, value in component.start.items():
                _below(_below(parameters, "ssv:Parameter", name=variable), "ssv:Real", value=repr(value))
    wires = _below(system, "ssd:Connections")
    for start, end, variable in connections:
        ends = {"startElement": start, "startConnector": variable, "endElement": end, "endConnector": variable}
        _below(wires, "ssd:Connection", **ends)
    annotation = _below(_below(system, "ssd:Annotations"), "ssc:Annotation", type="org.openmodelica")
    simulation = _below(_below(annotation, "oms:Annotations"), "oms:SimulationInformation")
    master = {"description": "oms-ma", "stepSize": str(PERIOD), "relativeTolerance": "1e-4"}
    _below(simulation, "oms:FixedStepMaster", **master)
    text: bytes = etree.tostring(root, xml_declaration=True, encoding="UTF-8")
    return text


def _tag(name: str) -> str:
    prefix, _, local = name.partition(":")
    return f"{{{_NAMESPACES[prefix]}}}{local}"


def _below(parent: etree._Element, name: str, /, **attributes: str) -> etree._Element:
    return etree.SubElement(parent, _tag(name), attributes)


def _read(results: Path) -> dict[str, Array]:
    """The last row of each time in a result file, which has the layout of OpenModelica's (MAT, level 4)."""
    content = scipy.io.loadmat(results, chars_as_strings=False)
    names = ["".join(letters).rstrip("\0 ") for letters in content["name"].T]
    rows = content["data_2"]
    last = np.append(np.diff(rows[0]) > 0, True)
    return {
        name.removeprefix("model.root."): rows[place - 1, last]
        for name, table, place in zip(names, *content["dataInfo"][:2], strict=True)
        if table != 1
    }
