"""`fb export`, `deploy` and `diff`: from the files of a function-block library to a device."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import tyro

from iec61499 import model
from iec61499.commands.comparing import compare
from iec61499.commands.running import print_changes
from iec61499.deploy.build import Planner, deploy, remove, suited
from iec61499.deploy.cpp_export import built_in_type, module_files
from iec61499.deploy.device_type import TypeExport
from iec61499.deploy.difference import change, difference
from iec61499.deploy.lua_export import export_type
from iec61499.deploy.plan import Deployment, plan_deployment
from iec61499.errors import ToolError, choices
from iec61499.files.project import project_of
from iec61499.library import Library
from iec61499.management.bootfile import Command, print_boot_file
from iec61499.management.client import ManagementClient
from iec61499.mapping import device_network, management_address
from iec61499.native.export import c_files
from iec61499.net.address import parse_stream_address
from iec61499.output import printable, write_whole
from iec61499.runtime.linking.generic_ports import unconnected
from iec61499.st.c.names import c_name


@dataclass(frozen=True)
class FbExport:
    """Write a system as boot files for 4diac FORTE and `fb run`, its block types as Lua or for the build of a
    FORTE, or resources as C.

    The C of a resource is one reentrant C99 unit without allocation, which computes what the other runtimes do, to
    the bit: compile it with -ffp-contract=off and without fast-math, and link it with -lm.
    """

    folder: tyro.conf.Positional[Path]
    """Folder to write to."""
    system: Path
    """System (.sys) that the boot files build, whose types a FORTE gets, or that is written as C."""
    format: Literal["lua", "fboot", "c", "forte"] = "fboot"
    """With fboot DEVICE.fboot for every device, with lua TYPE.lua for every basic and simple block type, with c
    SYSTEM.h and SYSTEM.c, or DEVICE_RESOURCE of several resources, and fb.h, which they include; with forte a module
    of all types of the system for the folder that FORTE_EXTERNAL_MODULES_DIRECTORY names when a FORTE is built."""
    blocks: Path | None = None
    """Folder of the block types; without it the project of the system."""
    types: Literal["lua", "built-in"] = "lua"
    """Whether boot files give a FORTE the block types as Lua, or are for one that has them built in."""

    def execute(self) -> int:
        texts = self._texts(_library(self.blocks, self.system))
        try:
            for name in texts:
                (self.folder / name).parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise ToolError(f"{self.folder}: cannot be made a folder: {error.strerror}") from None
        for name, text in texts.items():
            write_whole(self.folder / name, text.encode())
            print(printable(str(self.folder / name)))
        return 0

    def _texts(self, library: Library) -> dict[str, str]:
        if self.format == "lua":
            return _lua_files(library)
        if self.format == "c":
            return c_files(library, self.system)
        if self.format == "fboot":
            return _boot_files(library, self.system, built_in_type if self.types == "built-in" else export_type)
        system = library.load_system(self.system)
        planners = [planner for of_device in _planners(library, system).values() for planner in of_device]
        types = [kind for planner in planners for kind in planner(built_in_type).types]
        return module_files(c_name(system.header.name), types)


@dataclass(frozen=True)
class FbDeploy:
    """Build a system on devices (4diac FORTE or `fb run`) in place of the resources of the same names.

    With a system (.sys) in place of the address every device of it is built, each at the address that the system
    gives it (MGR_ID), and all of them or none.
    """

    address: tyro.conf.Positional[str]
    """HOST:PORT or unix:FOLDER/PORT of the device management; or a system (.sys), all of whose devices are built."""
    system: Path | None = None
    """System (.sys) to build, if the address is that of one device."""
    device: str = ""
    """Device of the system that shall be built; needed only if the system has several."""
    blocks: Path | None = None
    """Folder of the block types; without it the project of the system."""
    online: bool = False
    """Change the resources while they run, with the fewest requests; what stays keeps its state. They must have been
    deployed before."""
    acknowledged: bool = False
    """Every event to another resource waits until the one before it is acknowledged. All devices of a system must do
    so; between 4diac FORTEs it is needed."""

    def execute(self) -> int:
        whole = self.address.endswith(".sys")
        file = Path(self.address) if whole else self.system
        if file is None:
            raise ToolError(f"--system: expected the system (.sys) that shall be built at {self.address}")
        library = _library(self.blocks, file)
        system = self.adapted(library.load_system(file, self.acknowledged))
        planners = _planners(library, system)
        print_changes(system)
        if whole:
            if self.online:
                raise ToolError("--online: expected the address of one device")
            if self.device:
                raise ToolError(f"--device {self.device}: expected an address, as {self.address} is built whole")
            _deploy_all(system, planners)
            return 0
        chosen = _chosen(planners, self.device)
        with ManagementClient(parse_stream_address(self.address)).attended() as client:
            for plan in [suited(client, planner) for planner in chosen]:
                if self.online:
                    lines = change(client, plan).lines()
                    print(printable(f"{plan.resource}: {len(lines)} changes, read back"))
                else:
                    deploy(client, plan)
                    print(printable(_done(plan)))
        return 0

    def adapted(self, system: model.System) -> model.System:
        """The system with what the options say of it; here they say nothing."""
        return system


def _deploy_all(system: model.System, planners: dict[str, list[Planner]]) -> None:
    """Builds every device; what was built before one refuses is taken away again."""
    addresses = {device.name: management_address(device) for device in system.devices}
    for name, address in addresses.items():
        if not address:
            raise ToolError(f"device {name} says no address: expected its parameter MGR_ID")
    with ExitStack() as open_clients:
        clients = {
            name: open_clients.enter_context(ManagementClient(parse_stream_address(address)).attended())
            for name, address in addresses.items()
        }
        plans = {name: [suited(client, plan) for plan in planners[name]] for name, client in clients.items()}
        built: list[tuple[ManagementClient, Deployment]] = []
        try:
            # the first device starts last, so that it finds the others listening
            for name, client in reversed(clients.items()):
                for plan in plans[name]:
                    deploy(client, plan)
                    built.append((client, plan))
                    print(printable(f"{name} at {client.address}: {_done(plan)}"), flush=True)
        except ToolError:
            for client, plan in built:
                remove(client, plan.resource)
                print(printable(f"{plan.resource} at {client.address} removed"), flush=True)
            raise


@dataclass(frozen=True)
class FbDiff:
    """Compare two files, two folders of them, or a system with what a device has.

    Prints a line for every difference: - what only the first has, + what only the second has, ~ what says something
    else; of code the lines that differ. Coordinates do not count. Of a device, - is what only the device has, and +
    what only the system has; its resources must have been built by `fb deploy`. The exit status is 1 if there is a
    difference.
    """

    system: tyro.conf.Positional[Path]
    """File or folder, or the system (.sys) that a device is held against."""
    address: tyro.conf.Positional[str]
    """File or folder that is compared with it, or HOST:PORT or unix:FOLDER/PORT of the device management."""
    device: str = ""
    """Device of the system; needed only if the system has several."""
    blocks: Path | None = None
    """Folder of the block types; without it the project of the system."""

    def execute(self) -> int:
        if Path(self.address).exists():
            differ = compare(self.system, Path(self.address))
            print(f"files that differ: {differ}")
            return int(differ > 0)
        library = _library(self.blocks, self.system)
        chosen = _chosen(_planners(library, library.load_system(self.system)), self.device)
        lines = []
        with ManagementClient(parse_stream_address(self.address)) as client:
            for planner in chosen:
                lines += difference(client, suited(client, planner)).lines()
        for line in lines:
            print(printable(line))
        print(f"differences: {len(lines)}")
        return 1 if lines else 0


def _library(blocks: Path | None, system: Path) -> Library:
    return Library([blocks or project_of(system)])


def _chosen(planners: dict[str, list[Planner]], device: str) -> list[Planner]:
    if device not in planners and (device or len(planners) != 1):
        valid = choices(planners) if planners else "a system with a device"
        raise ToolError(f"--device {device!r}: expected {valid}")
    return planners.get(device) or next(iter(planners.values()))


def _done(plan: Deployment) -> str:
    return f"{plan.resource} runs: {len(plan.types)} block types, {len(plan.commands)} requests"


def _planners(library: Library, system: model.System) -> dict[str, list[Planner]]:
    """For every device of a system what plans its resources."""

    def planner(device: model.DeviceDeclaration, resource: model.ResourceDeclaration) -> Planner:
        network = device_network(system, f"{device.name}.{resource.name}")
        return lambda export: plan_deployment(resource.name, network, library, None, export)

    return {device.name: [planner(device, resource) for resource in device.resources] for device in system.devices}


def _lua_files(library: Library) -> dict[str, str]:
    types = [library.find(name) for name in library.names()]
    return {
        f"{block.header.name}.lua": export_type(unconnected(block)).text
        for block in types
        if isinstance(block, model.BasicFBType | model.SimpleFBType)
    }


def _boot_files(library: Library, system_file: Path, export: TypeExport) -> dict[str, str]:
    files = {}
    for device, planners in _planners(library, library.load_system(system_file)).items():
        commands: list[Command] = [command for plan in planners for command in plan(export).commands]
        numbered = (
            replace(command, request=replace(command.request, id=str(number)))
            for number, command in enumerate(commands, 1)
        )
        files[f"{device}.fboot"] = print_boot_file(numbered)
    return files
