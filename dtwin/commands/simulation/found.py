"""What `dtwin optimise` shows of a search for any arm, once it is over."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

import msgspec
from rich.table import Table

from dtwin.simulation.optimise import Found, Scored
from dtwin.terminal import print_json, print_table


def show(
    found: Found[Scored],
    simulated: tuple[str, int],
    settings: Callable[[Scored], Mapping[str, str]],
    units: Mapping[str, str],
    plot: Path | None,
    json: bool,
) -> int:
    """Draws and prints what was found; returns the exit status, 1 if no candidate keeps all limits.

    Args:
        found: what was found.
        simulated: what was simulated of the candidates, such as motions, and how many in all.
        settings: the settings of an evaluation, by their names and in words.
        units: units of the terms of the cost by name.
        plot: file of the picture; None for no picture.
        json: whether one JSON object is printed and nothing else.
    """
    if plot is not None:
        from dtwin.simulation.pareto import draw_front

        draw_front(found, plot)
    best, reference, (name, count) = found.best, found.reference, simulated
    rate = count / found.seconds
    if json:
        report = {
            "best": msgspec.to_builtins(best),
            "reference": msgspec.to_builtins(reference),
            "front": [msgspec.to_builtins(each) for each in found.front("time", "tracking")],
            "candidates": len(found.scores),
            name: count,
            "seconds": found.seconds,
            f"{name}_per_second": rate,
        }
        print_json(report)
    elif best.broken:
        print(f"no candidate keeps all limits; the best breaks that of {best.broken}")
    else:
        title = "settings of least cost" if best.cost < reference.cost else "nothing better than the settings in use"
        table = Table("", "in use", "found", title=title)
        for (row, in_use), text in zip(settings(reference).items(), settings(best).values(), strict=True):
            table.add_row(row, in_use, text)
        for term, unit in units.items():
            table.add_row(f"{term}, {unit}", f"{reference.terms[term]:.4g}", f"{best.terms[term]:.4g}")
        table.add_row("cost", f"{reference.cost:.4f}", f"{best.cost:.4f}")
        print_table(table)
        print(f"{len(found.scores)} candidates, {count} {name} in {found.seconds:.1f} s: {rate:.0f} {name} a second")
    return 1 if best.broken else 0
