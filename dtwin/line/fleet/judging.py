"""Whether a vehicle that others have made can be what its line believes: what it tells is held against its order."""

from __future__ import annotations

import math
from typing import Final

from dtwin.bus.codec import MessageError
from dtwin.bus.vda5050.messages import DROP, PICK, Factsheet, State
from dtwin.line.fleet.orders import Orders
from dtwin.line.track import DIAMETER, Point, Track

NEAR: Final = DIAMETER / 2.0
"""Farthest from where it should be that a vehicle is believed to be there, m: others keep clear of it by more."""
_DRIVES: Final = ("AUTOMATIC", "SEMIAUTOMATIC")
"""Modes in which a vehicle does what its order says (6.6.6)."""


def order_fault(state: State, orders: Orders) -> str:
    """Why a vehicle cannot follow the order that it was sent; "" if it does, or has not heard of it yet."""
    if state.orderId == orders.order_id and state.orderUpdateId > orders.update:
        return f"it has update {state.orderUpdateId} of order {state.orderId}: expected {orders.update} at most"
    return ""


def progress(state: State, orders: Orders, reached: int) -> int:
    """Number of the stop of its order that a vehicle has reached last.

    Args:
        state: what it tells, of the order in force.
        orders: its orders.
        reached: number of the stop that it had reached before.

    Raises:
        MessageError: it tells of nodes that were not given to it, or goes back.
    """
    stops = orders.stops[: orders.sent]
    found = next((n for n, stop in enumerate(stops) if stop.sequence == state.lastNodeSequenceId), None)
    if found is None or stops[found].node != state.lastNodeId:
        got = f"{state.lastNodeId!r} ({state.lastNodeSequenceId})"
        raise MessageError("invalid", f"lastNodeId: expected a node of order {orders.order_id}, got {got}")
    if found < reached:
        before = f"{stops[reached].node} ({stops[reached].sequence})"
        raise MessageError("invalid", f"lastNodeId: expected none before {before}, got {state.lastNodeId}")
    given = {(stop.node, stop.sequence) for stop in stops[found + 1 :]}
    for node in state.nodeStates:
        if node.released and (node.nodeId, node.sequenceId) not in given:
            raise MessageError(
                "invalid", f"nodeStates: {node.nodeId!r} ({node.sequenceId}) is none that was released and is left"
            )
    return found


def is_idle(state: State) -> bool:
    """Whether a vehicle has nothing to do (6.6.8)."""
    over = all(action.actionStatus in ("FINISHED", "FAILED") for action in state.actionStates)
    return not state.driving and not state.nodeStates and not state.edgeStates and over


def condition(state: State) -> str:
    """Why a vehicle cannot drive now, as it tells itself; "" if it can."""
    if state.operatingMode not in _DRIVES:
        return f"its operating mode is {state.operatingMode}"
    if state.safetyState.activeEmergencyStop != "NONE":
        return f"its emergency stop is {state.safetyState.activeEmergencyStop}"
    fatal = next((error for error in state.errors if error.errorLevel == "FATAL"), None)
    return "" if fatal is None else f"it reports {fatal.errorType}"


def place_fault(state: State, zone: str, track: Track, last: str, following: str) -> str:
    """Why a vehicle is not where it should be: near the way from one node to the next; "" if it is there."""
    at = state.mobileRobotPosition
    if not at.localized:
        return "it does not know where it is"
    if at.mapId != zone:
        return f"its map is {at.mapId!r}: expected {zone!r}"
    away = _away((at.x, at.y), track.nodes[last], track.nodes[following])
    if away > NEAR:
        way = f"node {last}" if last == following else f"the way from {last} to {following}"
        return f"it is {away:.2f} m from {way}: expected {NEAR} m at most"
    return ""


def factsheet_fault(sheet: Factsheet) -> str:
    """Why a vehicle cannot be one of the line, as its factsheet says; "" if it can."""
    size = math.hypot(sheet.physicalParameters.length, sheet.physicalParameters.width)
    if size > DIAMETER:
        return f"its factsheet: length and width need a circle of {size:.2f} m: expected {DIAMETER} m at most"
    can = {each.actionType for each in sheet.protocolFeatures.mobileRobotActions if "NODE" in each.actionScopes}
    for kind in (PICK, DROP):
        if kind not in can:
            return f"its factsheet: expected that it can {kind} at nodes"
    return ""


def _away(point: Point, a: Point, b: Point) -> float:
    """Distance of a point from the line between two others, which may be the same, m."""
    (x, y), (dx, dy) = (point[0] - a[0], point[1] - a[1]), (b[0] - a[0], b[1] - a[1])
    squared = dx * dx + dy * dy
    share = min(1.0, max(0.0, (x * dx + y * dy) / squared)) if squared else 0.0
    return math.hypot(x - share * dx, y - share * dy)
