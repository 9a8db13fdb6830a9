"""`dtwin identify LOG --arm FILE`: any serial arm, from logs of other programs."""

from __future__ import annotations

from collections.abc import Sequence

from rich.console import Console
from rich.table import Table

from dtwin.identification.chain.delay import delays, said_of
from dtwin.identification.chain.gears import gears
from dtwin.identification.chain.gears import said_of as said_of_gears
from dtwin.identification.chain.identify import Identification, Sample
from dtwin.identification.chain.result import as_object, doubts, numbers
from dtwin.measurements.page import oddities
from dtwin.terminal import as_text, print_json, print_table


def report(found: Identification, samples: Sequence[Sample], json: bool) -> None:
    """Prints what was found, for people or for programs."""
    odd = [f"{s.measurement.source}: {line}" for s in samples for line in oddities(s.measurement)]
    if json:
        late = {n.name: {"value": n.value, "half": n.half, "told": n.told} for n in delays(found)}
        yielding = [row for gear in gears(found, samples).each for row in (gear.compliance, gear.play)]
        sides = {n.name: {"value": n.value, "half": n.half, "told": n.told} for n in yielding}
        print_json({**as_object(found), "delays": late, "gears": sides, "oddities": odd})
        return
    table = Table("", "value, SI units", "95 % interval")
    rows = list(numbers(found))
    for row in rows:
        if row.told:
            table.add_row(row.name, f"{row.value:.4g}", f"+- {row.half:.2g}")
    print_table(table)
    console = Console(highlight=False, soft_wrap=True)
    for line in [*odd, *found.arm.remarks]:
        console.print(as_text(line))
    console.print(as_text(f"friction: basic, {', '.join(found.groups) or 'nothing else proved itself'}"))
    errors = found.held_out.get(found.groups)
    if errors is not None:
        told = ", ".join(f"{100 * error:.1f} %" for error in errors)
        console.print(as_text(f"effort that is not explained on motion that was held out, by joint: {told}"))
    for line in doubts(found):
        console.print(as_text(line))
    if late_words := said_of(delays(found)):
        console.print(as_text(late_words))
    for line in said_of_gears(gears(found, samples)):
        console.print(as_text(line))
    silent = [row.name for row in rows if not row.told]
    console.print(as_text(f"not told by the data, as it was known: {', '.join(silent) or 'nothing'}"))
