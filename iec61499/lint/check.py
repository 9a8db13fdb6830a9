"""Checks files: what is wrong with them, and what the rules find."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from fnmatch import fnmatch
from pathlib import Path
from typing import Final, Literal

from iec61499 import model
from iec61499.errors import FunctionBlockError, ToolError, choices
from iec61499.files.block_types import read_type
from iec61499.files.project import project_of
from iec61499.files.systems import read_system
from iec61499.inspection import SUFFIXES, Remark, inspect
from iec61499.library import Library
from iec61499.lint.findings import DEPARTURE, INVALID, UNSUPPORTED, Finding
from iec61499.lint.networks import network_findings
from iec61499.lint.settings import Settings, Suppressions, is_allowed, level_of
from iec61499.lint.types import type_findings

Target = Literal["embedded", "forte"]


def files_of(paths: Iterable[Path], settings: Settings | None = None) -> list[Path]:
    """The files to check: those given, and those in the folders given that settings do not exclude.

    Raises:
        ToolError: no path leads anywhere, or a folder holds nothing to check, as one does that was written wrong.
    """
    found: list[Path] = []
    paths = list(paths)
    if paths and not any(path.exists() for path in paths):
        raise ToolError(f"{paths[0]}: there is no such file or folder")
    for path in paths:
        if not path.is_dir():
            found.append(path)
            continue
        inside = sorted(file for file in path.rglob("*") if file.suffix.lower() in SUFFIXES and file.is_file())
        if not inside:
            raise ToolError(f"{path}: expected a folder with files that end in {choices(sorted(SUFFIXES))}")
        excluded = settings.exclude if settings is not None else ()
        found += [f for f in inside if not any(fnmatch(str(f.relative_to(path)), pattern) for pattern in excluded)]
    return found


def check(
    files: Sequence[Path],
    blocks: Path | None,
    target: Target,
    settings: Settings,
    folders: Sequence[Path] = (),
) -> list[Finding]:
    """All findings of all files, each once: mistakes first, then in the order of the files and their lines.

    What settings or files suppress is left out.

    Args:
        files: types, systems and boot files.
        blocks: folder of the types that the files use; None for the project of each file.
        target: with `forte` also what may differ there.
        settings: levels of the rules, and what is allowed.
        folders: what stands for the project of files that are in none.
    """
    libraries: dict[Path, Library | FunctionBlockError] = {}
    suppressions = Suppressions()
    found: set[Finding] = set()
    for file in files:
        suppressions.read(str(file))
        folder = blocks or project_of(file, folders)
        if folder not in libraries:
            try:
                libraries[folder] = Library([folder])
            except FunctionBlockError as error:
                libraries[folder] = error
        library = libraries[folder]
        found |= (
            {_invalid(library, file)}
            if isinstance(library, FunctionBlockError)
            else {*_of_file(file, library, target)}
        )
    kept = [f for f in _once(found) if not suppressions.hold(f) and not is_allowed(f, settings)]
    kept += [finding for finding in suppressions.findings() if not is_allowed(finding, settings)]
    order = {str(file): number for number, file in enumerate(files)}
    told = [finding for finding in kept if level_of(finding.rule, settings) != "off"]
    return sorted(
        told,
        key=lambda finding: (
            finding.rule not in (INVALID, UNSUPPORTED),
            order.get(finding.file, len(order)),
            finding,
        ),
    )


_UNSUPPORTED: Final = re.compile(r"\b(?:is|are) not supported\b")
"""What messages say of that which is right, but cannot run here."""
_NAMED: Final = re.compile(r"(?:[^\s.:]+\.)*([^\s.:]+[ :].*)", re.DOTALL)
"""A message that begins with the dotted name of a block inside others."""


def _once(found: Iterable[Finding]) -> Iterator[Finding]:
    """The findings; what a block inside a type lacks is one, however many networks use the type."""
    told: set[tuple[str, int, int, str, str]] = set()
    for finding in sorted(found, key=lambda finding: len(finding.message)):
        named = _NAMED.fullmatch(finding.message) if finding.rule in ("no-such-service", "no-such-protocol") else None
        place = (finding.file, finding.line, finding.column, finding.rule, named[1] if named else finding.message)
        if place not in told:
            told.add(place)
            yield finding


_PLACED: Final = re.compile(r"left out: (.*?):(\d+): (.*)", re.DOTALL)
"""What is left out, and where."""


def _remark(remark: Remark, file: Path) -> Finding:
    placed = _PLACED.fullmatch(remark.message)
    if placed is not None:
        return Finding(placed[1], int(placed[2]), 0, remark.rule, f"left out: {placed[3]}")
    return _invalid(remark, file, remark.rule)


def _invalid(error: FunctionBlockError, file: Path, rule: str = INVALID) -> Finding:
    where = (error.file, error.line, error.column) if error.file else (str(file) if rule != INVALID else "", 0, 0)
    kind = UNSUPPORTED if rule == INVALID and _UNSUPPORTED.search(error.message) else rule
    return Finding(*where, kind, error.message)


def _of_file(file: Path, library: Library, target: Target) -> Iterator[Finding]:
    found = inspect(file, library)
    yield from (_invalid(problem, file) for problem in found.problems)
    yield from (_remark(remark, file) for remark in found.remarks)
    if target == "forte":
        yield from (_invalid(departure, file, DEPARTURE) for departure in found.departures)
    try:
        if file.suffix.lower() in (".fbt", ".fct", ".sub"):
            block = read_type(file, library)
            yield from type_findings(block)
            if isinstance(block, model.CompositeFBType | model.SubApplicationType):
                yield from network_findings(block.network, library.find)
        elif file.suffix.lower() == ".sys":
            system = read_system(file, library)
            others = tuple(c for d in system.devices for r in d.resources for c in r.network.events)
            for application in system.applications:
                yield from network_findings(application.network, library.find, others)
    except FunctionBlockError:
        return  # it is among the problems
