"""`dtwin fb check`, `export` and `deploy`: from the files of a function-block library to a device."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import tyro

from dtwin.controller.sequence import SequenceName, with_sequence
from dtwin.errors import FunctionBlockError, ParameterError, choices
from dtwin.files import replacing
from dtwin.iec61499 import model
from dtwin.iec61499.deploy.build import deploy
from dtwin.iec61499.deploy.lua_export import export_type
from dtwin.iec61499.deploy.plan import Deployment, plan_deployment
from dtwin.iec61499.inspection import SUFFIXES, inspect
from dtwin.iec61499.library import Library
from dtwin.iec61499.management.bootfile import Command, print_boot_file
from dtwin.iec61499.management.client import ManagementClient
from dtwin.iec61499.mapping import resource_network
from dtwin.iec61499.net.address import parse_stream_address
from dtwin.iec61499.runtime.generic_ports import unconnected
from dtwin.parameters import ROOT
from dtwin.terminal import printable

BLOCKS = ROOT / "fb"
SYSTEM = BLOCKS / "dtwin.sys"


@dataclass(frozen=True)
class FbCheck:
    """Check function-block files: schema, types, connections, Structured Text.

    Prints one line for every problem, beginning with FILE:LINE:COLUMN. The exit status is 1 if there is a problem.
    """

    files: tyro.conf.Positional[tuple[Path, ...]] = (BLOCKS,)
    """Types (.fbt, .sub), systems (.sys), boot files (.fboot), or folders of them."""
    blocks: Path | None = None
    """Folder of the block types that the files use; without it the folder of each file."""

    def execute(self) -> int:
        libraries: dict[Path, Library] = {}
        problems: dict[str, None] = {}
        files = [file for path in self.files for file in _files(path)]
        for file in files:
            folder = self.blocks or file.parent
            try:
                if folder not in libraries:
                    libraries[folder] = Library([folder])
                found = inspect(file, libraries[folder])
            except FunctionBlockError as error:
                found = [error]
            problems |= dict.fromkeys(map(str, found))
        for problem in problems:
            print(printable(problem))
        print(f"files: {len(files)}, problems: {len(problems)}")
        return 1 if problems else 0


@dataclass(frozen=True)
class FbExport:
    """Write a system as boot files for 4diac FORTE and `dtwin fb run`, or its block types as Lua."""

    folder: tyro.conf.Positional[Path]
    """Folder to write to."""
    format: Literal["lua", "fboot"] = "fboot"
    """With fboot DEVICE.fboot for every device, with lua TYPE.lua for every basic and simple block type."""
    system: Path = SYSTEM
    """System (.sys) that the boot files build."""
    blocks: Path | None = None
    """Folder of the block types; without it the folder of the system."""

    def execute(self) -> int:
        library = Library([self.blocks or self.system.parent])
        texts = _lua_files(library) if self.format == "lua" else _boot_files(library, self.system)
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise ParameterError(f"{self.folder}: cannot be made a folder: {error.strerror}") from None
        for name, text in texts.items():
            with replacing(self.folder / name) as temporary:
                temporary.write_text(text)
            print(printable(str(self.folder / name)))
        return 0


@dataclass(frozen=True)
class FbDeploy:
    """Build a system on a device (4diac FORTE or `dtwin fb run`) in place of the resources of the same names."""

    address: tyro.conf.Positional[str]
    """HOST:PORT or unix:FOLDER/PORT of the device management."""
    system: Path = SYSTEM
    """System (.sys) to build."""
    device: str = ""
    """Device of the system that shall be built; needed only if the system has several."""
    blocks: Path | None = None
    """Folder of the block types; without it the folder of the system."""
    sequence: SequenceName | None = None
    """Sequence of the cell: straight in joint space, or among_bodies for a machine with contact; without it that of
    the system."""

    def execute(self) -> int:
        library = Library([self.blocks or self.system.parent])
        plans = _plans(library, with_sequence(library.load_system(self.system), self.sequence))
        if self.device not in plans and (self.device or len(plans) != 1):
            valid = choices(plans) if plans else "a system with a device"
            raise ParameterError(f"--device {self.device!r}: expected {valid}")
        with ManagementClient(parse_stream_address(self.address)) as client:
            for plan in plans.get(self.device) or next(iter(plans.values())):
                deploy(client, plan)
                requests = f"{len(plan.types)} block types, {len(plan.commands)} requests"
                print(printable(f"{plan.resource} runs: {requests}"))
        return 0


def _files(path: Path) -> list[Path]:
    return sorted(file for file in path.rglob("*") if file.suffix in SUFFIXES) if path.is_dir() else [path]


def _plans(library: Library, system: model.System) -> dict[str, list[Deployment]]:
    """For every device of a system the deployments of its resources."""
    return {
        device.name: [
            plan_deployment(resource.name, resource_network(system, f"{device.name}.{resource.name}"), library)
            for resource in device.resources
        ]
        for device in system.devices
    }


def _lua_files(library: Library) -> dict[str, str]:
    types = [library.find(name) for name in library.names()]
    return {
        f"{block.header.name}.lua": export_type(unconnected(block)).text
        for block in types
        if isinstance(block, model.BasicFBType | model.SimpleFBType)
    }


def _boot_files(library: Library, system_file: Path) -> dict[str, str]:
    files = {}
    for device, plans in _plans(library, library.load_system(system_file)).items():
        commands: list[Command] = [command for plan in plans for command in plan.commands]
        numbered = (
            replace(command, request=replace(command.request, id=str(number)))
            for number, command in enumerate(commands, 1)
        )
        files[f"{device}.fboot"] = print_boot_file(numbered)
    return files
