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
    "tests/evidence/test_soak.py",
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
_LONGEST: Final = (
    "tests/test_arms_page.py",
    "tests/services/test_tutorial.py",
    "tests/services/test_other_arm.py",
    "tests/console/test_tasks.py",
    "tests/line/test_other_arms.py",
    "tests/monitoring/test_calibration.py",
)
"""Files that take longest, which come first: the last one of all would keep one worker busy while others idle."""


def give_way() -> None:
    """Lowers the priority of this process if it is a worker that fills the gaps."""
    if os.environ.get("PYTEST_XDIST_WORKER", WAITERS[0]) not in WAITERS and hasattr(os, "nice"):
        os.nice(_PRIORITY)


class Scheduling(LoadFileScheduling):
    """Files in the order of their names, the longest first, those that wait first; workers that fill gaps get none of
    those."""

    def _assign_work_unit(self, node: WorkerController) -> None:
        """Gives a worker its next file, or none any more."""
        waits = node.gateway.id in WAITERS
        kind = [scope for scope in self.workqueue if scope.startswith(_WAITING) == waits]
        if kind:
            chosen = next((scope for scope in kind if scope.startswith(_LONGEST)), kind[0])
            self.workqueue.move_to_end(chosen, last=False)
        elif not waits:
            node.shutdown()
            return
        super()._assign_work_unit(node)
