"""FMUs: the models, their descriptions, sources and binaries in one file."""

from __future__ import annotations

import platform
import re
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from dtwin.controller.ports import BLOCKS, SYSTEM
from dtwin.controller.settings import ControlSettings
from dtwin.errors import NativeError
from dtwin.files import replacing
from dtwin.fmu.description import Description, build_description, model_description_2, model_description_3
from dtwin.fmu.sources import Parts, Subject, Version, parts_of, source_files
from dtwin.fmu.variables import Variable, cell_variables, controller_variables, twin_variables
from dtwin.parameters import ArmParameters
from iec61499.library import Library
from iec61499.mapping import resource_network
from iec61499.native.build import FLAGS, compiled, compilers
from iec61499.native.layout import Layout, network_layout

SUMMARIES: Final[dict[Subject, str]] = {
    "twin": "Three-link arm with a gripper: voltages in, angles out",
    "controller": "Control application of the arm, in IEC 61499 function blocks: samples in, voltages out",
    "cell": "Three-link arm with a gripper under its control application in IEC 61499 function blocks",
}
_FLAGS: Final = (*FLAGS, "-O2")
"""An FMU is compiled once and then steps for long; the options before keep its numbers the same to the bit."""
_EPOCH: Final = (1980, 1, 1, 0, 0, 0)
"""Time of every file in an FMU, so that equal models are equal files."""
_MACHINES: Final = {"x86_64": "x86_64", "amd64": "x86_64", "aarch64": "aarch64", "arm64": "aarch64"}
_SYSTEMS: Final = {"Linux": ("linux", ".so"), "Darwin": ("darwin", ".dylib")}
_PLATFORMS_2: Final = {"x86_64-linux": "linux64", "x86_64-darwin": "darwin64"}


def write_fmu(
    path: Path,
    subject: Subject,
    version: Version,
    arm: ArmParameters | None = None,
    settings: ControlSettings | None = None,
    blocks: Path = BLOCKS,
) -> None:
    """Writes an FMU for co-simulation with a binary for this machine and all sources.

    Args:
        path: the file to write.
        subject: the model.
        version: version of FMI.
        arm: the parameters that the arm starts with; those of the data sheet when None.
        settings: the values that the parameters of the controller start with; the default ones when None.
        blocks: folder of the function-block library.

    Raises:
        NativeError: there is no C compiler, or FMI has no name for this machine.
        FunctionBlockError: the function blocks cannot be used.
        RecordingError: the file cannot be written.
    """
    layout = _layout(blocks) if subject != "twin" else None
    variables = _variables(subject, arm or ArmParameters(), settings or ControlSettings(), layout)
    model = Model(subject, SUMMARIES[subject], variables, layout, parts_of(subject), subject == "twin")
    write_model(path, version, model)


@dataclass(frozen=True, slots=True, eq=False)
class Model:
    """A model that becomes an FMU.

    Attributes:
        subject: what it is.
        summary: the same in a line for people.
        variables: its variables.
        layout: the layout of its function blocks, None without any.
        parts: its sources.
        has_derivatives: whether it gives directional derivatives.
    """

    subject: Subject
    summary: str
    variables: Sequence[Variable]
    layout: Layout | None
    parts: Parts
    has_derivatives: bool = False


def write_model(path: Path, version: Version, made: Model) -> None:
    """Writes a model as an FMU for co-simulation with a binary for this machine and all sources.

    Raises:
        NativeError: there is no C compiler, or FMI has no name for this machine.
        RecordingError: the file cannot be written.
    """
    place, suffix = _platform(version)
    texts = source_files(made.subject, version, made.variables, made.layout, made.parts)
    token = re.search(r'model_token\[\] = "(.*)"', texts["variables.c"])
    assert token is not None
    subject, variables, period = made.subject, made.variables, made.parts.period
    model = Description(subject, made.summary, token[1], variables, made.has_derivatives, period)
    files: dict[str, bytes] = {f"sources/{name}": text.encode() for name, text in texts.items()}
    if version == "3.0":
        files["modelDescription.xml"] = model_description_3(model)
        files["sources/buildDescription.xml"] = build_description(model, texts)
    else:
        files["modelDescription.xml"] = model_description_2(model, texts)
    files[f"binaries/{place}/{model.identifier}{suffix}"] = _binary(texts, f"{model.identifier}{suffix}")
    with replacing(path, ".fmu") as temporary, zipfile.ZipFile(temporary, "w") as archive:
        for name in sorted(files):
            entry = zipfile.ZipInfo(name, _EPOCH)
            entry.compress_type = zipfile.ZIP_DEFLATED
            archive.writestr(entry, files[name])


def _layout(blocks: Path) -> Layout:
    library = Library([blocks])
    return network_layout(resource_network(library.load_system(blocks / SYSTEM)), library)


def _variables(
    subject: Subject, arm: ArmParameters, settings: ControlSettings, layout: Layout | None
) -> list[Variable]:
    if layout is None:
        return twin_variables(arm)
    return (
        controller_variables(settings, layout) if subject == "controller" else cell_variables(arm, settings, layout)
    )


def _binary(texts: dict[str, str], name: str) -> bytes:
    problems = []
    for compiler in compilers():
        try:
            return compiled(texts, name, compiler, _FLAGS)
        except (NativeError, OSError) as error:
            problems.append(str(error))
    raise NativeError(
        f"FMU: {'; '.join(problems) or 'there is no C compiler'}: expected a C compiler as `cc`, or the package "
        "ziglang (pip install dtwin[native])"
    )


def _platform(version: Version) -> tuple[str, str]:
    """The folder of the binary and the end of its name. Raises NativeError where FMI has no name for this machine."""
    system, suffix = _SYSTEMS.get(platform.system(), ("", ""))
    machine = _MACHINES.get(platform.machine().lower(), "")
    place = f"{machine}-{system}"
    if version == "2.0":
        place = _PLATFORMS_2.get(place, "")
    if not (system and machine and place):
        here = f"{platform.system()} on {platform.machine()}"
        raise NativeError(f"FMU: {here} has no name in FMI {version}: expected Linux or macOS on a 64-bit machine")
    return place, suffix
