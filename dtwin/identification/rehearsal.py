"""Identifies the data sheet's arm from motions of its own twin, so that every kernel that this takes is compiled.

A process that only waits for an identification lets another one do this, `python -m dtwin.identification.rehearsal`:
the compiled kernels stay on disk, and the memory that it took does not stay with the one that waits. The name of each
kernel that is compiled is printed when that begins, one a line.
"""

from __future__ import annotations

from typing import Final

from dtwin.identification.data import Experiment, Start
from dtwin.identification.excitation.plan import PLAIN, Plan
from dtwin.identification.operating_data import PIECES
from dtwin.identification.parsing import settings_for
from dtwin.identification.running import estimate_excited, estimate_from
from dtwin.parameters import HOME, ArmParameters
from dtwin.twin.compiled import compilations
from dtwin.twin.rollout import rollout

_FREE: Final = "D1"
"""Parameter that is estimated; which one does not matter to what is compiled."""


def rehearse() -> None:
    """Goes once through an identification from a signal and one from motions, without use for what comes out."""
    experiment, settings = _experiment(), settings_for(_FREE)
    estimate_excited(experiment, settings)
    estimate_from([experiment] * PIECES, settings, "a rehearsal")


def _experiment() -> Experiment:
    """The standard experiment with the data sheet's arm, whose start the estimation does not know."""
    plan = Plan(start=Start(HOME, known=False))
    states = rollout(ArmParameters(), [*HOME, 0.0, 0.0, 0.0], PLAIN.volts(), plan.payload, payload_model="weight")
    return plan.experiment(states[:-1, :3])


def main() -> None:
    """Rehearses, and prints what is compiled."""
    with compilations(lambda kernel: print(kernel, flush=True)):
        rehearse()


if __name__ == "__main__":
    main()
