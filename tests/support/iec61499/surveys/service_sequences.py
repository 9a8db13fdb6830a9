"""What comes of the service sequences of a library, on the embedded runtime and on a device."""

from __future__ import annotations

import re
import subprocess
import sys
import tempfile
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Final
from xml.etree import ElementTree

import tyro

PLACE: Final = re.compile(r"^.*?:\d+: (?:[\w ]+: )?(?=\S)")
TYPE: Final = re.compile(r"\b\w+(?= is a service| has adapters)|(?<=has no type )\w+")
Said = dict[tuple[str, str], tuple[str, str]]
"""What came of each sequence, by type and name, and why."""


@dataclass(frozen=True)
class Options:
    """Run the service sequences of all types below folders, and print what came of each."""

    folders: tyro.conf.Positional[tuple[Path, ...]]
    """Folders with types."""
    device: str = ""
    """HOST:PORT of a device, such as a 4diac FORTE, that is asked as well."""


def outcomes(folders: tuple[Path, ...], runtime: str) -> Said:
    """What `fb test` says of each sequence: pass, fail or left out, with the reason."""
    with tempfile.TemporaryDirectory() as kept:
        junit = Path(kept) / "junit.xml"
        command = [sys.executable, "-m", "iec61499.cli", "test", "--runtime", runtime, "--junit", str(junit)]
        subprocess.run([*command, *map(str, folders)], capture_output=True, check=False)
        found: Said = {}
        for case in ElementTree.parse(junit).iter("testcase"):
            kind = case.get("classname", "").rpartition(".")[0].rpartition(".")[2] or case.get("classname", "")
            wrong, left = case.find("failure"), case.find("skipped")
            said = ("pass", "")
            if wrong is not None:
                said = ("fail", (wrong.text or wrong.get("message") or "").strip())
            elif left is not None:
                said = ("left out", left.get("message") or "")
            found[kind, case.get("name", "")] = said[0], PLACE.sub("", said[1].replace("\n", " "))
    return found


def main() -> int:
    """Prints a row for each sequence that passes or fails somewhere, and how many are left out for which reason."""
    options = tyro.cli(Options)
    runtimes = ["embedded", *([options.device] if options.device else [])]
    found = [outcomes(options.folders, runtime) for runtime in runtimes]
    titles = ["embedded", *(["device"] if options.device else [])]
    print(f"| sequence | {' | '.join(titles)} | why |\n| --- |{' --- |' * len(titles)} --- |")
    drafts: Counter[str] = Counter()
    for key in found[0]:
        said = [each.get(key, ("not collected", "")) for each in found]
        reasons = list(dict.fromkeys(reason for _, reason in said if reason))
        if all(outcome == "left out" for outcome, _ in said):
            drafts[TYPE.sub("it", "; ".join(reasons))] += 1
            continue
        row = (".".join(key), *(outcome for outcome, _ in said), "; ".join(reasons).replace("|", "\\|"))
        print(f"| {' | '.join(row)} |")
    print("\n| left out | why |\n| --- | --- |")
    for reason, count in drafts.most_common():
        print(f"| {count} | {reason} |")
    for title, each in zip(titles, found, strict=True):
        totals = Counter(outcome for outcome, _ in each.values())
        print(f"\n{title}: {', '.join(f'{count} {name}' for name, count in totals.most_common())} of {len(each)}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
