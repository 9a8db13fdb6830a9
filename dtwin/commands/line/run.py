"""`dtwin line run`, `dtwin line demo` and `dtwin line report`."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import tyro

from dtwin.controller.runtime import RuntimeOption, chosen
from dtwin.errors import ParameterError
from dtwin.files import ensure_writable, replacing
from dtwin.line.control import Exchange, Served
from dtwin.line.file import DEFAULT_NAME, line_of
from dtwin.line.kept import Kept, kept, prepare, read, write
from dtwin.line.report import page, summary
from dtwin.line.run import LineRun, LineSettings, Mode
from dtwin.line.system import system
from dtwin.terminal import print_json, printable

_HTML: Final = ".html"
LONGEST: Final = 86_400.0
"""Longest run, s."""
DEMO: Final = LineSettings(duration=420.0, faults=(("a2", "K2*=0.1@137.5-270"),))
"""The run of the demonstration: the arm of a2 loses nine tenths of a motor's torque with a box held, and is repaired
later."""


@dataclass(frozen=True, kw_only=True)
class LineRunCommand(RuntimeOption):
    """Run a production line without a display, as fast as it goes: stations with their arms, vehicles, and twins that
    give the work of an arm that fails to others."""

    line: tyro.conf.Positional[str] = DEFAULT_NAME
    """Line: a file (*.toml), or a name of the folder lines, such as default; docs/line.md explains it."""
    duration: float = 300.0
    """Plant time, s."""
    fault: tuple[str, ...] = ()
    """A fault of the arm of a station, as STATION:FAULT, such as a2:K2*=0.1@122-270; repeatable. When one that ends
    is over, the arm counts as repaired and is released."""
    twins: Mode = "act"
    """What the twins do with what they decide: act, propose (only write it down), or off."""
    devices: bool = False
    """Run the blocks on a resource for each device, which talk by PUBLISH and SUBSCRIBE."""
    served: bool = False
    """Take blocks that are served already, at the ports of the line's system: `dtwin fb run --all fb/line/line.sys`
    has those of the default line."""
    out: Path | None = None
    """New folder for how it went, the history of decisions, and the logs of all stations."""
    report: Path | None = None
    """Page to write (*.html)."""
    json: bool = False
    """Print one JSON object on standard output and nothing else."""

    def execute(self) -> int:
        if not 1.0 <= self.duration <= LONGEST:
            raise ParameterError(f"--duration: expected 1 to {LONGEST:g} s, got {self.duration:g}")
        settings = LineSettings(self.duration, self.twins, tuple(map(fault_of, self.fault)), self.devices)
        with chosen(self.runtime):
            if not self.served:
                return _carried_out(self.line, settings, self.out, self.report, self.json)
            if self.devices:
                raise ParameterError("--served, --devices: expected one of them")
            line = line_of(self.line)
            with Served(line, system(line)) as blocks:
                return _carried_out(self.line, settings, self.out, self.report, self.json, blocks)


@dataclass(frozen=True, kw_only=True)
class LineDemo:
    """Show a line that goes on when an arm fails: it loses torque with a box held and is stopped, its operation moves
    to another station, vehicles are redirected; later it is repaired, and the work comes back."""

    out: Path | None = None
    """New folder for the recording: how it went, the history of decisions, and the logs of all stations."""
    report: Path = Path("line.html")
    """Page to write (*.html)."""
    json: bool = False
    """Print one JSON object on standard output and nothing else."""

    def execute(self) -> int:
        return _carried_out(DEFAULT_NAME, DEMO, self.out, self.report, self.json)


@dataclass(frozen=True, kw_only=True)
class LineReport:
    """Write the page of a run of a line: throughput over time, what stations and vehicles did, where time was lost,
    and what was decided and why."""

    run: tyro.conf.Positional[Path]
    """Folder of the run, which `dtwin line run --out` has written."""
    report: Path = Path("line.html")
    """Page to write (*.html)."""
    json: bool = False
    """Print one JSON object on standard output and nothing else."""

    def execute(self) -> int:
        ensure_writable(self.report, _HTML)
        found = read(self.run)
        _write_page(found, self.report)
        _told(found, self.json, self.report)
        return 0


def fault_of(text: str) -> tuple[str, str]:
    station, colon, fault = text.partition(":")
    if not colon:
        raise ParameterError(f"--fault: expected STATION:FAULT, such as a2:K2*=0.1@122-270, got {text!r}")
    return station, fault


def _carried_out(
    line: str,
    settings: LineSettings,
    out: Path | None,
    report: Path | None,
    json: bool,
    blocks: Exchange | None = None,
) -> int:
    """Runs a line and writes what is asked for; 1 if a box was lost or vehicles touched."""
    if report is not None:
        ensure_writable(report, _HTML)
    planned = line_of(line)
    run = LineRun(planned, settings, None if out is None else prepare(out), blocks)
    try:
        run.run(None if json or not sys.stderr.isatty() else _progress)
    finally:
        if out is not None:
            write(run, out)
    found = kept(run)
    if report is not None:
        _write_page(found, report)
    _told(found, json, report, run.time / run.wall if run.wall else 0.0)
    return int(found.lost > 0 or found.collisions > 0)


def _progress(time: float) -> None:
    print(f"\r{time:8.0f} s", end="", file=sys.stderr)


def _write_page(found: Kept, report: Path) -> None:
    with replacing(report, _HTML) as temporary:
        temporary.write_text(page(found))


def _told(found: Kept, json: bool, report: Path | None, factor: float = 0.0) -> None:
    numbers = summary(found) | ({"real_time_factor": factor} if factor else {})
    if json:
        print_json(numbers)
        return
    for decision in found.decisions:
        print(printable(f"{decision.time:8.1f} s  {decision.who}: {decision.what}: {decision.why}"))
    print(
        f"{found.duration:8.1f} s  {len(found.left)} of {found.entered} boxes left, {found.lost} lost,"
        f" {found.collisions} collisions, {numbers['boxes_per_hour']} boxes/h"
    )
    if report is not None:
        print(f"page: {report}")
