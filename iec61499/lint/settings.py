"""Settings of the rules, `fb.toml`, and suppressions inside files."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass, field
from fnmatch import fnmatch
from pathlib import Path
from typing import Final

import msgspec

from iec61499.errors import ToolError, choices
from iec61499.lint.findings import REASONLESS, RULES, UNUSED_SUPPRESSION, Finding, Level

NAME: Final = "fb.toml"
"""Name of the file of settings."""
_ALLOW: Final = re.compile(r"\bfb:\s*allow\s+([\w-]+)[ \t]*(?::[ \t]*(.*?))?\s*(?:\*\)|\*/|--|$)")


class Allowed(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Findings that are meant: of a rule, in the files that a pattern names, and why."""

    rule: str
    reason: str
    file: str = "*"


class Settings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The table [check] of fb.toml.

    Attributes:
        rules: the level of rules that shall have another one.
        exclude: patterns of files that are not checked, from the folder of fb.toml.
        allow: findings that are meant.
    """

    rules: dict[str, Level] = {}
    exclude: tuple[str, ...] = ()
    allow: tuple[Allowed, ...] = ()


class _File(msgspec.Struct, frozen=True):
    check: Settings = Settings()


def find_settings(folder: Path) -> Path | None:
    """The fb.toml of a folder, or of the nearest one above that has one."""
    start = folder.resolve()
    return next((each / NAME for each in (start, *start.parents) if (each / NAME).is_file()), None)


def read_settings(file: Path) -> Settings:
    """Reads a file of settings.

    Raises:
        ToolError: it cannot be read, or says what is not known; names the file and the valid choices.
    """
    try:
        settings = msgspec.convert(tomllib.loads(file.read_text(encoding="utf-8")), _File).check
    except OSError as error:
        raise ToolError(f"{file}: cannot be read: {error.strerror}") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, msgspec.ValidationError) as error:
        raise ToolError(f"{file}: {error}") from None
    for name in (*settings.rules, *(allowed.rule for allowed in settings.allow)):
        if name not in RULES:
            raise ToolError(f"{file}: unknown rule {name!r}: expected {choices(RULES)}")
    for allowed in settings.allow:
        if not allowed.reason.strip():
            raise ToolError(f"{file}: rule {allowed.rule} is allowed for no reason: expected one")
    return settings


@dataclass
class Suppressions:
    """What files say about findings in their own lines: `fb: allow RULE: REASON` in a comment, there or just above.

    Attributes:
        said: by file and line the rule and the reason.
    """

    said: dict[tuple[str, int], tuple[str, str]] = field(default_factory=dict)
    _read: set[str] = field(default_factory=set)
    _used: set[tuple[str, int]] = field(default_factory=set)

    def read(self, file: str) -> None:
        """Reads a file, once."""
        if file in self._read:
            return
        self._read.add(file)
        try:
            lines = Path(file).read_text(encoding="utf-8", errors="replace").split("\n")
        except OSError:
            return
        for number, line in enumerate(lines, 1):
            found = _ALLOW.search(line)
            if found is not None:
                self.said[file, number] = found[1], (found[2] or "").strip()

    def hold(self, finding: Finding) -> bool:
        """Whether a finding is suppressed."""
        self.read(finding.file)
        for place in ((finding.file, finding.line), (finding.file, finding.line - 1)):
            if self.said.get(place, ("", ""))[0] == finding.rule:
                self._used.add(place)
                return True
        return False

    def findings(self) -> Iterator[Finding]:
        """What is wrong with the suppressions themselves, when all findings have been held against them."""
        for (file, line), (rule, reason) in self.said.items():
            if rule not in RULES:
                yield Finding(file, line, 0, UNUSED_SUPPRESSION, f"unknown rule {rule}: expected {choices(RULES)}")
            elif not reason:
                message = f"{rule} is suppressed for no reason: expected fb: allow {rule}: REASON"
                yield Finding(file, line, 0, REASONLESS, message)
            elif (file, line) not in self._used:
                yield Finding(file, line, 0, UNUSED_SUPPRESSION, f"{rule} is suppressed, but not found here")


def is_allowed(finding: Finding, settings: Settings) -> bool:
    """Whether the settings allow a finding, which then is none."""
    names = (finding.file, Path(finding.file).name)
    patterns = [allowed.file for allowed in settings.allow if allowed.rule == finding.rule]
    return any(fnmatch(name, pattern) for name in names for pattern in patterns)


def level_of(rule: str, settings: Settings) -> Level:
    """How grave the findings of a rule are."""
    return settings.rules.get(rule, RULES[rule].level)
