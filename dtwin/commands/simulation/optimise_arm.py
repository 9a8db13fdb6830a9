"""`dtwin optimise --arm NAME`: the best gains, observers and speed of paths for any other arm, on its twin."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from dtwin.commands.frame import progress_bar
from dtwin.commands.simulation.found import show
from dtwin.errors import ParameterError
from dtwin.options import refuse_others
from dtwin.run.arm_cell import ArmCell, arm_cell_of
from dtwin.run.chain import ChainSettings
from dtwin.simulation.chain.optimise import ArmLimits, ArmObjective, ArmScore, optimise_arm

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
    status = show(found, ("rounds", found.rounds), _settings, _UNITS, options.plot, options.json)
    if not options.json and status == 0 and found.best.cost < 1.0:
        best = found.best
        words = f"--pole {best.pole:g} --observer {best.observer:g} --speed {best.speed:g}"
        print(f"`dtwin upload arm {words} --why WHY` gives them to a running arm")
    return status


def _objective(settings: ChainSettings, options: Any, weights: Mapping[str, float]) -> ArmObjective:
    loads = (0.0,) if options.box is None else tuple(dict.fromkeys(options.box))
    if not 0.0 <= loads[0] <= loads[-1]:
        raise ParameterError(f"--box: expected the least and the largest mass in kg, got {loads[0]:g} {loads[-1]:g}")
    if options.arms < 0:
        raise ParameterError(f"--arms: expected at least 0, got {options.arms}")
    machines = tuple(range(options.seed + 1, options.seed + 1 + options.arms))
    limits = ArmLimits(saturated=options.saturated, tracking=options.tracking)
    return ArmObjective(settings, dict(weights), limits, machines, loads)


def _settings(score: ArmScore) -> dict[str, str]:
    return {
        "pole, rad/s": f"{score.pole:g}",
        "observer, rad/s": f"{score.observer:g}",
        "speed, of the data sheet's": f"{score.speed:g}",
    }
