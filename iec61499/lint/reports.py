"""Findings for people and for programs: lines, JSON, and SARIF 2.1.0 of OASIS."""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any, Final
from urllib.parse import quote

from iec61499.lint.findings import INVALID, RULES, Finding
from iec61499.lint.settings import Settings, level_of

_SARIF_LEVELS: Final = {"error": "error", "warning": "warning", "info": "note", "off": "none"}


def as_line(finding: Finding) -> str:
    """`FILE:LINE:COLUMN: message [rule]`; a mistake has no rule that one could want to turn off."""
    return str(finding) if finding.rule == INVALID else f"{finding} [{finding.rule}]"


def as_json(findings: Iterable[Finding], settings: Settings) -> str:
    """A list of objects with file, line, column, rule, level and message."""
    found = [
        {
            "file": finding.file,
            "line": finding.line,
            "column": finding.column,
            "rule": finding.rule,
            "level": level_of(finding.rule, settings),
            "message": finding.message,
        }
        for finding in findings
    ]
    return json.dumps(found, indent=2)


def as_sarif(findings: Iterable[Finding], settings: Settings, version: str) -> str:
    """One run with all rules and results, whose files are given from the working folder."""
    rules = [
        {
            "id": rule.name,
            "shortDescription": {"text": rule.text},
            "defaultConfiguration": {"level": _SARIF_LEVELS[rule.level]},
        }
        for rule in RULES.values()
    ]
    driver = {"name": "fb check", "semanticVersion": version, "rules": rules}
    results = [_result(finding, settings) for finding in findings]
    run = {"tool": {"driver": driver}, "results": results, "columnKind": "unicodeCodePoints"}
    log = {"$schema": "https://json.schemastore.org/sarif-2.1.0.json", "version": "2.1.0", "runs": [run]}
    return json.dumps(log, indent=2)


def _result(finding: Finding, settings: Settings) -> dict[str, Any]:
    region = {"startLine": finding.line} if finding.line else {}
    if finding.column and region:
        region["startColumn"] = finding.column
    place: dict[str, Any] = {"artifactLocation": {"uri": _uri(finding.file)}}
    if region:
        place["region"] = region
    return {
        "ruleId": finding.rule,
        "ruleIndex": list(RULES).index(finding.rule),
        "level": _SARIF_LEVELS[level_of(finding.rule, settings)],
        "message": {"text": finding.message},
        "locations": [{"physicalLocation": place}] if finding.file else [],
    }


def _uri(file: str) -> str:
    path = Path(file)
    if not path.is_absolute():
        return quote(path.as_posix())
    here = Path.cwd()
    return quote(path.relative_to(here).as_posix()) if path.is_relative_to(here) else path.as_uri()
