"""`dtwin optimise --arm NAME`: the best gains, observers and speed of paths for any other arm, on its twin."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import msgspec
from rich.table import Table

from dtwin.commands.frame import progress_bar
from dtwin.errors import ParameterError
from dtwin.options import refuse_others
from dtwin.run.arm_cell import ArmCell, arm_cell_of
from dtwin.run.chain import ChainSettings
from dtwin.simulation.chain.optimise import ArmLimits, ArmObjective, ArmOptimum, optimise_arm
from dtwin.terminal import print_json, print_table

_DURATION: Final = 60.0
"""Length of the run that a cell is read for, s; a search goes once through its poses, however long that takes."""
_KNOWN: Final = (
    *("arm", "cell_file", "cost", "arms", "box", "saturated", "tracking", "candidates"),
    *("workers", "scheduler", "seed", "plot", "json", "runtime"),
)
"""Options that mean something for any arm."""
_UNITS: Final = {"time": "s", "tracking": "rad or m", "energy": "J", "command": "of what a drive takes"}


def other_cell(options: Any) -> ArmCell | None:
    """The cell of another arm that --arm or --cell-file stands for; None for the thesis's.

    Raises:
        ModelError: the file cannot be read.
    """
    found = None if options.cell_file is None else arm_cell_of(options.cell_file)
    return found if options.arm is None else ArmCell(arm=options.arm)


def search_arm(cell: ArmCell, options: Any, weights: Mapping[str, float]) -> int:
    """Searches and prints; returns the exit status, 1 if no candidate keeps all limits.

    Args:
        cell: the cell of the arm.
        options: those of `dtwin optimise`.
        weights: weights of the terms of the cost.

    Raises:
        DtwinError: an option has no meaning for this arm or is out of range, or a file cannot be used.
    """
    refuse_others(options, _KNOWN, ("arm",))
    objective = _objective(cell.settings(_DURATION), options, weights)
    with progress_bar("searching") as progress:
        found = optimise_arm(
            objective,
            candidates=options.candidates,
            workforce=options.workforce(),
            seed=options.seed,
            between=lambda done, best: progress(done, options.candidates),
        )
    if options.plot is not None:
        from dtwin.simulation.pareto import draw_front

        draw_front(found, options.plot)
    if options.json:
        print_json(_report(found))
    else:
        _print(found)
    return 1 if found.best.broken else 0


def _objective(settings: ChainSettings, options: Any, weights: Mapping[str, float]) -> ArmObjective:
    loads = (0.0,) if options.box is None else tuple(dict.fromkeys(options.box))
    if not 0.0 <= loads[0] <= loads[-1]:
        raise ParameterError(f"--box: expected the least and the largest mass in kg, got {loads[0]:g} {loads[-1]:g}")
    if options.arms < 0:
        raise ParameterError(f"--arms: expected at least 0, got {options.arms}")
    machines = tuple(range(options.seed + 1, options.seed + 1 + options.arms))
    limits = ArmLimits(saturated=options.saturated, tracking=options.tracking)
    return ArmObjective(settings, dict(weights), limits, machines, loads)


def _report(found: ArmOptimum) -> dict[str, Any]:
    return {
        "best": msgspec.to_builtins(found.best),
        "reference": msgspec.to_builtins(found.reference),
        "front": [msgspec.to_builtins(each) for each in found.front("time", "tracking")],
        "candidates": len(found.scores),
        "rounds": found.rounds,
        "seconds": found.seconds,
        "rounds_per_second": found.rounds / found.seconds,
    }


def _print(found: ArmOptimum) -> None:
    best, reference = found.best, found.reference
    if best.broken:
        print(f"no candidate keeps all limits; the best breaks that of {best.broken}")
        return
    better = best.cost < 1.0
    title = "settings of least cost" if better else "nothing better than the settings in use"
    table = Table("", "in use", "found", title=title)
    table.add_row("pole, rad/s", f"{reference.pole:g}", f"{best.pole:g}")
    table.add_row("observer, rad/s", f"{reference.observer:g}", f"{best.observer:g}")
    table.add_row("speed, of the data sheet's", f"{reference.speed:g}", f"{best.speed:g}")
    for name, unit in _UNITS.items():
        table.add_row(f"{name}, {unit}", f"{reference.terms[name]:.4g}", f"{best.terms[name]:.4g}")
    table.add_row("cost", f"{reference.cost:.4f}", f"{best.cost:.4f}")
    print_table(table)
    rate = found.rounds / found.seconds
    print(
        f"{len(found.scores)} candidates, {found.rounds} rounds in {found.seconds:.1f} s: {rate:.0f} rounds a second"
    )
    if better:
        words = f"--pole {best.pole:g} --observer {best.observer:g} --speed {best.speed:g}"
        print(f"`dtwin upload arm {words} --why WHY` gives them to a running arm")
