"""What a box of known mass weighs on a machine that was identified without one.

The motion of an empty arm stays the same if its masses, inertias, friction and voltage constants all have the same
factor: it tells ratios of torques, and their scale is that of the data sheet. Boxes whose mass is known tell the
scale.
"""

from __future__ import annotations

from typing import Final

import msgspec
import numpy as np

from dtwin.identification.data import Array, Experiment, from_log
from dtwin.identification.machine.judged import MOVED, SEGMENT, moving, with_states
from dtwin.identification.machine.record import USUAL_BOX, MachineRecord
from dtwin.logs.log import Log
from dtwin.twin.machine import vector_of

FEWEST: Final = 12
MOST: Final = 40
"""Numbers of segments that tell the scale."""
_SCALES: Final = (0.7, 1.4)
"""More than the tolerances of a data sheet."""
_EXACT: Final = 0.002
"""By how much the scale may be off."""
FITTING: Final = 0.15
"""By how much the scale may differ from 1: three times what the tolerances of the data sheet leave open. It was
chosen with the drawn machines 905511, 3001 and 3002 in view, and tried on 3003 with masses that are 30 % off."""


class Load(msgspec.Struct, frozen=True):
    """What a box is on a machine.

    Attributes:
        scale: mass with which it moves, as a share of the mass that it has; None if boxes were carried too little, or
            are other ones.
    """

    scale: float | None


def load_on(record: MachineRecord, log: Log) -> Load:
    """What a box is on the machine of a record.

    Of segments of motion with a box only the initial states are fitted; the scale is that with which they fit best.

    Args:
        record: what was identified without boxes.
        log: log of ordinary work, with boxes of USUAL_BOX in the mean.
    """
    from scipy.optimize import minimize_scalar  # loaded for boxes alone: takes longer than most commands

    fast = moving(from_log(log, USUAL_BOX, SEGMENT), SEGMENT, MOVED[0])
    segments = [e for e in fast if (e.payload > 0.0).all()]
    if len(segments) < FEWEST:
        return Load(None)
    chosen = segments[:: -(-len(segments) // MOST)]
    vector, noise = vector_of(record.arm, record.effects), np.array(record.unexplained)
    found = minimize_scalar(
        lambda scale: _misfit(vector, noise, chosen, scale),
        bounds=_SCALES,
        method="bounded",
        options={"xatol": _EXACT},
    )
    inside = _SCALES[0] + 2.0 * _EXACT < found.x < _SCALES[1] - 2.0 * _EXACT
    return Load(float(found.x) if inside else None)


def weighed(record: MachineRecord, load: Load) -> MachineRecord:
    """The record with what a box is on its machine, and with the grade that it deserves after that.

    Numbers that share a wrong factor predict motion without a box as well as the right ones. Where boxes tell that
    they do, the numbers are approximate at most.
    """
    found = msgspec.structs.replace(record, load=load.scale)
    if load.scale is None or abs(load.scale - 1.0) <= FITTING:
        return found
    usual = 1e3 * USUAL_BOX
    remark = (
        f"a box of {usual:.0f} g moves on these numbers like one of {load.scale * usual:.0f} g: masses of the data"
        " sheet are wrong, and the numbers share that factor, or the boxes weigh something else"
    )
    grade = "approximate" if record.grade == "identified" else record.grade
    return msgspec.structs.replace(found, grade=grade, remarks=[*record.remarks, remark])


def _misfit(vector: Array, noise: Array, segments: list[Experiment], scale: float) -> float:
    """Weighted sum of squares of what is left of segments whose boxes are so much heavier."""
    loaded = [Experiment(e.measured, e.volts, scale * e.payload) for e in segments]
    return with_states(vector, noise, loaded)[1].normal.cost
