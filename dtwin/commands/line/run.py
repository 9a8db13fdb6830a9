"""`dtwin line run`, `dtwin line demo` and `dtwin line report`."""

from __future__ import annotations

import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Final, NamedTuple

import tyro
from rich.table import Column, Table

from dtwin.campaign.spread import cores
from dtwin.controller.runtime import RuntimeOption, chosen
from dtwin.errors import ParameterError
from dtwin.files import RECORDING, ensure_writable, replacing
from dtwin.line.control import Exchange, OneResource
from dtwin.line.file import DEFAULT_NAME, line_of
from dtwin.line.followed import Followed
from dtwin.line.line import Line
from dtwin.line.records.kept import Kept, kept, prepare, read, write
from dtwin.line.records.report import page, summary
from dtwin.line.records.tables import MOST_ROWS, ask, write_tables
from dtwin.line.run import LineRun, LineSettings, fault_of
from dtwin.line.served import Served
from dtwin.line.system import system
from dtwin.line.twins.decisions import Mode
from dtwin.terminal import as_text, print_json, print_table, printable

if TYPE_CHECKING:
    from dtwin.line.records.drawing import Drawing

_HTML: Final = ".html"
LONGEST: Final = 86_400.0
"""Longest run, s."""
DEMO: Final = LineSettings(duration=420.0, faults=(("a2", "K2*=0.1@144.5-270"),))
"""The run of the demonstration: the arm of a2 loses nine tenths of a motor's torque with a box held, and is repaired
later."""


class Written(NamedTuple):
    """Where a run is written: its folder, its page and its recording; None for what is not wanted."""

    out: Path | None
    report: Path | None
    record: Path | None


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
    record: Path | None = None
    """Recording to write for the Rerun viewer (*.rrd)."""
    json: bool = False
    """Print one JSON object on standard output and nothing else."""

    def execute(self) -> int:
        if not 1.0 <= self.duration <= LONGEST:
            raise ParameterError(f"--duration: expected 1 to {LONGEST:g} s, got {self.duration:g}")
        settings = LineSettings(self.duration, self.twins, tuple(map(fault_of, self.fault)), self.devices)
        with chosen(self.runtime):
            if not self.served:
                return self._carried_out(line_of(self.line), settings)
            if self.devices:
                raise ParameterError("--served, --devices: expected one of them")
            line = line_of(self.line)
            with Served(line, system(line)) as blocks:
                return self._carried_out(line, settings, Followed(blocks, OneResource(line)))

    def _carried_out(self, line: Line, settings: LineSettings, blocks: Exchange | None = None) -> int:
        written = Written(self.out, self.report, self.record)
        return _carried_out(line, settings, written, self.json, blocks)


@dataclass(frozen=True, kw_only=True)
class LineDemo:
    """Show a line that goes on when an arm fails: it loses torque with a box held and is stopped, its operation moves
    to another station, vehicles are redirected; later it is repaired, and the work comes back."""

    out: Path | None = None
    """New folder for how it went, the history of decisions, and the logs of all stations."""
    report: Path = Path("line.html")
    """Page to write (*.html)."""
    record: Path = Path("line.rrd")
    """Recording to write for the Rerun viewer (*.rrd)."""
    json: bool = False
    """Print one JSON object on standard output and nothing else."""

    def execute(self) -> int:
        return _carried_out(line_of(DEFAULT_NAME), DEMO, Written(self.out, self.report, self.record), self.json)


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
        _print_summary(found, self.json, self.report)
        return 0


@dataclass(frozen=True, kw_only=True)
class LineQuery:
    """Answer a question in SQL about runs of lines, with DuckDB.

    Tables are events, decisions, stations, vehicles, boxes, and log_NAME, the log of station NAME; oee, throughput
    and losses follow from them. Each has the column run, the name of the folder. A question changes nothing and
    reaches no file.
    """

    question: tyro.conf.Positional[str]
    """The question, such as "select * from oee"."""
    runs: tyro.conf.Positional[tuple[Path, ...]]
    """Folders of the runs, which `dtwin line run --out` has written."""
    json: bool = False
    """Print one JSON object on standard output and nothing else."""

    def execute(self) -> int:
        if not self.runs:
            raise ParameterError("expected the folder of at least one run of `dtwin line run --out`")
        answer = ask(self.question, self.runs)
        if self.json:
            print_json({"columns": answer.columns, "rows": answer.rows, "more": answer.more})
            return 0
        table = Table(*(Column(as_text(name)) for name in answer.columns))
        for row in answer.rows:
            table.add_row(*(as_text(_cell(value)) for value in row))
        print_table(table)
        if answer.more:
            print(f"and more: the first {MOST_ROWS} rows are shown")
        return 0


def _cell(value: object) -> str:
    """A value of a table; times and shares with at most three decimals."""
    return "" if value is None else f"{value:.3f}".rstrip("0").rstrip(".") if isinstance(value, float) else str(value)


def _carried_out(
    line: Line, settings: LineSettings, written: Written, json: bool, blocks: Exchange | None = None
) -> int:
    """Runs a line and writes what is asked for; 1 if a box was lost or vehicles touched."""
    out, report, record = written
    for path, ending in ((report, _HTML), (record, RECORDING)):
        if path is not None:
            ensure_writable(path, ending)
    run = LineRun(line, replace(settings, threads=cores()), None if out is None else prepare(out), blocks)
    drawing = None if record is None else _drawing(run)
    try:
        run.run(None if json or not sys.stderr.isatty() else _progress, None if drawing is None else drawing.look)
    finally:
        if out is not None:
            write(run, out)
            write_tables(kept(run), out)
    found = kept(run)
    if report is not None:
        _write_page(found, report)
    if drawing is not None and record is not None:
        drawing.write(record)
    _print_summary(found, json, report, run.time / run.wall if run.wall else 0.0)
    if record is not None and not json:
        print(f"recording: {record}")
    return int(found.lost > 0 or found.collisions > 0)


def _progress(time: float) -> None:
    print(f"\r{time:8.0f} s", end="", file=sys.stderr)


def _write_page(found: Kept, report: Path) -> None:
    with replacing(report, _HTML) as temporary:
        temporary.write_text(page(found))


def _drawing(run: LineRun) -> Drawing:
    from dtwin.line.records.drawing import Drawing  # loads Rerun, which takes as long as the rest of the command

    return Drawing(run)


def _print_summary(found: Kept, json: bool, report: Path | None, factor: float = 0.0) -> None:
    numbers = summary(found) | ({"real_time_factor": factor} if factor else {})
    if json:
        print_json(numbers)
        return
    for decision in found.decisions:
        print(printable(f"{decision.time:8.1f} s  {decision.who}: {decision.what}: {decision.why}"))
    print(
        f"{found.duration:8.1f} s  {len(found.left)} of {found.entered} boxes left, {found.lost} lost,"
        f" {found.collisions} collisions, {numbers['boxes_per_hour']:.1f} boxes/h"
    )
    if report is not None:
        print(f"page: {report}")
