"""`dtwin doctor`: what of this machine dtwin can use, what is missing, and how to get it."""

from __future__ import annotations

import importlib.metadata
import os
import platform
import shutil
import socket
import sys
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Final, Literal

from packaging.requirements import Requirement
from rich.table import Table

from dtwin import __version__
from dtwin.bus.opening import RENDEZVOUS
from dtwin.commands.frame import JsonOption
from dtwin.errors import DtwinError
from dtwin.services.launch import MANAGEMENT
from dtwin.services.runfile import folder
from dtwin.terminal import as_text, print_json, print_table
from iec61499.native.build import compilers

State = Literal["present", "missing", "needed", "free", "taken"]
"""needed: missing, and dtwin does not work without it; free and taken are said of ports."""
_EXTRAS: Final = {
    "console": "the operators' page",
    "dask": "campaigns on a cluster",
    "docs": "the documentation as a site",
    "film": "films as MP4",
    "frames": "data frames of a run",
    "line": "questions in SQL about runs of lines",
    "sbom": "bills of materials",
    "test": "the tests",
}


@dataclass(frozen=True)
class Part:
    """Something that dtwin uses.

    Attributes:
        name: What it is.
        state: Whether it is there, or may be used.
        found: What was found, a version or a path.
        advice: What it is for and how to get it, where it is missing.
    """

    name: str
    state: State
    found: str = ""
    advice: str = ""


@dataclass(frozen=True)
class Doctor(JsonOption):
    """Tell what of this machine dtwin can use, what is missing and how to get it.

    The exit status is 1 when something is missing that dtwin does not work without.
    """

    def execute(self) -> int:
        parts = list(examine())
        if self.json:
            print_json([asdict(part) for part in parts])
        else:
            table = Table("part", "state", "found", "how to get it")
            for part in parts:
                table.add_row(part.name, part.state, as_text(part.found), as_text(part.advice))
            print_table(table)
        return 1 if any(part.state == "needed" for part in parts) else 0


def examine() -> Iterator[Part]:
    """All parts, in the order in which a user meets them."""
    yield Part("dtwin", "present", __version__)
    yield Part("Python", "present", f"{platform.python_version()} ({sys.executable})")
    yield from _libraries()
    yield from _extras()
    yield _viewer()
    yield _display()
    yield _program("browser", "chromium", "CHROMIUM", "for the tests of the page: apt install chromium")
    yield _program("4diac FORTE", "forte", "FORTE", "for the tests against it: build it, set FORTE to its path")
    yield _compiler()
    yield _run_folder()
    yield examine_port("meeting point of services", int(RENDEZVOUS.rpartition(":")[2]))
    yield examine_port("device management", MANAGEMENT)
    yield _priority()


def _libraries() -> Iterator[Part]:
    for requirement in _requirements():
        if requirement.marker is None:
            # What is developed beside this package is in the checkout, and in no index.
            where = "./iec61499 in the checkout" if requirement.name == "iec61499" else requirement.name
            yield _library(requirement, "needed", f"pip install {where}")


def _extras() -> Iterator[Part]:
    for extra, purpose in _EXTRAS.items():
        wanted = [each for each in _requirements() if each.marker and each.marker.evaluate({"extra": extra})]
        lacking = [each.name for each in wanted if _library(each, "missing", "").state != "present"]
        if lacking:
            advice = f"for {purpose}: pip install 'dtwin[{extra}]' ({', '.join(lacking)})"
            yield Part(f"extra {extra}", "missing", "", advice)
        else:
            yield Part(f"extra {extra}", "present", f"{len(wanted)} libraries")


def _requirements() -> list[Requirement]:
    return [Requirement(each) for each in importlib.metadata.requires("dtwin") or []]


def _library(requirement: Requirement, otherwise: State, advice: str) -> Part:
    try:
        return Part(requirement.name, "present", importlib.metadata.version(requirement.name))
    except importlib.metadata.PackageNotFoundError:
        return Part(requirement.name, otherwise, "", advice)


def _viewer() -> Part:
    """The program of rerun-sdk, which a virtual environment has beside its interpreter."""
    found = shutil.which("rerun", path=str(Path(sys.executable).parent)) or shutil.which("rerun")
    return (
        Part("Rerun viewer", "present", found)
        if found
        else Part("Rerun viewer", "missing", "", "pip install rerun-sdk")
    )


def _program(name: str, command: str, variable: str, advice: str) -> Part:
    """A program that an environment variable names, else one on the path."""
    given = os.environ.get(variable)
    found = shutil.which(given or command)
    if found is None:
        return Part(name, "missing", "", f"{variable} is {given}, which is no program" if given else advice)
    return Part(name, "present", found)


def _compiler() -> Part:
    found = next(compilers(), None)
    if found is None:
        return Part("C compiler", "missing", "", "for faster function blocks: cc, or pip install 'dtwin[native]'")
    return Part("C compiler", "present", " ".join(found.command))


def _display() -> Part:
    shown = os.environ.get("WAYLAND_DISPLAY") or os.environ.get("DISPLAY")
    if shown or sys.platform in ("darwin", "win32"):
        return Part("display", "present", shown or sys.platform)
    return Part("display", "missing", "", "for --viewer window; --viewer web and recordings need none")


def _run_folder() -> Part:
    name, advice = "folder of cells", "set XDG_RUNTIME_DIR to a folder of yours"
    try:
        place = folder()
    except (OSError, DtwinError) as error:
        return Part(name, "needed", "", f"{error}: {advice}")
    writable = os.access(place, os.W_OK)
    return Part(name, "present" if writable else "needed", str(place), "" if writable else advice)


def examine_port(purpose: str, port: int) -> Part:
    """Whether a TCP port of the loopback interface is free."""
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind(("127.0.0.1", port))
        except OSError:
            return Part(f"port {port}", "taken", purpose, "a cell or a device is up, or another program has it")
    return Part(f"port {port}", "free", purpose)


def _priority() -> Part:
    name, advice = "real-time priority", "for fewer late ticks in real time: the right to it (`ulimit -r`)"
    if sys.platform != "linux":
        return Part(name, "missing", "", "Linux alone has it")
    import resource  # Other systems lack it.

    granted = os.geteuid() == 0 or resource.getrlimit(resource.RLIMIT_RTPRIO)[0] > 0
    return Part(name, "present") if granted else Part(name, "missing", "", advice)
