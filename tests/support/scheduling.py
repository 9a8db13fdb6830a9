"""Which worker runs which tests: two take those that wait for other processes; others fill the gaps.

Those others run at a low priority, so that they take no processor from a cell that runs in real time, or from a
device that has to answer in time.
"""

from __future__ import annotations

import os
from typing import Final

from xdist.scheduler import LoadFileScheduling
from xdist.workermanage import WorkerController

WAITERS: Final = ("gw0", "gw1")
"""Names of the workers that wait."""
_PRIORITY: Final = 10
_WAITING: Final = (
    "tests/api/test_live.py",
    "tests/bus/",
    "tests/campaign/",
    "tests/commands/",
    "tests/commissioning/test_collection.py",
    "tests/console/",
    "tests/controller/",
    "tests/experiments/test_soak.py",
    "tests/iec61499/deploy/",
    "tests/iec61499/device/",
    "tests/iec61499/management/",
    "tests/iec61499/net/",
    "tests/interop/",
    "tests/services/",
    "tests/simulation/test_history.py",
    "tests/test_cells_page.py",
    "tests/view/test_viewer.py",
)
"""Beginnings of the names of the files whose tests wait for other processes."""


def give_way() -> None:
    """Lowers the priority of this process if it is a worker that fills the gaps."""
    if os.environ.get("PYTEST_XDIST_WORKER", WAITERS[0]) not in WAITERS and hasattr(os, "nice"):
        os.nice(_PRIORITY)


class Scheduling(LoadFileScheduling):
    """Files in the order of their names, those that wait first; workers that fill gaps get none of those."""

    def _assign_work_unit(self, node: WorkerController) -> None:
        """Gives a worker its next file, or none any more."""
        waits = node.gateway.id in WAITERS
        kind = [scope for scope in self.workqueue if scope.startswith(_WAITING) == waits]
        if kind:
            self.workqueue.move_to_end(kind[0], last=False)
        elif not waits:
            node.shutdown()
            return
        super()._assign_work_unit(node)
