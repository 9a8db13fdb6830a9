"""The commissioning of an arm, stage by stage: sensors, identification, settings of the controller, monitor."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import msgspec

from dtwin.commissioning.stages import Stages
from dtwin.controller.proposed import ProposedSettings
from dtwin.identification.machine.judged import identify_machine, record_of
from dtwin.identification.machine.load import Load, load_on, weighed
from dtwin.identification.machine.record import Healthy, MachineRecord, SensorCheck
from dtwin.identification.machine.sensors import check_sensors
from dtwin.logs.belonging import check_belonging
from dtwin.logs.log import Log
from dtwin.monitoring.calibration import watched
from dtwin.monitoring.learning.wandering import warmed
from dtwin.monitoring.offline import stream
from dtwin.parameters import ArmParameters, JointVector
from dtwin.simulation.proposal import propose
from dtwin.task import task_of

Progress = Callable[[str], None]
Angles = tuple[JointVector, ...]


class Identified(msgspec.Struct, frozen=True):
    """What the identification found.

    Attributes:
        record: the record of the machine, of which nobody has watched the healthy arm.
        measured: readings of held-out segments of motion, rad.
        predicted: what the record's machine predicts of them, rad.
    """

    record: MachineRecord
    measured: tuple[Angles, ...]
    predicted: tuple[Angles, ...]


@dataclass(frozen=True)
class Commissioned:
    """An arm that was commissioned.

    Attributes:
        record: its record.
        identified: what the identification found.
    """

    record: MachineRecord
    identified: Identified


def commission(
    stages: Stages, motion: Log, healthy: Callable[[], Log], arm: ArmParameters, source: str, progress: Progress
) -> Commissioned:
    """Commissions an arm.

    Args:
        stages: where the results of the stages are kept.
        motion: log of its work, from which it is identified.
        healthy: function that gives the log of its healthy work on which the monitor is calibrated.
        arm: arm as it was designed.
        source: description of the data.
        progress: is told in words how far a stage is.

    Raises:
        RecordingError: readings and commands do not belong together: signs, order, units or rows are wrong.
        DtwinError: the data are too few, or a result cannot be kept.
    """

    def identified() -> Identified:
        judged = identify_machine(motion, arm, progress)
        held_out = judged.held_out
        record = record_of(judged, sensors, arm, source)
        return msgspec.convert(
            {
                "record": record,
                "measured": [each.tolist() for each in held_out.measured],
                "predicted": [each.tolist() for each in held_out.predicted],
            },
            Identified,
        )

    def calibrated() -> Healthy:
        found = watched(weighed(identification.record, load), seen, progress).healthy
        assert found is not None
        return found

    progress("looking at the log")
    check_belonging(source, motion, arm)
    progress("judging the sensors")
    sensors = stages.result("sensors", SensorCheck, lambda: check_sensors(motion))
    progress("fitting the motion")
    identification = stages.result("identification", Identified, identified)
    progress("designing settings")
    settings = stages.result(
        "settings",
        ProposedSettings,
        lambda: propose(
            identification.record,
            lambda done, of: progress(f"designing settings: {done} of {of} gains"),
            task_of(motion.metadata),
        ),
    )
    work = healthy()
    if work is not motion:
        check_belonging(source, work, arm)
    progress("weighing the boxes")
    load = stages.result("load", Load, lambda: load_on(identification.record, work))
    seen = stream(work)
    progress("watching the arm")
    known = stages.result("monitor", Healthy, calibrated)
    record = weighed(identification.record, load)
    remarks = [*record.remarks, *filter(None, [warmed(known)])]
    record = msgspec.structs.replace(record, settings=settings, healthy=known, remarks=remarks)
    return Commissioned(record, identification)
