"""Orders and states of vehicles in the form of VDA 5050 3.0, as JSON.

Field names are those of the recommendation, so that the values can be written as they are. What it leaves optional,
and the line does not know, is left out.
"""

from __future__ import annotations

import itertools
from typing import Any, Final

import msgspec

from dtwin.line.track import Track
from dtwin.line.vehicle import LOAD, Vehicle

VERSION: Final = "3.0.0"
MANUFACTURER: Final = "dtwin"
ACTIONS: Final = {1: "pick", 2: "drop"}
"""Predefined types of actions, by the number that the blocks know them by."""


class Header(msgspec.Struct, frozen=True, kw_only=True):
    """What every message begins with (6.2).

    Attributes:
        headerId: number of the message of its topic.
        timestamp: time in UTC; the line counts from 1970 on.
        version: version of the recommendation.
        manufacturer: who made the vehicle.
        serialNumber: name of the vehicle.
    """

    headerId: int
    timestamp: str
    version: str = VERSION
    manufacturer: str = MANUFACTURER
    serialNumber: str


class NodePosition(msgspec.Struct, frozen=True):
    """Where a node is, m, on the map of its zone."""

    x: float
    y: float
    mapId: str


class Action(msgspec.Struct, frozen=True):
    """Something that a vehicle does at a node."""

    actionType: str
    actionId: str
    blockingType: str = "HARD"
    actionParameters: tuple[dict[str, Any], ...] = ()


class Node(msgspec.Struct, frozen=True):
    """A node of an order; released ones are its base, the others its horizon."""

    nodeId: str
    sequenceId: int
    released: bool
    nodePosition: NodePosition
    actions: tuple[Action, ...] = ()


class Edge(msgspec.Struct, frozen=True):
    """An edge of an order between two nodes."""

    edgeId: str
    sequenceId: int
    released: bool
    startNodeId: str
    endNodeId: str
    actions: tuple[Action, ...] = ()


class Order(Header, frozen=True, kw_only=True):
    """What a vehicle has to do (6.6)."""

    orderId: str
    orderUpdateId: int
    nodes: tuple[Node, ...]
    edges: tuple[Edge, ...]


class NodeState(msgspec.Struct, frozen=True):
    """A node that a vehicle has still to reach."""

    nodeId: str
    sequenceId: int
    released: bool


class EdgeState(msgspec.Struct, frozen=True):
    """An edge that it has still to leave."""

    edgeId: str
    sequenceId: int
    released: bool


class ActionState(msgspec.Struct, frozen=True):
    """How far an action is: WAITING, RUNNING or FINISHED."""

    actionId: str
    actionType: str
    actionStatus: str


class PowerSupply(msgspec.Struct, frozen=True):
    """The battery: charge, percent, and whether it charges."""

    stateOfCharge: float
    charging: bool


class VehiclePosition(msgspec.Struct, frozen=True):
    """Where a vehicle is, m, on the map of its zone."""

    x: float
    y: float
    theta: float
    mapId: str
    localized: bool = True


class Load(msgspec.Struct, frozen=True):
    """The box on a vehicle."""

    loadId: str


class SafetyState(msgspec.Struct, frozen=True):
    """Whether the vehicle is stopped for safety; it never is."""

    activeEmergencyStop: str = "NONE"
    fieldViolation: bool = False


class State(Header, frozen=True, kw_only=True):
    """How a vehicle is (6.10)."""

    orderId: str
    orderUpdateId: int
    lastNodeId: str
    lastNodeSequenceId: int
    driving: bool
    nodeStates: tuple[NodeState, ...]
    edgeStates: tuple[EdgeState, ...]
    actionStates: tuple[ActionState, ...]
    powerSupply: PowerSupply
    mobileRobotPosition: VehiclePosition
    loads: tuple[Load, ...]
    operatingMode: str = "AUTOMATIC"
    errors: tuple[dict[str, Any], ...] = ()
    safetyState: SafetyState = SafetyState()


def timestamp(time: float) -> str:
    """A plant time, s, as ISO 8601 in UTC, counted from 1970 on; days are left out."""
    whole = round(1000 * time)
    seconds, millis = divmod(whole, 1000)
    hours, rest = divmod(seconds, 3600)
    return f"1970-01-{1 + hours // 24:02d}T{hours % 24:02d}:{rest // 60:02d}:{rest % 60:02d}.{millis:03d}Z"


def order(
    vehicle: Vehicle, track: Track, zone: str, job: int, update: int, route: tuple[str, ...], action: int, time: float
) -> Order:
    """The order of a vehicle.

    Args:
        vehicle: the vehicle; the nodes that were given to it are released.
        track, zone: its track and the name of its zone.
        job, update: number of the order of ORDER_DISPATCH, and of its changes.
        route: nodes from where it is to its goal.
        action: what it does there: nothing, 1 load, 2 unload.
        time: plant time, s.
    """
    released = len(vehicle.path)
    act = (Action(ACTIONS[action], f"{vehicle.plan.name}-{job}-{ACTIONS[action]}"),) if action else ()
    nodes = tuple(
        Node(
            name,
            2 * k,
            k < released,
            NodePosition(*track.nodes[name], zone),
            act if k == len(route) - 1 else (),
        )
        for k, name in enumerate(route)
    )
    edges = tuple(
        Edge(f"{start}>{end}", 2 * k + 1, k + 1 < released, start, end)
        for k, (start, end) in enumerate(itertools.pairwise(route))
    )
    return Order(
        headerId=update,
        timestamp=timestamp(time),
        serialNumber=vehicle.plan.name,
        orderId=f"{vehicle.plan.name}-{job}",
        orderUpdateId=update,
        nodes=nodes,
        edges=edges,
    )


def state(vehicle: Vehicle, track: Track, zone: str, job: int, message: int, time: float) -> State:
    """How a vehicle is.

    Args:
        vehicle, track, zone, job, time: as for `order`.
        message: number of the message.
    """
    path = vehicle.path
    x, y = vehicle.position
    acts: tuple[ActionState, ...] = ()
    if vehicle.action:
        kind = ACTIONS[LOAD if vehicle.action == LOAD else 2]
        acts = (ActionState(f"{vehicle.plan.name}-{job}-{kind}", kind, "RUNNING"),)
    return State(
        headerId=message,
        timestamp=timestamp(time),
        serialNumber=vehicle.plan.name,
        orderId=f"{vehicle.plan.name}-{job}" if job else "",
        orderUpdateId=0,
        lastNodeId=path[0],
        lastNodeSequenceId=0,
        driving=not vehicle.standing,
        nodeStates=tuple(NodeState(name, 2 * k, True) for k, name in enumerate(path) if k),
        edgeStates=tuple(EdgeState(f"{a}>{b}", 2 * k + 1, True) for k, (a, b) in enumerate(itertools.pairwise(path))),
        actionStates=acts,
        powerSupply=PowerSupply(round(vehicle.battery, 3), vehicle.standing and path[0] == vehicle.plan.home),
        mobileRobotPosition=VehiclePosition(x, y, 0.0, zone),
        loads=(Load(str(vehicle.box)),) if vehicle.box else (),
    )
