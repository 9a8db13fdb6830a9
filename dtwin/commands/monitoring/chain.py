"""`dtwin monitor LOG --arm ARM --commissioned RECORD`: any serial arm, from logs of other programs."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

from rich.console import Console
from rich.table import Table

from dtwin.emulation.chain.arms import arm_of
from dtwin.identification.chain.record import read_record
from dtwin.measurements.columns import read_map
from dtwin.measurements.measurement import Measurement
from dtwin.measurements.page import oddities
from dtwin.measurements.reading import read_measurement
from dtwin.monitoring.chain.watching import Push, Watched, watch
from dtwin.terminal import as_text, print_json, print_table


def monitored(log: Path, arm: str, commissioned: Path, columns: Path | None, json: bool) -> int:
    """Holds a log against an identified arm and prints what it shows; 1 where there is a push or a change.

    Raises:
        RecordingError: a file cannot be read, or is of another arm.
        ModelError: the arm cannot be read.
    """
    record, chain = read_record(commissioned), arm_of(arm)
    measured = read_measurement(log, None if columns is None else read_map(columns), chain)
    found = watch(record, chain, measured)
    if json:
        print_json({**asdict(found), "odd": oddities(measured)})
    else:
        _print(found, measured)
    return 1 if found.pushes or any(change.told for change in found.changes) else 0


def _print(found: Watched, measured: Measurement) -> None:
    console = Console(highlight=False, soft_wrap=True)
    console.print(as_text(f"{found.seconds:.1f} s are judged, in {found.moving:.1f} s of which the arm moves"))
    table = Table("change", "value", "95 % interval")
    for change in found.changes:
        if change.told:
            value, half = (_text(change.name, number) for number in (change.value, change.half))
            table.add_row(change.name, value, f"+- {half}")
    if table.row_count:
        print_table(table)
    elif found.changes:
        console.print("nothing has changed by more than it does from day to day")
    else:
        console.print("too few joints move for long enough to tell changes of drives, friction or load")
    for push in found.pushes:
        console.print(as_text(_push_text(push)))
    if not found.pushes:
        console.print("no push")
    for line in oddities(measured):
        console.print(as_text(line))


def _text(name: str, number: float) -> str:
    return f"{number:.3g} kg" if name == "load" else f"{100 * number:.0f} %"


def _push_text(push: Push) -> str:
    joints = ", ".join(push.joints)
    return f"push from {push.start:.2f} to {push.end:.2f} s, up to {push.size:.3g} N m (N), seen by {joints}"
