"""The arm that a recording shows beside the arm as measured: what it was believed to be."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from dtwin.run.prediction import BelievedArm
    from dtwin.services.service import Service


def prepare_ghost(service: Service, record: Path | None, notes: dict[str, Any]) -> None:
    """Loads the twin of the ghost, so that no rows wait for it."""
    from dtwin.run.prediction import load_kernels
    from dtwin.services.parts.readiness.preparation import prepare

    prepare(service, [("the ghost", lambda: load_kernels(believed(record, notes)))])


def believed(record: Path | None, notes: dict[str, Any]) -> BelievedArm:
    """The arm that the ghost is.

    Raises:
        ModelError: the record is none, or the notes are not those of a run.
    """
    # These load what compiles the twin, which a log alone does not need.
    from dtwin.identification.machine.record import read_record
    from dtwin.monitoring.estimation.belief import believed_arm, commissioned
    from dtwin.run.prediction import believed_by_controller

    return believed_by_controller(notes) if record is None else believed_arm(commissioned(read_record(record)))
