"""`dtwin health`."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro
from rich.console import Console
from rich.table import Table

from dtwin.api.health import servo_health
from dtwin.health.servo import Estimate
from dtwin.measurements.page import summary
from dtwin.terminal import as_text, print_json, print_table


@dataclass(frozen=True)
class HealthCommand:
    """Tell the health of a position-controlled arm, such as a LeRobot arm: delay, errors at rest, drift, overload.

    It takes commands and positions alone, and says what they cannot tell.
    """

    log: Annotated[Path, tyro.conf.Positional]
    """Folder of a LeRobot data set, or a log as `dtwin log show` reads it."""
    columns: Path | None = None
    """TOML file that says what the columns mean; guessed if not given."""
    json: bool = False
    """Print one JSON object on standard output and nothing else."""

    def execute(self) -> int:
        found = servo_health(self.log, columns=self.columns)
        if self.json:
            print_json(
                {"joints": [asdict(joint) for joint in found.joints], "findings": found.findings, "odd": found.odd}
            )
            return 0
        console = Console(highlight=False, soft_wrap=True)
        for line in summary(found.log):
            console.print(as_text(line))
        table = Table("joint", "delay, ms", "gain", "error at rest, deg", "up - down, deg", "drift, deg")
        for joint in found.joints:
            angles = (_text(estimate, 180.0 / np.pi) for estimate in (joint.at_rest, joint.width, joint.drift))
            table.add_row(joint.name, _text(joint.delay, 1e3), _text(joint.gain, 1.0), *angles)
        print_table(table)
        for line in (*found.odd, *found.findings):
            console.print(as_text(line))
        return 0


def _text(estimate: Estimate | None, factor: float) -> str:
    if estimate is None:
        return "not told"
    half = f"+- {factor * estimate.half:.2g}" if np.isfinite(estimate.half) else "+- ?"
    return f"{factor * estimate.value:.3g} {half}"
