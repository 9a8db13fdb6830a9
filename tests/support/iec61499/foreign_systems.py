"""What comes of the systems of foreign projects: loaded, checked, and run for some simulated seconds.

A system runs, or is refused with a reason. In one that runs, every block of an application runs in a resource, or a
remark of the check names it: nothing is left out in silence.
"""

from __future__ import annotations

import hashlib
import json
import signal
import sys
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Literal

import tyro

from iec61499 import model
from iec61499.errors import ToolError
from iec61499.files.project import project_of
from iec61499.inspection import Findings, inspect
from iec61499.library import Library
from iec61499.opening import opened
from iec61499.testing.systems import SystemBench

LONGEST = 60
"""Longest time for one system, s."""
Outcome = Literal["runs", "runs in part", "refused", "fails"]


@dataclass(frozen=True)
class Result:
    """What came of one system.

    Attributes:
        file: the system.
        devices: its devices.
        blocks: blocks of its resources.
        outcome: it runs; it runs but for what remarks name; it is refused; or it ends in an error.
        reason: the first problem, or how many remarks of which rule there are.
        silent: blocks of applications that neither run nor are named.
    """

    file: str
    devices: int
    blocks: int
    outcome: Outcome
    reason: str
    silent: tuple[str, ...] = ()


@dataclass(frozen=True)
class Options:
    """Load, check and run every system of foreign projects, and print what came of it."""

    folders: tyro.conf.Positional[tuple[Path, ...]]
    """Folders with projects of 4diac IDE."""
    seconds: float = 5.0
    """Simulated time for which each runs."""
    json: bool = False
    """Print JSON instead of a table."""


def systems(folders: tuple[Path, ...]) -> Iterator[Path]:
    """The systems of the folders, each content once."""
    seen = set()
    for file in sorted(file for folder in folders for file in folder.rglob("*.sys") if file.is_file()):
        digest = hashlib.sha256(file.read_bytes()).digest()
        if digest not in seen:
            seen.add(digest)
            yield file


@contextmanager
def limited(seconds: int) -> Iterator[None]:
    """Ends what takes longer in a TimeoutError."""

    def end(number: int, frame: object) -> None:
        raise TimeoutError(f"longer than {seconds} s")

    before = signal.signal(signal.SIGALRM, end)
    signal.alarm(seconds)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


def outcome(file: Path, seconds: float) -> Result:
    """What comes of a system within `seconds` of simulated time."""
    name = str(file)
    try:
        with limited(LONGEST):
            library = Library([project_of(file)])
            found = inspect(file, library)
            if found.problems:
                return Result(name, 0, 0, "refused", _short(str(found.problems[0]), file))
            system = library.load_system(file)
            resources = [f"{device.name}.{each.name}" for device in system.devices for each in device.resources]
            bench = SystemBench(system, library)
            blocks = _blocks(bench, resources)
            if not blocks:
                return Result(name, len(system.devices), 0, "refused", "has no block in a resource")
            bench.advance(seconds)
    except (ToolError, TimeoutError, RecursionError) as error:
        return Result(name, 0, 0, "refused" if isinstance(error, ToolError) else "fails", _short(str(error), file))
    except Exception as error:  # a fault of the tool, which the table shall show
        return Result(name, 0, 0, "fails", f"{type(error).__name__}: {error}")
    rules = Counter(remark.rule for remark in found.remarks)
    reason = ", ".join(f"{rule} {count}" for rule, count in sorted(rules.items()))
    silent = tuple(sorted(_silent(system, blocks, found)))
    kind: Outcome = "runs in part" if {*rules} - {"names-differ-in-case"} else "runs"
    return Result(name, len(system.devices), len(blocks), kind, reason, silent)


def _blocks(bench: SystemBench, names: list[str]) -> set[str]:
    """All blocks of all resources, those inside subapplications and composites, too."""
    found = set()
    for name in names:
        found |= {f"{name}.{block}" for block in bench.resource(name).names() if block != "START"}
    return found


def _silent(system: model.System, blocks: set[str], found: Findings) -> Iterator[str]:
    """Blocks of applications that run nowhere and that no remark names."""
    running = {name.split(".", 2)[2] for name in blocks}
    said = " ".join(remark.message for remark in found.remarks)
    for application in opened(system).applications:
        for block in application.network.blocks:
            named = block.name in said or f"application {application.name}, as none" in said
            if block.name not in running and not named:
                yield f"{application.name}.{block.name}"


def _called(file: Path, folders: tuple[Path, ...]) -> str:
    """The project of a system, as its folder below those given is called, and its file."""
    inside = next(file.relative_to(folder) for folder in folders if file.is_relative_to(folder))
    return f"{inside.parts[0]}: {file.name}" if len(inside.parts) > 1 else file.name


def _short(text: str, file: Path) -> str:
    return text.replace(f"{file.parent}/", "").replace("\n", " ")[:160]


def main() -> int:
    """Prints the table; the exit status is 1 if something is left out in silence, or the tool fails."""
    options = tyro.cli(Options)
    results = [outcome(file, options.seconds) for file in systems(options.folders)]
    if options.json:
        print(json.dumps([asdict(result) for result in results], indent=1))
    else:
        print("| system | devices | blocks | outcome | reason |\n| --- | --- | --- | --- | --- |")
        for result in results:
            reason = result.reason.replace("|", "\\|") + (f"; SILENT: {result.silent}" if result.silent else "")
            row = (_called(Path(result.file), options.folders), result.devices, result.blocks, result.outcome, reason)
            print(f"| {' | '.join(map(str, row))} |", flush=True)
        totals = Counter(result.outcome for result in results)
        print(f"\n{len(results)} systems: {', '.join(f'{count} {kind}' for kind, count in totals.most_common())}")
    return int(any(result.silent or result.outcome == "fails" for result in results))


if __name__ == "__main__":
    sys.exit(main())
