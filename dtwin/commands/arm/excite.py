"""`dtwin arm excite`: poses from whose motion an arm is identified."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from dtwin.arm.poses import poses_text
from dtwin.commands.frame import at_least, progress_bar
from dtwin.emulation.chain.arms import arm_of
from dtwin.files import ensure_writable, replacing
from dtwin.identification.chain.excitation import excitation
from dtwin.names import counted
from dtwin.terminal import printable


@dataclass(frozen=True)
class ArmExcite:
    """Design poses whose motion tells most of an arm, within its ranges and what its drives can give."""

    arm: Annotated[str, tyro.conf.Positional]
    """Name of arms/, file of an arm (*.toml), or a model (*.urdf, *.xml)."""
    out: Path = Path("poses.toml")
    """TOML file to write, for dtwin run --poses."""
    duration: float = 60.0
    """Length of the motion, s, at most."""
    candidates: int = 30
    """Number of motions that are compared."""
    seed: int = 0
    """Number of the generator that draws them."""

    def execute(self) -> int:
        ensure_writable(self.out, ".toml")
        at_least("--duration", self.duration, 2.0)
        at_least("--candidates", self.candidates, 1)
        at_least("--seed", self.seed, 0)
        arm = arm_of(self.arm)
        with progress_bar("comparing motions") as progress:
            poses = excitation(arm, self.duration, self.candidates, self.seed, progress)
        with replacing(self.out, ".toml") as temporary:
            temporary.write_text(poses_text(poses))
        print(printable(f"{self.out}: {counted(len(poses.positions), 'pose')} for {arm.name}"))
        return 0
