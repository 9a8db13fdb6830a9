"""What services say to each other beside the signals, and the table of all topics.

A key is `dtwin/<cell>/<arm>/<topic>`. Every message is a JSON object with `schema`; fields that a reader does not
know are ignored, but in requests for settings, of which nothing may be left out; missing or mistyped ones make it
refuse the message. docs/zenoh.md describes the same for people.
"""

from __future__ import annotations

from typing import Annotated, Final, Literal

import msgspec

from dtwin.bus.chain import messages as joints
from dtwin.bus.chain.messages import TOGETHER
from dtwin.bus.controller.messages import IdentificationSignal, SettingsInForce, SettingsRequest, SignalRequest
from dtwin.bus.line.topics import LINE_TOPICS
from dtwin.bus.proposals.messages import (
    AnswerRequest,
    Look,
    LookRequest,
    Proposal,
    ProposalDecision,
    ProposalRequest,
    RecoveryLook,
)
from dtwin.bus.topics.topic import CHECKED, Topic
from dtwin.bus.twin_messages import (
    AcknowledgeRequest,
    DeskRequest,
    DeskState,
    IdentificationDecision,
    IdentificationRequest,
    IdentificationState,
    MonitoringResiduals,
    MonitoringVerdict,
    Predicted,
    PredictionRequest,
    RollBackRequest,
    Upload,
    UploadRequest,
    WatchRequest,
    WatchState,
)
from dtwin.parameters import CellJoints
from dtwin.signals import (
    SCHEMA,
    ArmState,
    BoxCounts,
    Count,
    DriveVolts,
    Event,
    Line,
    Seconds,
    Sensors,
    Stop,
    Truth,
    Voltages,
    Word,
)

State = Literal["starting", "running", "waiting", "off", "safe", "stopped", "stopping"]
"""starting: not ready yet; waiting: for a peer; off: by somebody's wish; safe: the arm has no voltage because
commands stay away; stopped: a safe stop is in force."""

REMEMBERED: Final = 20
"""Events of a run that its supervisor remembers."""


class Latency(msgspec.Struct, frozen=True):
    """From a published sample to its command, over the run, ms; trend is the slope of the medians of its minutes."""

    p50: float
    p99: float
    max: float
    trend_per_minute: float


class Status(msgspec.Struct, frozen=True, tag_field="schema", tag=SCHEMA):
    """How a service does, once a second.

    Attributes:
        service: its name.
        state: see State.
        pid: its process.
        peers: Zenoh sessions it is joined to.
        rate_hz: rate of its main work over the last second, in ticks, answers or rows per second.
        ticks: how much of its main work it has done since it started.
        time: plant time it has reached, s.
        late_ticks: number of ticks that began or were answered too late.
        real_time_factor: plant time over wall time since it started.
        latency_ms: latency from sample to command, told by the emulator.
        boxes: what became of the boxes, told by the emulator.
        refused: messages refused, by reason.
        last_error: what went wrong last and is not over; "" for nothing.
        doing: what it does before it is ready; "" once it is.
    """

    service: Word
    state: State
    pid: Count
    peers: Count = 0
    rate_hz: float = 0.0
    ticks: Count = 0
    time: Seconds = 0.0
    late_ticks: Count = 0
    real_time_factor: float = 0.0
    latency_ms: Latency | None = None
    boxes: BoxCounts | None = None
    refused: dict[Word, Count] = {}
    last_error: Line = ""
    doing: Line = ""


class Acted(msgspec.Struct, frozen=True, gc=False, tag_field="schema", tag=SCHEMA):
    """What acted in a tick instead of the command that answers its sample.

    Such a command was late or missing, or the arm has been made safe or stopped. Nothing is published for the other
    ticks. The message of a tick comes before the next sample.

    Attributes:
        sequence: number of the sample with which the tick began.
        time: plant time of that sample, s.
        volts: voltages of joints 1 to 3 and the gripper, V.
        box_gripped: whether a box was held.
    """

    sequence: Count
    time: Seconds
    volts: DriveVolts
    box_gripped: bool


class PassedTick(msgspec.Struct, frozen=True, gc=False):
    """A tick that has passed.

    Attributes:
        sensors: sample with which it began.
        acted: what acted from then on until the next sample.
    """

    sensors: Sensors
    acted: Acted


class PassedTicks(msgspec.Struct, frozen=True, tag_field="schema", tag=SCHEMA):
    """Ticks that have passed, oldest first, for those who need all of them but none at once.

    A message ends with the tick whose number is a multiple of `TOGETHER`, or where the run ends or begins anew.
    """

    ticks: Annotated[tuple[PassedTick, ...], msgspec.Meta(min_length=1, max_length=TOGETHER)]


class Path(msgspec.Struct, frozen=True, gc=False, tag_field="schema", tag=SCHEMA):
    """The controller's path angles (rad) in the answer to a sample."""

    sequence: Count
    time: Seconds
    theta: CellJoints


BACKLOG_PAGE: Final = 100
"""Number of ticks of which the messages come in one answer."""


class BacklogRequest(msgspec.Struct, frozen=True, tag_field="schema", tag=SCHEMA):
    """Asks for what was published lately from the sample with a number on, one page of it."""

    since: Count


class SampleBacklog(msgspec.Struct, frozen=True, tag_field="schema", tag=SCHEMA):
    """What an emulator has published of up to BACKLOG_PAGE ticks, oldest first."""

    sensors: tuple[Sensors, ...]
    truths: tuple[Truth, ...]
    acted: tuple[Acted, ...]


class AnswerBacklog(msgspec.Struct, frozen=True, tag_field="schema", tag=SCHEMA):
    """What a bridge has published of up to BACKLOG_PAGE ticks, oldest first."""

    voltages: tuple[Voltages, ...]
    paths: tuple[Path, ...]


class StopRequest(msgspec.Struct, frozen=True, tag_field="schema", tag=SCHEMA):
    """A verdict on the arm, by which the blocks decide whether to stop it.

    Attributes:
        who: judges: monitoring, or an operator's name.
        why: reason in the words of who asks.
        state: state of the arm; after "angles unknown" nothing can hold it where it is.
        confidence: probability of that.
    """

    who: Word
    why: Line
    state: ArmState = "failed"
    confidence: Annotated[float, msgspec.Meta(ge=0.0, le=1.0)] = 1.0


class ReleaseRequest(msgspec.Struct, frozen=True, tag_field="schema", tag=SCHEMA):
    """An operator's word that a stopped arm may move again."""

    who: Word
    why: Line


class StopState(msgspec.Struct, frozen=True, tag_field="schema", tag=SCHEMA):
    """The stop that is in force in the blocks, at the plant time (s) of the last sample."""

    time: Seconds
    stop: Stop


class LatchRequest(msgspec.Struct, frozen=True, tag_field="schema", tag=SCHEMA):
    """A stop that the emulator shall keep until its release, or that release. The bridge alone sends it.

    Attributes:
        stop: stop that the blocks have decided on; none releases.
        number: number of the stop that is released, or under which this one is kept since; 0 for a new one.
        holder: sender of the voltages that hold the arm while it brakes and stands, in hexadecimal digits.
    """

    stop: Stop
    number: Count = 0
    holder: Annotated[Word, msgspec.Meta(pattern="^([0-9a-f]{2})*$")] = ""


class LatchState(msgspec.Struct, frozen=True, tag_field="schema", tag=SCHEMA):
    """The stop that the emulator keeps, at a plant time (s).

    Attributes:
        time: plant time, s.
        number: count of the stops so far; a release names it.
        stop: stop that is kept, or none.
    """

    time: Seconds
    number: Count
    stop: Stop


class FaultRequest(msgspec.Struct, frozen=True, tag_field="schema", tag=SCHEMA):
    """Faults in the notation of `dtwin run --fault`; those that would begin in the past begin at once."""

    faults: tuple[Line, ...]


class ResetRequest(msgspec.Struct, frozen=True, tag_field="schema", tag=SCHEMA):
    """The cell starts anew at time 0 and tick 0, with the boxes and noise of a seed."""

    seed: Count


class Done(msgspec.Struct, frozen=True, tag_field="schema", tag=SCHEMA):
    """An emulator's answer: what it did, at which plant time (s)."""

    time: Seconds
    text: Line


class ServiceSummary(msgspec.Struct, frozen=True):
    """A service as its supervisor sees it; state is that of its status, or of its process when that says more; doing
    is what a service that starts says of how far it is."""

    state: Word
    rate_hz: float
    restarts: Count
    last_error: Line
    doing: Line = ""


class Summary(msgspec.Struct, frozen=True, tag_field="schema", tag=SCHEMA):
    """A running cell at a glance: its services by name, what the emulator says of itself, what the monitor thinks of
    the arm in words, "" before it thinks anything, the last event, and the last ones, oldest first."""

    services: dict[Word, ServiceSummary]
    ticks: Count = 0
    late_ticks: Count = 0
    latency_ms: Latency | None = None
    real_time_factor: float = 0.0
    boxes: BoxCounts | None = None
    verdict: Line = ""
    last_event: Event | None = None
    events: Annotated[tuple[Event, ...], msgspec.Meta(max_length=REMEMBERED)] = ()


class SummaryRequest(msgspec.Struct, frozen=True, tag_field="schema", tag=SCHEMA):
    """Asks for nothing in particular."""


SENSORS: Final = Topic("sensors", "publication", Sensors, None, "emulator", urgent=True)
VOLTAGES: Final = Topic("voltages", "publication", Voltages, None, "bridge", urgent=True)
ACTED: Final = Topic("acted", "publication", Acted, None, "emulator", urgent=True)
TRUTH: Final = Topic("truth", "publication", Truth, None, "emulator", urgent=True)
TICKS: Final = Topic("ticks", "publication", PassedTicks, None, "emulator")
JOINT_SENSORS: Final = Topic("joints/sensors", "publication", joints.JointSensors, None, "emulator", urgent=True)
JOINT_COMMANDS: Final = Topic("joints/commands", "publication", joints.JointCommands, None, "bridge", urgent=True)
JOINT_TICKS: Final = Topic("joints/ticks", "publication", joints.JointTicks, None, "emulator")
ADJUSTED: Final = Topic("joints/adjustment", "publication", joints.JointAdjustment, None, "bridge")
EVENTS: Final = Topic("events", "publication", Event, None, "any service")
STATUS: Final = Topic("status/*", "publication", Status, None, "every service")
ALIVE: Final = Topic("alive/*", "token", None, None, "every service")
PATH: Final = Topic("path", "publication", Path, None, "bridge", urgent=True)
SETTINGS: Final = Topic("controller/settings", "query", SettingsRequest, SettingsInForce, "bridge")
SIGNAL: Final = Topic("controller/signal", "query", SignalRequest, IdentificationSignal, "bridge")
ADJUSTMENT: Final = Topic("controller/adjustment", "query", joints.JointAdjustment, joints.JointAdjustment, "bridge")
MODEL: Final = Topic("controller/model", "query", joints.JointModel, joints.JointModel, "bridge")
STOP: Final = Topic("controller/stop", "query", StopRequest, StopState, "bridge")
RELEASE: Final = Topic("controller/release", "query", ReleaseRequest, StopState, "bridge")
DESK: Final = Topic("controller/desk", "query", DeskRequest, DeskState, "bridge")
FAULT: Final = Topic("emulator/fault", "query", FaultRequest, Done, "emulator")
RESET: Final = Topic("emulator/reset", "query", ResetRequest, Done, "emulator")
LATCH: Final = Topic("emulator/stop", "query", LatchRequest, LatchState, "emulator")
SAMPLE_BACKLOG: Final = Topic("emulator/backlog", "query", BacklogRequest, SampleBacklog, "emulator")
ANSWER_BACKLOG: Final = Topic("controller/backlog", "query", BacklogRequest, AnswerBacklog, "bridge")
SUMMARY: Final = Topic("supervisor/summary", "query", SummaryRequest, Summary, "supervisor")
IDENTIFICATION: Final = Topic("twin/identification", "publication", IdentificationState, None, "identification")
IDENTIFY: Final = Topic(
    "twin/identification/start",
    "query",
    IdentificationRequest,
    IdentificationState,
    "identification",
    patience=CHECKED,
)
DECIDE: Final = Topic(
    "twin/identification/decide",
    "query",
    IdentificationDecision,
    IdentificationState,
    "identification",
    patience=CHECKED,
)
UPLOAD: Final = Topic("twin/simulation/upload", "query", UploadRequest, Upload, "simulation", patience=CHECKED)
ARM_UPLOAD: Final = Topic(
    "twin/simulation/arm", "query", joints.JointUploadRequest, joints.JointUpload, "simulation", patience=CHECKED
)
ARM_ROLL_BACK: Final = Topic(
    "twin/simulation/arm-rollback", "query", RollBackRequest, joints.JointUpload, "simulation"
)
ARM_PREDICT: Final = Topic(
    "twin/simulation/what-if", "query", joints.JointQuestion, joints.JointPredicted, "simulation", patience=CHECKED
)
PREDICT: Final = Topic(
    "twin/simulation/predict", "query", PredictionRequest, Predicted, "simulation", patience=CHECKED
)
ROLL_BACK: Final = Topic("twin/simulation/rollback", "query", RollBackRequest, Upload, "simulation", patience=CHECKED)
LOOK: Final = Topic("twin/simulation/look", "query", LookRequest, Look, "simulation")
PROPOSE: Final = Topic("twin/simulation/propose", "query", ProposalRequest, Proposal, "simulation", patience=CHECKED)
DECIDE_PROPOSAL: Final = Topic("twin/simulation/decide", "query", ProposalDecision, Proposal, "simulation")
ANSWER: Final = Topic("twin/recovery/answer", "query", AnswerRequest, Done, "recovery")
RECOVERY_LOOK: Final = Topic("twin/recovery/look", "query", LookRequest, RecoveryLook, "recovery")
RECOVERY_DECIDE: Final = Topic("twin/recovery/decide", "query", ProposalDecision, Proposal, "recovery")
MONITORING: Final = Topic("twin/monitoring/verdict", "publication", MonitoringVerdict, None, "monitoring")
ACKNOWLEDGE: Final = Topic(
    "twin/monitoring/acknowledge", "query", AcknowledgeRequest, MonitoringVerdict, "monitoring"
)
WATCH: Final = Topic("twin/monitoring/watch", "query", WatchRequest, WatchState, "monitoring")
RESIDUALS: Final = Topic("twin/monitoring/residuals", "publication", MonitoringResiduals, None, "monitoring")
TOPICS: Final = (
    *(SENSORS, VOLTAGES, ACTED, PATH, TRUTH, TICKS),
    *(JOINT_SENSORS, JOINT_COMMANDS, JOINT_TICKS, ADJUSTED, EVENTS, STATUS, ALIVE),
    *(SETTINGS, SIGNAL, ADJUSTMENT, MODEL, STOP, RELEASE, DESK),
    *(FAULT, RESET, LATCH, SAMPLE_BACKLOG, ANSWER_BACKLOG, SUMMARY),
    *(IDENTIFICATION, IDENTIFY, DECIDE, UPLOAD, PREDICT, ROLL_BACK, LOOK, PROPOSE, DECIDE_PROPOSAL, ANSWER),
    *(ARM_UPLOAD, ARM_ROLL_BACK, ARM_PREDICT, RECOVERY_LOOK, RECOVERY_DECIDE),
    *(MONITORING, RESIDUALS, ACKNOWLEDGE, WATCH),
    *LINE_TOPICS,
)
"""All there is on the bus. `*` stands for the service's name; a query's sender is who answers it."""
