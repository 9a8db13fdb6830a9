"""A vehicle that the plant emulates itself, and what it tells as VDA 5050 has a vehicle tell."""

from __future__ import annotations

import itertools
import math
from typing import Final

from dtwin.bus.vda5050.messages import (
    MANUFACTURER,
    ActionState,
    Connection,
    EdgeState,
    Factsheet,
    Load,
    MobileRobotPosition,
    NodeState,
    PhysicalParameters,
    PowerSupply,
    ProtocolFeatures,
    ProtocolLimits,
    RobotAction,
    SafetyState,
    State,
    Timing,
    TypeSpecification,
)
from dtwin.line.fleet.orders import Orders, Stamp, Surroundings
from dtwin.line.line import CYCLE, VehiclePlan
from dtwin.line.track import DIAMETER
from dtwin.line.vehicle import UNLOAD, Vehicle, VehicleCommand

TOLD: Final = 1.0
"""Time from one state of a vehicle to the next when nothing happens, s."""
_MASS: Final = 10.0
"""Largest load, kg."""


class OwnVehicle(Vehicle):
    """A vehicle that keeps its orders, too.

    Args:
        plan: what it is.
        around: where it is one of a line.

    Attributes:
        orders: its orders.
        withdrawn: the order that was taken back before it was carried out, "" for none since `state`.
    """

    def __init__(self, plan: VehiclePlan, around: Surroundings) -> None:
        super().__init__(plan, around.track)
        self._stamp = Stamp(MANUFACTURER, plan.name, around.epoch)
        self._around = around
        self._headers = dict.fromkeys(("state", "connection", "factsheet"), 0)
        self._reached = 0
        self._did: dict[str, ActionState] = {}
        self._running = ""
        self.orders = Orders(self._stamp, around)
        self.withdrawn = ""

    def obey(self, command: VehicleCommand) -> None:
        """Takes a command, and writes it into the order."""
        end, before, order = self.path[-1], (self.action, self._slot), self.orders.order_id
        super().obey(command)
        if self.path[-1] != end:
            self.orders.drive(end, self.path[-1])
        if (self.action, self._slot) != before:
            if before[0] and not self.action:
                finished = bool(self.box) != (before[0] == UNLOAD)
                self._end("FINISHED" if finished else "FAILED")
                self.orders.done(last=before[0] == UNLOAD or not finished)
                self.withdrawn = "" if finished else order
            if self.action:
                self.orders.act(self.path[-1], self.action, self._around.place(self._slot), self.box)
                self._running = "" if self.orders.action is None else self.orders.action.actionId
        if self.orders.order_id != order:
            self._reached, self._did = 0, {}
        if self._running:
            self._did[self._running] = ActionState(self._running, "RUNNING", self._running.rsplit("-", 2)[1])

    def happened(self) -> tuple[object, ...]:
        """What makes a state worth telling at once when it changes (6.6)."""
        standing = self.standing and self.path[0] == self.plan.home
        return (self.orders.order_id, len(self.orders.stops), tuple(self.path), self.box, standing, str(self._did))

    def state(self, time: float) -> State:
        """How it is at a plant time, s."""
        reached = self._reach()
        left = self.orders.stops[reached + 1 :] if self.orders.stops else []
        x, y = self.position
        ahead = self._track.nodes[self.path[1]] if len(self.path) > 1 else (x + 1.0, y)
        stops = self.orders.stops[reached:]
        return State(
            headerId=self._header("state"),
            timestamp=self._stamp.text(time),
            manufacturer=MANUFACTURER,
            serialNumber=self.plan.name,
            orderId=self.orders.order_id,
            orderUpdateId=max(self.orders.update, 0),
            lastNodeId=self.path[0],
            lastNodeSequenceId=self.orders.stops[reached].sequence if self.orders.stops else 0,
            nodeStates=tuple(NodeState(stop.node, stop.sequence, True) for stop in left),
            edgeStates=tuple(
                EdgeState(f"{one.node}>{other.node}", one.sequence + 1, True)
                for one, other in itertools.pairwise(stops)
            ),
            driving=not self.standing,
            actionStates=tuple(self._did.values()),
            instantActionStates=(),
            powerSupply=PowerSupply(round(self.battery, 3), self.standing and self.path[0] == self.plan.home),
            operatingMode="AUTOMATIC",
            errors=(),
            safetyState=SafetyState(),
            mobileRobotPosition=MobileRobotPosition(
                x, y, round(math.atan2(ahead[1] - y, ahead[0] - x), 6), self._around.zone, True
            ),
            loads=(Load(str(self.box)),) if self.box else (),
        )

    def connection(self, time: float, online: bool = True) -> Connection:
        """Whether it is connected at a plant time, s."""
        return Connection(
            headerId=self._header("connection"),
            timestamp=self._stamp.text(time),
            manufacturer=MANUFACTURER,
            serialNumber=self.plan.name,
            connectionState="ONLINE" if online else "OFFLINE",
        )

    def factsheet(self, time: float) -> Factsheet:
        """What it is, told at a plant time, s."""
        limits = self.plan.speed, self.plan.acceleration, self.plan.acceleration
        side = round(DIAMETER / math.sqrt(2.0), 3) - 0.001
        can = tuple(RobotAction(kind, ("NODE",), False, True) for kind in ("pick", "drop"))
        return Factsheet(
            headerId=self._header("factsheet"),
            timestamp=self._stamp.text(time),
            manufacturer=MANUFACTURER,
            serialNumber=self.plan.name,
            typeSpecification=TypeSpecification(
                "emulated vehicle", "DIFFERENTIAL", "CARRIER", _MASS, ("NATURAL",), ("VIRTUAL_LINE_GUIDED",)
            ),
            physicalParameters=PhysicalParameters(0.0, *limits, 0.3, 0.3, side, side),
            protocolLimits=ProtocolLimits(Timing(CYCLE, CYCLE, TOLD)),
            protocolFeatures=ProtocolFeatures(can),
        )

    def _reach(self) -> int:
        """Number of the last stop of the order that it has reached."""
        stops = self.orders.stops
        held = len(self.path) - 1
        ahead = [number for number, stop in enumerate(stops) if stop.new and number]
        self._reached = len(stops) - 1 if not held else ahead[-held] - 1
        return max(self._reached, 0)

    def _end(self, status: str) -> None:
        if self._running:
            kind = self._running.rsplit("-", 2)[1]
            good = status == "FINISHED"
            self._did[self._running] = ActionState(self._running, "FINISHED" if good else "FAILED", kind)
            self._running = ""

    def _header(self, topic: str) -> int:
        number = self._headers[topic]
        self._headers[topic] = (number + 1) % 2**32
        return number
