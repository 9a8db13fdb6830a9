"""What a page is told: a frame twenty times a second, and the state of the cell whenever it changes."""

from __future__ import annotations

from typing import Literal

import msgspec

from dtwin.bus.chain.shapes import JointShape
from dtwin.bus.messages import Latency
from dtwin.bus.proposals.messages import Proposal
from dtwin.bus.twin_messages import IdentificationState, MonitoringVerdict, Upload, WatchState
from dtwin.console.line.faces import LineFace
from dtwin.signals import BoxCounts, Event, Stop
from dtwin.task import PICKUP_NAME, Task

Values = tuple[float, ...]
"""One number for each joint."""
Kind = Literal["service", "finding", "stop", "trial", "stale"]
"""Kinds of abnormal conditions."""


class Frame(msgspec.Struct, frozen=True, gc=False, tag_field="tell", tag="frame"):
    """The arm at one sample, and what the monitor said last, which may be up to ten samples older.

    Attributes:
        time: plant time of the sample, s.
        age: time since the sample arrived here, s; None before the first one.
        heard: wall time at which the sample arrived here, ms since 1970.
        theta: measured positions, rad or m.
        path: positions on the controller's path, rad or m; None while nobody asks for it.
        volts: commands of the drives, in their own units; of the thesis's arm also the voltage of the gripper, V.
        gripper: measured angle of the gripper, rad.
        gripped: whether the controller holds a box.
        box: colour of the box that waits, "" for none.
        predicted: angles that the monitor expected of its last sample, rad.
        residual: reading minus prediction of that sample, rad.
        deviation: standard deviation of a healthy arm's residuals, rad.
        evidence: evidence of a sudden change, 2 log likelihood ratio.
        threshold: evidence from which on a change is diagnosed.
    """

    time: float = 0.0
    age: float | None = None
    heard: float = 0.0
    theta: Values | None = None
    path: Values | None = None
    volts: Values | None = None
    gripper: float = 0.0
    gripped: bool = False
    box: str = ""
    predicted: Values | None = None
    residual: Values | None = None
    deviation: Values | None = None
    evidence: float | None = None
    threshold: float | None = None


class Health(msgspec.Struct, frozen=True):
    """How a service does.

    Attributes:
        state: state that the service or its supervisor tells; gone when nobody tells of it any more.
        reason: last thing that went wrong, "" for nothing.
        rate_hz: rate of its main work, 1/s.
        restarts: number of its restarts.
        here: whether its token is there.
    """

    state: str
    reason: str = ""
    rate_hz: float = 0.0
    restarts: int = 0
    here: bool = True


class Spot(msgspec.Struct, frozen=True):
    """A place of the cell as it is drawn: where it is (m, from joint 1) and its colour as #rrggbb, "" for none."""

    x: float
    y: float
    rgb: str = ""


def spots(task: Task) -> dict[str, Spot]:
    """The places of a task by their names, the pickup point first."""
    found = {PICKUP_NAME: Spot(task.pickup.x, task.pickup.y)}
    for each in task.destinations:
        found[each.colour] = Spot(each.place.x, each.place.y, "#{:02x}{:02x}{:02x}".format(*each.rgb))
    return found


class ModelFace(msgspec.Struct, frozen=True):
    """The newest entry in the history of an arm's settings; the attributes are those of `JointUpload`."""

    version: int
    time: float
    action: str
    text: str
    on_trial: bool
    predicted: Values | None = None
    measured: Values | None = None


class Condition(msgspec.Struct, frozen=True):
    """Something abnormal that is so now.

    Attributes:
        key: name that stays the same while the condition lasts, such as `finding joint 2`.
        kind: what the condition is about.
        text: the condition in words.
        severe: whether the arm is stopped, has failed or is not controlled.
    """

    key: str
    kind: Kind
    text: str
    severe: bool = False


class CellState(msgspec.Struct, frozen=True, tag_field="tell", tag="state"):
    """All of a cell that changes seldom.

    Attributes:
        cell: name of the cell.
        arm: name of the arm.
        doing: what the arm does, in one line.
        stop: safe stop in force.
        services: health of the services by name.
        ticks: number of ticks of the emulator.
        late_ticks: number of ticks without a command in time.
        real_time_factor: plant time over wall time.
        latency_ms: latency from sample to command.
        boxes: what became of the boxes.
        verdict: last word of the monitor, with all units unknown when it is too old; None when nobody watches.
        watch: whether the monitor watches, and what with; None without one.
        identification: state of the identification; None without that service.
        settings: settings in force; None without the simulation service.
        proposals: the newest proposals of recovery and of an AI, oldest first.
        places: places of the cell by name.
        events: last events, oldest first.
        conditions: what is abnormal now, the gravest first.
        joints: the joints of another arm than the thesis's from the base on.
        tool: its tool in the frame of the last link, (3,), m.
        points: where its boxes wait and belong, by name, (3,), m, in the frame of the base.
        model: the model by which its blocks reckon; None without the simulation service.
        line: the line that this is; None for a cell.
    """

    cell: str
    arm: str
    doing: str = ""
    stop: Stop = "none"
    services: dict[str, Health] = {}
    ticks: int = 0
    late_ticks: int = 0
    real_time_factor: float = 0.0
    latency_ms: Latency | None = None
    boxes: BoxCounts | None = None
    verdict: MonitoringVerdict | None = None
    watch: WatchState | None = None
    identification: IdentificationState | None = None
    settings: Upload | None = None
    proposals: tuple[Proposal, ...] = ()
    places: dict[str, Spot] = {}
    events: tuple[Event, ...] = ()
    conditions: tuple[Condition, ...] = ()
    joints: tuple[JointShape, ...] = ()
    tool: Values = ()
    points: dict[str, Values] = {}
    model: ModelFace | None = None
    line: LineFace | None = None
