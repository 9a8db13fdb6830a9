"""`dtwin fb make`: the function blocks of an arm."""

from __future__ import annotations

import contextlib
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Final

import tyro

from dtwin.arm.poses import read_poses
from dtwin.controller.chain.application import LIBRARY, Devices, inputs, network, system
from dtwin.emulation.chain.arms import arm_of
from dtwin.equations.rigid import usual_inertia
from dtwin.errors import ParameterError
from dtwin.files import ensure_writable, replacing
from dtwin.names import counted
from dtwin.run.following import read_path
from dtwin.run.margins.gears import control_of
from dtwin.terminal import printable
from iec61499.deploy.system_file import system_text

TYPES: Final = (
    *("POSE_SEQUENCE", "CHAIN_JOINT", "JOINT_READING", "JOINT_OBSERVER", "JOINT_BRAKE", "JOINT_PATH"),
    *("JOINT_FEEDBACK", "CHAIN_LINK", "JOINT_DRIVE", "SAFE_STOP"),
)
"""The block types of the library that an application uses."""


@dataclass(frozen=True)
class FbMake:
    """Make the application of function blocks that controls an arm: a system for 4diac IDE, FORTE and `dtwin fb run`.

    The block types are put beside it, so that its folder, which is made if it is not there, is whole.
    """

    arm: Annotated[str, tyro.conf.Positional]
    """Name of arms/, file of an arm (*.toml), or a model (*.urdf, *.xml)."""
    out: Annotated[Path, tyro.conf.Positional]
    """System file (.sys) to write."""
    poses: Path | None = None
    """TOML file of the poses that the arm takes (docs/arms.md); without it the arm stays where it is."""
    path: Path | None = None
    """CSV file of a path that it follows instead."""
    devices: Devices = "one"
    """One device for all blocks; or one for every joint, and a first one that leads them (docs/devices.md)."""
    late: bool = False
    """Reckon with commands that act one sample late, as between services and over networks."""

    def execute(self) -> int:
        arm = arm_of(self.arm)
        if self.poses is not None and self.path is not None:
            raise ParameterError("--poses and --path: expected one of them")
        poses = None if self.poses is None else read_poses(self.poses, arm)
        poses = poses if self.path is None else read_path(self.path, arm)
        control = control_of(arm, int(self.late))
        values = inputs(arm, usual_inertia(arm), control, poses)
        with contextlib.suppress(OSError):  # what cannot be made is told as what cannot be written
            self.out.parent.mkdir(parents=True, exist_ok=True)
        ensure_writable(self.out, ".sys")
        types = _types(self.out.absolute().parent)
        for path, content in types.items():
            with replacing(path) as temporary:
                temporary.write_bytes(content)
        with replacing(self.out, ".sys") as temporary:
            temporary.write_text(
                system_text(system(self.out.stem, network(len(arm), self.devices), values, self.devices))
            )
        count = f"{len(arm) + 1} devices, " if self.devices == "joints" else ""
        print(
            printable(
                f"{self.out}: {counted(len(arm), 'joint')} of {arm.name}, {count}{len(types)} block types beside it"
            )
        )
        return 0


def _types(folder: Path) -> dict[Path, bytes]:
    """The files of block types that the folder lacks.

    Raises:
        ParameterError: it has another type of the same name.
    """
    if folder.is_relative_to(LIBRARY.absolute()):
        return {}
    missing = {}
    for name in TYPES:
        source = next(path for path in sorted(LIBRARY.rglob("*.fbt")) if path.stem == name)
        target = folder / source.name
        if not target.exists():
            missing[target] = source.read_bytes()
        elif target.read_bytes() != source.read_bytes():
            raise ParameterError(f"{target}: expected the block type of {source}: take another folder, or remove it")
    return missing
