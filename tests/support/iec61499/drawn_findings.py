"""Findings of `fb check` on the types of foreign projects, drawn at random, for a person to judge."""

from __future__ import annotations

import hashlib
import random
import sys
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import tyro

from iec61499.files.project import project_of
from iec61499.lint.check import check
from iec61499.lint.findings import LEVELS, RULES, Finding
from iec61499.lint.settings import Settings


@dataclass(frozen=True)
class Options:
    """Draw findings on the types of foreign projects, each type once, and print them with the lines around each."""

    folders: tyro.conf.Positional[tuple[Path, ...]]
    """Folders with projects of 4diac IDE."""
    seed: int = 1
    """Seed of the draw."""
    count: int = 100
    """How many are drawn."""
    level: Literal["error", "warning", "info"] = "warning"
    """Least level of the findings."""


def types(folders: tuple[Path, ...]) -> Iterator[Path]:
    """The types of the folders, each content once."""
    seen = set()
    files = (file for folder in folders for suffix in ("fbt", "sub", "fct") for file in folder.rglob(f"*.{suffix}"))
    for file in sorted(file for file in files if file.is_file()):
        digest = hashlib.sha256(file.read_bytes()).digest()
        if digest not in seen:
            seen.add(digest)
            yield file


def found(folders: tuple[Path, ...], level: str) -> tuple[int, list[Finding]]:
    """How many types there are, and all findings on them."""
    by_project: dict[Path, list[Path]] = {}
    for file in types(folders):
        by_project.setdefault(project_of(file), []).append(file)
    findings = {
        finding
        for project, files in by_project.items()
        for finding in check(files, project, "embedded", Settings())
        if LEVELS.index(RULES[finding.rule].level) <= LEVELS.index(level)
    }
    return sum(map(len, by_project.values())), sorted(findings)


def main() -> int:
    """Prints the totals by rule, and those drawn."""
    options = tyro.cli(Options)
    count, findings = found(options.folders, options.level)
    rules = Counter(finding.rule for finding in findings)
    print(f"{count} types, {len(findings)} findings: {', '.join(f'{rule} {n}' for rule, n in rules.most_common())}\n")
    drawn = random.Random(options.seed).sample(findings, min(options.count, len(findings)))
    for number, finding in enumerate(drawn, 1):
        print(f"{number}. {finding} [{finding.rule}]")
        lines = Path(finding.file).read_text(encoding="utf-8", errors="replace").splitlines() if finding.file else []
        for place in range(max(0, finding.line - 2), min(len(lines), finding.line + 1)):
            print(f"   {place + 1:5d} {lines[place].strip()[:200]}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
