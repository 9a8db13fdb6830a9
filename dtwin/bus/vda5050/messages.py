"""The messages of VDA 5050 3.0 as they are sent and read here (chapter 7, "Message specification").

Field names are those of the recommendation, so that the values can be written as they are. What it leaves optional,
and a line neither knows nor reads, is left out; a reader passes over it. Numbers and lengths are bounded more closely
than there, so that no message can be used to fill a memory or to move a vehicle out of this world.
"""

from __future__ import annotations

from typing import Annotated, Any, Final, Literal

import msgspec
from msgspec import UNSET, Meta, UnsetType

VERSION: Final = "3.0.0"
INTERFACE: Final = "vda5050"
MAJOR: Final = "v3"
MANUFACTURER: Final = "dtwin"
"""Who made the vehicles that a plant emulates itself."""
ORDER: Final = "order"
INSTANT_ACTIONS: Final = "instantActions"
STATE: Final = "state"
CONNECTION: Final = "connection"
FACTSHEET: Final = "factsheet"
PICK: Final = "pick"
DROP: Final = "drop"
MOST_STOPS: Final = 256
"""Number of nodes of an order, and of entries of any other list, that are read."""
_ANGLE: Final = 3.1415926536

Id = Annotated[str, Meta(min_length=1, max_length=128)]
Text = Annotated[str, Meta(max_length=1000)]
Number32 = Annotated[int, Meta(ge=0, le=2**32 - 1)]
Coordinate = Annotated[float, Meta(ge=-1e6, le=1e6)]
Angle = Annotated[float, Meta(ge=-_ANGLE, le=_ANGLE)]
Percent = Annotated[float, Meta(ge=0.0, le=100.0)]
Size = Annotated[float, Meta(ge=0.0, le=1e6)]
Blocking = Literal["NONE", "SINGLE", "SOFT", "HARD"]
_few: Final = Meta(max_length=MOST_STOPS)


class Header(msgspec.Struct, frozen=True, kw_only=True):
    """What every message begins with (7.2).

    Attributes:
        headerId: number of the message of its topic.
        timestamp: time in UTC, as 2017-04-15T11:40:03.123Z.
        version: version of the recommendation.
        manufacturer: who made the vehicle.
        serialNumber: name of the vehicle.
    """

    headerId: Number32
    timestamp: Annotated[str, Meta(pattern=r"^\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d(\.\d{1,9})?Z$")]
    version: Annotated[str, Meta(pattern=r"^\d{1,4}\.\d{1,4}\.\d{1,4}$")] = VERSION
    manufacturer: Id
    serialNumber: Id


class ActionParameter(msgspec.Struct, frozen=True):
    """A parameter of an action (7.3.1)."""

    key: Id
    value: Any


class Action(msgspec.Struct, frozen=True):
    """Something that a vehicle does at a node, or at once."""

    actionType: Id
    actionId: Id
    blockingType: Blocking = "HARD"
    actionParameters: Annotated[tuple[ActionParameter, ...], _few] = ()


class NodePosition(msgspec.Struct, frozen=True):
    """Where a node is, m, on the map of its zone."""

    x: Coordinate
    y: Coordinate
    mapId: Id


class Node(msgspec.Struct, frozen=True):
    """A node of an order; released ones are its base, the others its horizon."""

    nodeId: Id
    sequenceId: Number32
    released: bool
    nodePosition: NodePosition
    actions: tuple[Action, ...] = ()


class Edge(msgspec.Struct, frozen=True):
    """An edge of an order between two nodes."""

    edgeId: Id
    sequenceId: Number32
    released: bool
    actions: tuple[Action, ...] = ()


class Order(Header, frozen=True, kw_only=True):
    """What a vehicle has to do (7.3)."""

    orderId: Id
    orderUpdateId: Number32
    nodes: tuple[Node, ...]
    edges: tuple[Edge, ...]


class InstantActions(Header, frozen=True, kw_only=True):
    """What a vehicle has to do at once (7.4)."""

    actions: Annotated[tuple[Action, ...], _few]


class Connection(Header, frozen=True, kw_only=True):
    """Whether a vehicle is connected (7.7)."""

    connectionState: Literal["ONLINE", "OFFLINE", "HIBERNATING", "CONNECTION_BROKEN"]


class NodeState(msgspec.Struct, frozen=True):
    """A node that a vehicle has still to reach."""

    nodeId: Id
    sequenceId: Number32
    released: bool


class EdgeState(msgspec.Struct, frozen=True):
    """An edge that it has still to leave."""

    edgeId: Id
    sequenceId: Number32
    released: bool


class ActionState(msgspec.Struct, frozen=True):
    """How far an action is (6.6.9)."""

    actionId: Id
    actionStatus: Literal["WAITING", "INITIALIZING", "RUNNING", "PAUSED", "RETRIABLE", "FINISHED", "FAILED"]
    actionType: Text | UnsetType = UNSET


class PowerSupply(msgspec.Struct, frozen=True):
    """The battery: charge, percent, and whether it charges."""

    stateOfCharge: Percent
    charging: bool


class MobileRobotPosition(msgspec.Struct, frozen=True):
    """Where a vehicle is, m, on the map of its zone."""

    x: Coordinate
    y: Coordinate
    theta: Angle
    mapId: Id
    localized: bool


class Load(msgspec.Struct, frozen=True):
    """The box on a vehicle."""

    loadId: Text | UnsetType = UNSET


class ErrorReference(msgspec.Struct, frozen=True):
    """What an error is about."""

    referenceKey: Text
    referenceValue: Text


class RobotError(msgspec.Struct, frozen=True):
    """Something that is wrong with a vehicle, or with what it was sent (6.6.5)."""

    errorType: Text
    errorLevel: Literal["WARNING", "URGENT", "CRITICAL", "FATAL"]
    errorReferences: Annotated[tuple[ErrorReference, ...], _few] = ()
    errorDescription: Text | UnsetType = UNSET


class SafetyState(msgspec.Struct, frozen=True):
    """Whether the vehicle is stopped for safety."""

    activeEmergencyStop: Literal["MANUAL", "REMOTE", "NONE"] = "NONE"
    fieldViolation: bool = False


class State(Header, frozen=True, kw_only=True):
    """How a vehicle is (7.8).

    `mobileRobotPosition` is optional in the recommendation; a line asks for it, since it watches that its vehicles do
    not touch.
    """

    orderId: Annotated[str, Meta(max_length=128)]
    orderUpdateId: Number32
    lastNodeId: Annotated[str, Meta(max_length=128)]
    lastNodeSequenceId: Number32
    nodeStates: Annotated[tuple[NodeState, ...], _few]
    edgeStates: Annotated[tuple[EdgeState, ...], _few]
    driving: bool
    actionStates: Annotated[tuple[ActionState, ...], _few]
    instantActionStates: Annotated[tuple[ActionState, ...], _few]
    powerSupply: PowerSupply
    operatingMode: Literal["STARTUP", "AUTOMATIC", "SEMIAUTOMATIC", "INTERVENED", "MANUAL", "SERVICE", "TEACH_IN"]
    errors: Annotated[tuple[RobotError, ...], _few]
    safetyState: SafetyState
    mobileRobotPosition: MobileRobotPosition
    loads: Annotated[tuple[Load, ...], _few] | UnsetType = UNSET
    paused: bool | UnsetType = UNSET


class TypeSpecification(msgspec.Struct, frozen=True):
    """What kind of vehicle it is; masses in kg."""

    seriesName: Text
    mobileRobotKinematics: Text
    mobileRobotClass: Text
    maximumLoadMass: Size
    localizationTypes: Annotated[tuple[Text, ...], _few]
    navigationTypes: Annotated[tuple[Text, ...], _few]


class PhysicalParameters(msgspec.Struct, frozen=True):
    """How fast and how large it is: m/s, m/s^2 and m."""

    minimumSpeed: Size
    maximumSpeed: Size
    maximumAcceleration: Size
    maximumDeceleration: Size
    minimumHeight: Size
    maximumHeight: Size
    width: Size
    length: Size


class Timing(msgspec.Struct, frozen=True):
    """How often it can be told something, and tells something, s."""

    minimumOrderInterval: Size
    minimumStateInterval: Size
    defaultStateInterval: Size | UnsetType = UNSET


class ProtocolLimits(msgspec.Struct, frozen=True):
    """What its memory has room for; nothing is limited where nothing is said."""

    timing: Timing
    maximumStringLengths: dict[Text, int | bool] = {}
    maximumArrayLengths: dict[Text, int] = {}


class RobotAction(msgspec.Struct, frozen=True):
    """Something that it can do."""

    actionType: Id
    actionScopes: Annotated[tuple[Literal["INSTANT", "NODE", "EDGE", "ZONE"], ...], _few]
    pauseAllowed: bool
    cancelAllowed: bool


class ProtocolFeatures(msgspec.Struct, frozen=True):
    """What it understands."""

    mobileRobotActions: Annotated[tuple[RobotAction, ...], _few]
    optionalParameters: Annotated[tuple[Any, ...], _few] = ()


class Factsheet(Header, frozen=True, kw_only=True):
    """What a vehicle is (7.10)."""

    typeSpecification: TypeSpecification
    physicalParameters: PhysicalParameters
    protocolLimits: ProtocolLimits
    protocolFeatures: ProtocolFeatures
    mobileRobotGeometry: dict[Text, Any] = {}
    loadSpecification: dict[Text, Any] = {}


def key_of(manufacturer: str, vehicle: str, topic: str) -> str:
    """Key of a topic of a vehicle below that of its line (4.2).

    It is interfaceName/majorVersion/manufacturer/serialNumber/topic.
    """
    return f"{INTERFACE}/{MAJOR}/{manufacturer}/{vehicle}/{topic}"
