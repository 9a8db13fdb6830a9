"""`dtwin monitor acknowledge`: the operator knows what the monitoring service has found."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import tyro
from rich.console import Console

from dtwin.bus.messages import ACKNOWLEDGE
from dtwin.bus.twin_messages import AcknowledgeRequest, MonitoringVerdict
from dtwin.commands.monitoring.monitor import print_states
from dtwin.services.runfile import join
from dtwin.terminal import print_json


@dataclass(frozen=True)
class MonitorAcknowledge:
    """Take the running arm as it is now to be normal: what was found is struck out, only further change is reported.

    A changed constant, friction or offset is measured from its present value on, a locked joint or a stopped encoder
    is reported again after it has worked. What has no known cause comes back if it shows again. A monitoring service
    that starts anew has forgotten it. The cell must have been started with `dtwin up --monitoring`.
    """

    parameter: tyro.conf.Positional[str] = ""
    """Parameter of one finding, as `dtwin watch twin/monitoring/verdict` shows it, e.g. K2; all if not given."""
    cell: str = "cell"
    """Name of the cell."""
    zenoh: Path | None = None
    """Zenoh configuration file, for a cell on another machine."""
    json: bool = False
    """Print one JSON object on standard output and nothing else."""

    def execute(self) -> int:
        with join(self.cell, self.zenoh) as bus:
            verdict = bus.ask(ACKNOWLEDGE, AcknowledgeRequest(self.parameter), MonitoringVerdict)
        if self.json:
            print_json(verdict)
            return 0
        print_states(Console(highlight=False, soft_wrap=True), verdict, [found.text for found in verdict.findings])
        return 0
