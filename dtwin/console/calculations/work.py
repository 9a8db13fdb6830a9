"""The process of a job: reads its task from standard input, says how far it is and the result on standard output.

Each task loads what it needs and no more: somebody at the page waits for the start, too.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import msgspec

from dtwin.console.calculations.said import say
from dtwin.console.calculations.tasks import Compare, Optimise, Simulate, Work
from dtwin.errors import DtwinError


def main() -> int:
    """Does one task; an error is said, too."""
    try:
        work = msgspec.json.decode(sys.stdin.buffer.readline(), type=Work)
        say(result=_done(work))
    except DtwinError as error:
        say(error=str(error))
    return 0


def _done(work: Work) -> dict[str, Any]:
    task = work.task
    if isinstance(task, Simulate | Optimise):
        from dtwin.console.calculations import motions

        return motions.simulated(task, work) if isinstance(task, Simulate) else motions.optimised(task, work)
    if isinstance(task, Compare):
        from dtwin.console.calculations import excited

        return excited.compared(work)
    from dtwin.console.calculations import recall

    return recall.recall(Path(work.recordings) if work.recordings else None, task)


if __name__ == "__main__":
    sys.exit(main())
