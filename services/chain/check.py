"""Checks the options of a cell of another arm in a process that ends again, so that its starter loads no MuJoCo."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from dtwin.arm.chain import without_servos
from dtwin.controller.chain.application import inputs
from dtwin.equations.rigid import usual_inertia
from dtwin.services.chain.options import ArmCellOptions
from dtwin.services.service import main

NAME: Final = "check"


@dataclass(frozen=True, kw_only=True)
class Options(ArmCellOptions):
    """Make the arm of the options and the values of its blocks, without running it."""

    identified: bool = False
    """Whether it is identified while it runs."""
    commissioned: Path | None = None
    """Record of the healthy arm."""

    def run(self) -> int:
        settings = self.settings()
        if self.identified:
            without_servos(settings.arm, "--identification")
        if self.commissioned is not None:
            from dtwin.monitoring.chain.record import read_arm_record  # loads SciPy

            read_arm_record(self.commissioned, settings.arm)
        inputs(settings.arm, usual_inertia(settings.arm), settings.control, settings.poses)
        return 0


if __name__ == "__main__":
    sys.exit(main(NAME, Options))
