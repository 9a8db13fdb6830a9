"""`fb check`: what is wrong with function-block files, and what is hardly meant."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import tyro

from iec61499 import __version__
from iec61499.lint.check import check, files_of
from iec61499.lint.findings import LEVELS, RULES, Level
from iec61499.lint.reports import as_json, as_line, as_sarif
from iec61499.lint.settings import Settings, find_settings, level_of, read_settings
from iec61499.output import printable


@dataclass(frozen=True)
class FbCheck:
    """Check function-block files: what is wrong with them, and what is right, but hardly meant.

    Prints one line for every finding, FILE:LINE:COLUMN: message [rule], of all files at once. Levels of the rules and
    findings that are meant are settings in fb.toml; `fb: allow RULE: REASON` in a comment allows one in its line or
    the next. The exit status is 1 if there is a finding of the level error.
    """

    files: tyro.conf.Positional[tuple[Path, ...]] = (Path(),)
    """Types (.fbt, .fct, .sub), systems (.sys), boot files (.fboot), or folders of them."""
    blocks: Path | None = None
    """Folder of the block types that the files use; without it the project of each file: the nearest folder above
    with a project of 4diac IDE, else the folder given, else its own."""
    target: Literal["embedded", "forte"] = "embedded"
    """With forte also a warning for every block that may compute something else on 4diac FORTE (docs/blocks.md)."""
    level: Literal["error", "warning", "info"] = "warning"
    """Least level of the findings that are told."""
    fail_on: Literal["error", "warning", "info"] = "error"
    """Least level of a finding that makes the exit status 1."""
    format: Literal["text", "json", "sarif"] = "text"
    """How the findings are printed; sarif is what code hosts show beside the lines of a change."""
    settings: Path | None = None
    """File of settings; without it fb.toml of the first folder given, or of the nearest one above."""
    rules: bool = False
    """List the rules with their levels instead."""

    def execute(self) -> int:
        settings = self._settings()
        if self.rules:
            width = max(map(len, RULES))
            for rule in RULES.values():
                print(f"{rule.name:<{width}}  {level_of(rule.name, settings):<7}  {rule.text}")
            return 0
        files = files_of(self.files, settings)
        folders = [path for path in self.files if path.is_dir()]
        found = check(files, self.blocks, self.target, settings, folders)
        levels = [level_of(finding.rule, settings) for finding in found]
        told = [finding for finding, level in zip(found, levels, strict=True) if _reaches(level, self.level)]
        if self.format == "json":
            print(as_json(told, settings))
        elif self.format == "sarif":
            print(as_sarif(told, settings, __version__))
        else:
            for finding in told:
                print(printable(as_line(finding)))
            counts = [f"problems: {levels.count('error')}"]
            if self.target == "forte" or "warning" in levels:
                counts.append(f"warnings: {levels.count('warning')}")
            if self.level == "info":
                counts.append(f"remarks: {levels.count('info')}")
            print(f"files: {len(files)}, {', '.join(counts)}")
        return int(any(_reaches(level, self.fail_on) for level in levels))

    def _settings(self) -> Settings:
        first = self.files[0] if self.files else Path()
        file = self.settings or find_settings(first if first.is_dir() else first.parent)
        return read_settings(file) if file is not None else Settings()


def _reaches(level: Level, least: Level) -> bool:
    """Whether a level is at least as grave as another."""
    return LEVELS.index(level) <= LEVELS.index(least)
