"""The application of function blocks that controls a serial arm: one CHAIN_JOINT for each joint.

    ARM --> SEQUENCE --> JOINT_1 --> ... --> JOINT_n          outward: the desired motion of every link
                         JOINT_1 <-- ... <-- JOINT_n          inward: forces, torques and commands
                            +--> ARM, and STOP, which watches errors and speeds
    TWIN --> JOINT_1, ..., JOINT_n                               what was found of the joints

One event runs through it for every sample. The network depends on the number of joints alone; everything else about
an arm and its task are values of inputs.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, Final, Literal

import numpy as np

from dtwin.arm.chain import Arm, Array, aligned
from dtwin.arm.model import USUAL_OBSERVER, USUAL_POLE, ArmTuning
from dtwin.arm.poses import Poses
from dtwin.controller.chain.encoders import DOUBTED, belief
from dtwin.controller.chain.joints import WIDE, XYZ, brake, drive, link, points, servo_gains
from dtwin.controller.ports import BLOCKS
from iec61499 import model
from iec61499.mapping import literal_of
from iec61499.net.wire import Signature
from iec61499.types import BOOL, DINT, LREAL

ARM: Final = "ARM"
"""Name of the block that talks with the arm."""
SEQUENCE: Final = "SEQUENCE"
STOP: Final = "STOP"
SWITCH: Final = "STOPPED"
VERDICT: Final = "VERDICT"
PORT: Final = 61500
"""Port of the block ARM."""
VERDICT_PORT: Final = 61506
"""Port for verdicts of a monitor, and for releases."""
TWIN: Final = "TWIN"
"""Name of the block by which the twin says what it has found of the joints."""
TWIN_PORT: Final = 61507
APPLICATION: Final = "ARM_CONTROL"
"""Name of the application in a system."""
LIBRARY: Final = BLOCKS
"""Folder of the block types."""
_DEVICE: Final = "FORTE_PC"
_RESOURCE: Final = "EMB_RES"
_VERSION: Final = model.Version("1.0", "dtwin", "2026-11-27", "dtwin", "Made by dtwin fb make")
_SHARED: Final = ("INDEX", "ELAPSED", "T", "RATE", "CHANGE", "OFF", "STANDING")
"""What SEQUENCE tells every joint."""
_OUTWARD: Final = tuple(f"{what}{x}" for what in "WOA" for x in XYZ)
_INWARD: Final = tuple(f"{what}{x}" for what in "FN" for x in XYZ)
JOINT: Final = "CHAIN_JOINT"
"""Type of the block of a joint."""
Devices = Literal["one", "joints"]
_FURTHER: Final = 61_600
"""Port of the management of the first further device, less 1."""
_COLUMN: Final = 3000.0
"""From one drawn block to the next, in the units of 4diac IDE."""


@dataclass(frozen=True, slots=True)
class Control:
    """How an arm is controlled.

    Attributes:
        pole: triple pole of the errors of every joint, rad/s.
        observer: double pole of the observers, rad/s.
        delay: time from a sample until its command acts that the blocks reckon with, s.
        following: largest distance of a joint from its path, rad or m, beyond which the arm is stopped.
        speed: speeds of the paths in parts of the joints'; accelerations follow with its square.
    """

    pole: float = USUAL_POLE
    observer: float = USUAL_OBSERVER
    delay: float = 0.0
    following: float = 0.5
    speed: float = 1.0

    @property
    def gains(self) -> tuple[float, float, float]:
        """KP (1/s^2), KI (1/s^3) and KD (1/s) of the triple pole."""
        return 3.0 * self.pole**2, self.pole**3, 3.0 * self.pole

    @property
    def tuning(self) -> ArmTuning:
        """What of it can be changed while the blocks run."""
        return ArmTuning(self.pole, self.observer, self.speed)

    def tuned(self, tuning: ArmTuning) -> Control:
        """The same with another tuning."""
        return replace(self, pole=tuning.pole, observer=tuning.observer, speed=tuning.speed)


BLIND: Final = 0.03
"""Distance of a standing joint from its place, rad or m, beyond which an arm in doubt loses its torque."""


def first_doubted(counts: Sequence[float]) -> int:
    """Number of the first joint, from 1, that is doubted, from the outputs DOUBT of all joints; 0 for none.

    Each output is the largest count of its joint and those before.
    """
    return next((k for k, count in enumerate(counts, 1) if count > DOUBTED), 0)


def joint_name(number: int) -> str:
    """Name of the block of a joint, counted from 0."""
    return f"JOINT_{number + 1}"


def messages(joints: int) -> tuple[Signature, Signature]:
    """Layouts of the messages to ARM, positions and the place of the box that waits, and of its answers.

    An answer has the commands, whether the gripper is closed, and whether the brake of each joint is engaged.
    """
    return Signature([*[LREAL] * joints, DINT]), Signature([*[LREAL] * joints, BOOL, *[BOOL] * joints])


ADJUSTED: Final = ("OFFSET", "STRENGTH", "FRICTION")
"""What the twin says of every joint."""


def adjustment(joints: int) -> Signature:
    """Layout of the message to TWIN: offset, strength and friction of every joint, and the further load."""
    return Signature([LREAL] * (len(ADJUSTED) * joints + 1))


def network(joints: int, devices: Devices = "one") -> model.FBNetwork:
    """The network of an arm with that many joints, without values; ports are those of the library.

    Where every joint has a device of its own, what comes to it from SEQUENCE and from the joint before takes two
    ways, of which either may be the longer one. A block E_REND then waits for both, and others for all commands.
    """
    names = [joint_name(k) for k in range(joints)]
    meetings = list(_meetings(names)) if devices == "joints" else []
    blocks = [
        _server(
            ARM,
            f"SERVER_{2 * joints + 1}_{joints + 1}",
            PORT,
            "The arm: positions and boxes in, commands and brakes out",
            0.0,
            200.0,
        ),
        model.Block(SEQUENCE, "POSE_SEQUENCE", x=_COLUMN, y=200.0, comment="Which pose comes next, and when"),
        *(
            model.Block(name, JOINT, x=_COLUMN * (k + 2), y=200.0, comment=f"Joint {k + 1} and its link")
            for k, name in enumerate(names)
        ),
        model.Block(SWITCH, "E_SWITCH", x=0.0, y=3000.0, comment="Whether the arm moves or stands under supervision"),
        model.Block(STOP, "SAFE_STOP", x=1500.0, y=3000.0, comment="Stops the arm when it leaves its path"),
        _server(VERDICT, "SERVER_1_3", VERDICT_PORT, "Verdicts of a monitor, and releases", 0.0, 4500.0),
        _server(
            TWIN,
            f"SERVER_1_{len(ADJUSTED) * joints + 1}",
            TWIN_PORT,
            "What the twin has found of the joints",
            0.0,
            6000.0,
        ),
        *(meeting.block for meeting in meetings),
    ]
    events = list(_events(names))
    for meeting in meetings:
        events = meeting.joined(events)
    return model.FBNetwork(tuple(blocks), (), tuple(events), tuple(_data(names)))


@dataclass(frozen=True, slots=True)
class _Meeting:
    """A block E_REND before an event input, which then waits for a further event.

    Attributes:
        block: the block.
        source: the further event.
        destinations: the inputs.
        anew: an event that begins anew; "" for none.
    """

    block: model.Block
    source: str
    destinations: tuple[str, ...]
    anew: str = ""

    def joined(self, events: list[model.Connection]) -> list[model.Connection]:
        """The connections with this block in between."""
        name = self.block.name
        before = {each.source for each in events if each.destination in self.destinations}
        kept = [each for each in events if each.destination not in self.destinations]
        reset = [model.Connection(self.anew, f"{name}.R")] if self.anew else []
        return [
            *reset,  # first, so that nothing of the same event is forgotten
            *kept,
            *(model.Connection(source, f"{name}.EI1") for source in sorted(before)),
            model.Connection(self.source, f"{name}.EI2"),
            *(model.Connection(f"{name}.EO", destination) for destination in self.destinations),
        ]


def _meetings(names: list[str]) -> Iterator[_Meeting]:
    def block(name: str, comment: str, column: int, row: float) -> model.Block:
        return model.Block(name, "E_REND", x=_COLUMN * column, y=row, comment=comment)

    for k, name in enumerate(names[1:], start=1):
        for what, event, row in (("TARGET", "TARGET", -900.0), ("OUTWARD", "CNF", -500.0)):
            comment = f"{what} of the joint before, and what {SEQUENCE} says"
            yield _Meeting(block(f"{what}_{k + 1}", comment, k + 2, row), f"{SEQUENCE}.{event}", (f"{name}.{what}",))
        comment = f"Commands of the joints up to {k + 1}"
        gathered = block(f"GATHER_{k + 1}", comment, k + 2, 4500.0)
        yield _Meeting(gathered, f"{name}.INWARDO", (f"{SWITCH}.EI",), f"{ARM}.IND")


def _server(name: str, kind: str, port: int, comment: str, x: float, y: float) -> model.Block:
    given = (model.Parameter("QI", "TRUE"), model.Parameter("ID", f'"localhost:{port}"'))
    return model.Block(name, kind, given, x, y, comment)


def _events(names: list[str]) -> Iterator[model.Connection]:
    chain = [f"{ARM}.INITO", f"{SEQUENCE}.INIT", f"{SEQUENCE}.INITO"]
    chain += [end for name in names for end in (f"{name}.INIT", f"{name}.INITO")]
    chain += [f"{STOP}.INIT", f"{STOP}.INITO", f"{VERDICT}.INIT"]
    chain = [*chain, f"{ARM}.IND", f"{SEQUENCE}.REQ", f"{SEQUENCE}.TARGET"]
    chain += [end for name in names for end in (f"{name}.TARGET", f"{name}.TARGETO")]
    chain += [f"{SEQUENCE}.TIMED", f"{SEQUENCE}.CNF"]
    chain += [end for name in names for end in (f"{name}.OUTWARD", f"{name}.OUTWARDO")]
    chain += [end for name in names[::-1] for end in (f"{name}.INWARD", f"{name}.INWARDO")]
    chain += [f"{SWITCH}.EI"]
    for source, destination in zip(chain[::2], chain[1::2], strict=True):
        yield model.Connection(source, destination)
    for source, destination in (
        (f"{SWITCH}.EO0", f"{STOP}.CHECK"),
        (f"{SWITCH}.EO1", f"{STOP}.REQ"),
        (f"{SWITCH}.EO1", f"{STOP}.CHECK"),
        (f"{SWITCH}.EO0", f"{ARM}.RSP"),  # last: the next sample, which may come at once, is to find the stop decided
        (f"{SWITCH}.EO1", f"{ARM}.RSP"),
        (f"{STOP}.HALT", f"{SEQUENCE}.HALT"),
        (f"{VERDICT}.IND", f"{STOP}.VERDICT"),
        (f"{STOP}.ANSWER", f"{VERDICT}.RSP"),
        (f"{VERDICT}.INITO", f"{TWIN}.INIT"),
        *((f"{TWIN}.IND", f"{name}.ADJUST") for name in names),
        (f"{TWIN}.IND", f"{TWIN}.RSP"),
    ):
        yield model.Connection(source, destination)


def _data(names: list[str]) -> Iterator[model.Connection]:
    for k, name in enumerate(names):
        yield model.Connection(f"{ARM}.RD_{k + 1}", f"{name}.POSITION")
        yield model.Connection(f"{name}.COMMAND", f"{ARM}.SD_{k + 1}")
        yield model.Connection(f"{name}.ENGAGED", f"{ARM}.SD_{len(names) + k + 2}")
        for number, what in enumerate(ADJUSTED, 1):
            yield model.Connection(f"{TWIN}.RD_{len(ADJUSTED) * k + number}", f"{name}.{what}")
        for shared in _SHARED:
            yield model.Connection(f"{SEQUENCE}.{shared}", f"{name}.{shared}")
    for before, name in pairwise(names):
        for value in _OUTWARD:
            yield model.Connection(f"{before}.{value}_O", f"{name}.{value}")
        for value in _INWARD:
            yield model.Connection(f"{name}.{value}_O", f"{before}.{value}")
        yield model.Connection(f"{before}.NEEDED", f"{name}.LONGEST")
        yield model.Connection(f"{before}.FOLLOWING", f"{name}.FOLLOWING_IN")
        yield model.Connection(f"{before}.FASTEST", f"{name}.FASTEST_IN")
        yield model.Connection(f"{before}.DOUBT", f"{name}.DOUBT_IN")
    last, box = names[-1], len(names) + 1
    for source, destination in (
        (f"{ARM}.RD_{box}", f"{SEQUENCE}.BOX"),
        (f"{SEQUENCE}.GRIP", f"{ARM}.SD_{box}"),
        (f"{SEQUENCE}.LOAD", f"{last}.LOAD"),
        (f"{last}.FOLLOWING", f"{SEQUENCE}.FOLLOWING"),
        (f"{last}.DOUBT", f"{SEQUENCE}.DOUBT"),
        (f"{last}.NEEDED", f"{SEQUENCE}.NEEDED"),
        (f"{SEQUENCE}.STANDING", f"{SWITCH}.G"),
        (f"{STOP}.STOP", f"{SEQUENCE}.STOP"),
        (f"{last}.FOLLOWING", f"{STOP}.FOLLOWING"),
        (f"{last}.FOLLOWING", f"{STOP}.AWAY"),
        (f"{last}.FASTEST", f"{STOP}.SPEED"),
        (f"{last}.DOUBT", f"{STOP}.DOUBT"),
        (f"{VERDICT}.RD_1", f"{STOP}.STATE"),
        (f"{VERDICT}.RD_2", f"{STOP}.CONFIDENCE"),
        (f"{VERDICT}.RD_3", f"{STOP}.RELEASE"),
        (f"{STOP}.STOP", f"{VERDICT}.SD_1"),
        (f"{TWIN}.RD_{len(ADJUSTED) * len(names) + 1}", f"{last}.TOOL"),
        (f"{STOP}.STOP", f"{TWIN}.SD_1"),
    ):
        yield model.Connection(source, destination)


def system(name: str, drawn: model.FBNetwork, values: Mapping[str, Any], devices: Devices = "one") -> model.System:
    """The system: the application, and the devices that its blocks are mapped to.

    Args:
        name: name of the system.
        drawn: blocks and connections.
        values: values of inputs, by `BLOCK.INPUT`.
        devices: one device for all blocks; or one for every joint, and a first one for what leads the joints.
    """
    given = {block.name: {each.name: each for each in block.parameters} for block in drawn.blocks}
    for port, value in values.items():
        block_name, _, port_name = port.partition(".")
        given[block_name][port_name] = model.Parameter(port_name, literal_of(value))
    blocks = tuple(replace(block, parameters=tuple(given[block.name].values())) for block in drawn.blocks)
    comment = f"Control of the arm {name}"
    joints = [block.name for block in blocks if block.type_name == JOINT] if devices == "joints" else []
    return model.System(
        model.TypeHeader(name, comment=comment, standard="61499-2", versions=(_VERSION,)),
        (model.ApplicationDeclaration(APPLICATION, replace(drawn, blocks=blocks), comment),),
        (_device(_DEVICE, 0, "Runtime of the controller"), *(_device(f"{n}_PC", k) for k, n in enumerate(joints, 1))),
        tuple(
            model.Mapping(f"{APPLICATION}.{b.name}", f"{_home(b.name, joints)}.{_RESOURCE}.{b.name}") for b in blocks
        ),
    )


def _home(block: str, joints: list[str]) -> str:
    """The device of a block: that of its joint, if that has one of its own."""
    kind, _, number = block.rpartition("_")
    owner = f"JOINT_{number}" if kind in ("TARGET", "OUTWARD", "JOINT") else block
    return f"{owner}_PC" if owner in joints else _DEVICE


def _device(name: str, number: int, comment: str = "Runtime of one joint") -> model.DeviceDeclaration:
    """A device at an address of its own; the first one starts the application."""
    starts = tuple(model.Connection(f"START.{start}", f"{ARM}.INIT") for start in ("COLD", "WARM") if not number)
    resource = model.ResourceDeclaration(
        _RESOURCE, "EMB_RES", model.FBNetwork((), (), starts), comment="Resource of the application"
    )
    host, port = ("127.0.0.1", _FURTHER + number) if number else ("localhost", 61499)
    manager = model.Parameter("MGR_ID", f'"{host}:{port}"')
    return model.DeviceDeclaration(name, "FORTE_PC", (resource,), (manager,), comment)


def inputs(arm: Arm, inertia: Array, control: Control, poses: Poses | None) -> dict[str, Any]:
    """The values of all inputs that an arm and its task give, by `BLOCK.INPUT`.

    Args:
        arm: the arm; drives, speeds and accelerations must be known.
        inertia: usual inertia of every joint with all that it carries, (n,), kg m^2.
        control: how it is controlled.
        poses: what it has to do; None to stay where it is.

    Raises:
        ModelError: something of the arm is not known; names it.
    """
    fastest = 2.0 * max(joint.speed for joint in arm.joints)
    values: dict[str, Any] = {
        f"{SEQUENCE}.TS": arm.period,
        f"{SEQUENCE}.COUNT": 0 if poses is None else len(poses.positions),
        f"{SEQUENCE}.AGAIN": poses is not None and poses.again,
        f"{SEQUENCE}.DWELL": 0.0 if poses is None else float(poses.dwell),
        f"{SEQUENCE}.PLACES": 0 if poses is None else poses.places,
        f"{SEQUENCE}.TOLERANCE": poses.tolerance if poses is not None and np.isfinite(poses.tolerance) else WIDE,
        f"{SEQUENCE}.PAYLOAD": 0.0 if poses is None else poses.payload,
        f"{SEQUENCE}.SPACING": 0.0 if poses is None else poses.spacing,
        f"{STOP}.FOLLOWING_LIMIT": control.following,
        f"{STOP}.SPEED_LIMIT": fastest,
        f"{STOP}.RUNAWAY_LIMIT": fastest,
        f"{STOP}.DOUBT_LIMIT": DOUBTED,
        f"{STOP}.BLIND_LIMIT": BLIND,
    }
    chain = aligned(arm)
    for k in range(len(arm)):
        own = {**points(poses, k), **link(chain, k), **drive(arm, k, float(inertia[k]))}
        own |= {**belief(arm, k, float(inertia[k])), **_tuning(arm, k, float(inertia[k]), control), "TS": arm.period}
        own |= brake(arm, k, DOUBTED)
        if not k:
            own |= {f"A{x}": float(-g) for x, g in zip(XYZ, arm.gravity, strict=True)}
        values |= {f"{joint_name(k)}.{name}": value for name, value in own.items()}
    return values


def tuning_inputs(arm: Arm, inertia: Array, control: Control) -> dict[str, float]:
    """The values of those inputs that tune the control, by `BLOCK.INPUT`; arguments as for `inputs`."""
    return {
        f"{joint_name(k)}.{name}": value
        for k in range(len(arm))
        for name, value in _tuning(arm, k, float(inertia[k]), control).items()
    }


def _tuning(arm: Arm, k: int, inertia: float, control: Control) -> dict[str, float]:
    joint = arm.joints[k]
    gains = control.gains if not arm.servos else servo_gains(arm, k, inertia)
    return {
        **dict(zip(("KP", "KI", "KD"), gains, strict=True)),
        "BANDWIDTH": control.observer,
        "DELAY": control.delay,
        "SPEED": float(arm.path_speeds[k]) * control.speed,
        "ACCELERATION": joint.acceleration * control.speed**2,
    }
