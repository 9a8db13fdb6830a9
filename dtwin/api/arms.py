"""Any serial arm under its function blocks, from Python."""

from __future__ import annotations

from pathlib import Path

from dtwin.api.arguments import AnyPath, checked
from dtwin.run.arm_cell import ArmCell
from dtwin.run.chain import ChainRun, run


@checked
def run_arm(
    arm: AnyPath,
    seconds: float = 60.0,
    *,
    machine: str = "ideal",
    poses: AnyPath | None = None,
    path: AnyPath | None = None,
    sort: AnyPath | None = None,
    seed: int = 0,
    late: int = 0,
) -> ChainRun:
    """Runs an arm under its function blocks, as fast as the machine allows.

    Args:
        arm: a name of arms/, an arm's file (*.toml) or a model (*.urdf, *.xml).
        seconds: longest plant time, s; the run ends earlier when nothing is left to do.
        machine: ideal, nominal or a number.
        poses: TOML file of the poses that the arm takes.
        path: CSV file of a path that it follows.
        sort: TOML file of a sorting task; without any of the three it goes through poses that are drawn by the seed.
        seed: number of the generators of noise, boxes and poses.
        late: ticks from a command until it acts.

    Returns:
        The run: t (N,), q, target, command and true (N, n), `score()`, `save(path)` and `measurement()` for
        `identify_chain`.

    Raises:
        DtwinError: a file cannot be used, a value is out of range, or the tool does not reach a point.
    """
    files = [None if each is None else Path(each) for each in (poses, path, sort)]
    cell = ArmCell(arm=str(arm), machine=machine, poses=files[0], path=files[1], sort=files[2], late=late)
    return run(cell.settings(seconds, seed))
