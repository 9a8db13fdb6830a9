"""The cell of another arm than the thesis's: which arm it is, what it really is, and what it does.

arm = "six-axis"           # a name of arms/, its file or its model
machine = "nominal"        # ideal, nominal, a number or a machine's file
sort = "sort.toml"         # or poses or path; files beside this one
late = 1                   # ticks from a command until it acts
faults = ["K2*=0.8@30"]    # what is otherwise, and when
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import msgspec
import numpy as np

from dtwin.arm.chain import Arm
from dtwin.arm.poses import Poses, drawn_poses, read_poses
from dtwin.arm.sorting import read_sorting
from dtwin.emulation.chain.arms import arm_of
from dtwin.emulation.chain.faults import parse_chain_fault
from dtwin.emulation.chain.machine import IDEAL, machine_of, told
from dtwin.emulation.generators import check_seed
from dtwin.errors import ModelError, ParameterError, choices
from dtwin.run.cell_file import content_of
from dtwin.run.chain import ChainSettings, sorting_poses
from dtwin.run.following import read_path
from dtwin.run.margins.gears import control_of
from dtwin.run.reserve import with_reserve

LONGEST: Final = 86_400.0
"""Longest run, s: all its ticks are kept in memory."""
_DRAWN: Final = 6
"""Number of poses that are drawn where none are given."""
_MOST_LATE: Final = 10


@dataclass(frozen=True, slots=True, kw_only=True)
class ArmCell:
    """A cell.

    Attributes:
        arm: a name of arms/, an arm's file or its model.
        machine: ideal, nominal, a number or a machine's file.
        poses: file of the poses that the arm takes.
        path: file of a path that it follows.
        sort: file of a sorting task. Without any of the three it goes through poses that are drawn.
        late: ticks from a command until it acts.
        faults: what is otherwise than the machine says, and when (dtwin.emulation.chain.faults).
    """

    arm: str
    machine: str = IDEAL
    poses: Path | None = None
    path: Path | None = None
    sort: Path | None = None
    late: int = 0
    faults: tuple[str, ...] = ()

    def settings(self, duration: float, seed: int = 0) -> ChainSettings:
        """The run of this cell.

        Args:
            duration: longest plant time, s.
            seed: number of the generators of noise, boxes and poses.

        Raises:
            DtwinError: a file cannot be used, or a value is out of range.
        """
        check_seed(seed)
        if not 0 <= self.late <= _MOST_LATE:
            raise ParameterError(f"late: expected 0 to {_MOST_LATE} ticks, got {self.late}")
        if not 0.0 < duration <= LONGEST:
            raise ParameterError(f"duration: expected above 0 and at most {LONGEST:g} s, got {duration:g}")
        if sum(each is not None for each in (self.sort, self.poses, self.path)) > 1:
            raise ParameterError("sort, poses and path: expected one of them")
        arm = told(self.machine, arm_of(self.arm))
        sorting = None if self.sort is None else read_sorting(self.sort)
        if sorting is not None:
            poses = sorting_poses(arm, sorting)
            arm = with_reserve(arm, poses, sorting.mass[1])
        else:
            poses = poses_for(arm, self.poses, seed) if self.path is None else read_path(self.path, arm)
        control = control_of(arm, self.late)
        machine = machine_of(self.machine, arm)
        faults = tuple(parse_chain_fault(text, len(arm)) for text in self.faults)
        return ChainSettings(arm, machine, poses, control, duration, seed, self.late, sorting=sorting, faults=faults)


def poses_for(arm: Arm, file: Path | None, seed: int) -> Poses:
    """The poses of a file, or some that are drawn from the ranges of the joints, again and again.

    Raises:
        ParameterError: the file cannot be used.
    """
    if file is not None:
        return read_poses(file, arm)
    drawn = drawn_poses(arm, _DRAWN, np.random.default_rng(seed))
    return Poses(drawn.positions, 0.3, True)


class _File(msgspec.Struct, forbid_unknown_fields=True):
    arm: str
    machine: str = IDEAL
    poses: str | None = None
    path: str | None = None
    sort: str | None = None
    late: int = 0
    faults: tuple[str, ...] = ()


def arm_cell_of(text: str) -> ArmCell | None:
    """The cell of another arm that a name or file stands for; None for a cell of the thesis's arm.

    Raises:
        ModelError: the file cannot be read, or has other keys.
    """
    file, content = content_of(text)
    if not isinstance(content.get("arm"), str):
        return None
    try:
        found = msgspec.convert(content, _File)
    except msgspec.ValidationError as error:
        keys = choices(_File.__struct_fields__)
        raise ModelError(f"{file}: expected the cell of another arm, with the keys {keys}: {error}") from None
    beside = {name: getattr(found, name) for name in ("poses", "path", "sort")}
    paths = {name: None if each is None else file.parent / each for name, each in beside.items()}
    own = file.parent / found.arm
    arm = str(own) if own.suffix in (".toml", ".urdf", ".xml", ".mjcf") else found.arm
    machine = str(file.parent / found.machine) if found.machine.endswith(".toml") else found.machine
    return ArmCell(arm=arm, machine=machine, late=found.late, faults=found.faults, **paths)
