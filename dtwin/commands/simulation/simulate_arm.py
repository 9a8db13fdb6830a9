"""`dtwin simulate --arm NAME`: what if any other arm did its work with other settings, on its twin?"""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from rich.table import Column, Table

from dtwin.api.arms import ArmAtWork
from dtwin.arm.chain import Arm
from dtwin.commands.frame import arguments_as_options
from dtwin.errors import ParameterError
from dtwin.options import refuse_others
from dtwin.run.arm_cell import ArmCell
from dtwin.simulation.chain.whatif import ArmChange, ArmOutcome
from dtwin.terminal import as_text, print_json, print_table

_CHANGES: Final = ("pole", "observer", "speed", "payload")
_KNOWN: Final = ("arm", "poses", "path", "sort", "duration", "seed", "candidate", "json", *_CHANGES)
"""Options that mean something for any arm."""
_USUAL: Final = 8.0
"""Length of the work if no other is given, s."""


def simulate_other(options: Any) -> int:
    """Lets the twin work with what is asked for and with every candidate, and prints how it did.

    Args:
        options: those of `dtwin simulate`.

    Raises:
        DtwinError: an option has no meaning for this arm or is out of range, or a file cannot be used.
    """
    refuse_others(options, _KNOWN, ("arm",))
    base = {name: value for name in _CHANGES if (value := getattr(options, name)) is not None}
    cases = {"base": base, **{text: {**base, **_changes(text)} for text in options.candidate}}
    cell = ArmCell(arm=options.arm, poses=options.poses, path=options.path, sort=options.sort)
    duration = _USUAL if options.duration is None else options.duration
    outcomes, seconds = {}, {}
    with arguments_as_options(options):
        twin = ArmAtWork(cell, duration, options.seed)
        for name, changes in cases.items():
            began = time.perf_counter()
            outcomes[name] = twin.under(ArmChange(**changes))
            seconds[name] = time.perf_counter() - began
    if options.json:
        print_json({"candidates": [_figures(name, outcomes[name], seconds[name]) for name in outcomes]})
    else:
        print_table(_table(twin.arm, outcomes, seconds))
    return 0


def _changes(text: str) -> dict[str, float]:
    """What a candidate such as "pole=10 payload=0.3" says. Raises ParameterError: it cannot be read."""
    found = {}
    for word in text.replace(",", " ").split():
        name, _, value = word.partition("=")
        try:
            found[name] = float(value)
        except ValueError:
            found[name] = np.nan
        if name not in _CHANGES or not np.isfinite(found[name]):
            raise ParameterError(
                f"--candidate {text!r}: expected a number for pole, observer, speed or payload, e.g. pole=10, "
                f"got {word!r}"
            )
    return found


def _figures(name: str, one: ArmOutcome, seconds: float) -> dict[str, Any]:
    return {
        "name": name,
        "tracking_max": np.abs(one.error).max(axis=0).tolist(),
        "tracking_rms": np.sqrt((one.error**2).mean(axis=0)).tolist(),
        "command_max": np.abs(one.command).max(axis=0).tolist(),
        "saturated": one.saturated.tolist(),
        "reached": one.reached,
        "stop": one.stop,
        "seconds": seconds,
    }


def _table(arm: Arm, outcomes: Mapping[str, ArmOutcome], seconds: Mapping[str, float]) -> Table:
    """A column for each case; distances in mrad or mm, commands in per cent of what the drives take."""
    names = (Column(as_text(name)) for name in outcomes)
    table = Table(Column("", no_wrap=True), *names, title="what if, on the chain's twin with its function blocks")
    for k, joint in enumerate(arm.joints):
        unit = "mrad" if joint.turns else "mm"
        far = (f"{1e3 * np.abs(one.error[:, k]).max():.2f}" for one in outcomes.values())
        table.add_row(as_text(f"{joint.name}, farthest from its path, {unit}"), *far)
    for k, joint in enumerate(arm.joints):
        most = (
            f"{100.0 * np.abs(one.command[:, k]).max():.0f} %"
            + (f", {one.saturated[k]:.2f} s at it" if one.saturated[k] else "")
            for one in outcomes.values()
        )
        table.add_row(as_text(f"{joint.name}, largest command"), *most)
    table.add_row("poses reached", *(str(one.reached) for one in outcomes.values()))
    table.add_row("safe stop", *(str(one.stop) if one.stop else "none" for one in outcomes.values()))
    table.add_row("computed in", *(f"{1e3 * value:.1f} ms" for value in seconds.values()))
    return table
