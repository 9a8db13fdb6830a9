"""A vehicle that others have made: it gets orders, and is where it tells it is, as far as that can be."""

from __future__ import annotations

import logging
from typing import Final

from msgspec import UNSET

from dtwin.bus.codec import MessageError
from dtwin.bus.vda5050.messages import Connection, Factsheet, State
from dtwin.line.fleet.contact import UNHEARD, Contact, Link
from dtwin.line.fleet.dispatch import Dispatch
from dtwin.line.fleet.inbox import Inbox
from dtwin.line.fleet.judging import (
    condition,
    is_idle,
    order_fault,
    place_fault,
    progress,
)
from dtwin.line.fleet.orders import Orders, Stamp, Surroundings
from dtwin.line.line import VehiclePlan
from dtwin.line.track import Point
from dtwin.line.vehicle import FULL, UNLOAD, Vehicle, VehicleCommand, VehicleSample

log = logging.getLogger(__name__)

_REPEATED: Final = 1.0
"""Time after which something that could not be done is tried again, s."""


class DistantVehicle(Vehicle):
    """A vehicle of a line that is driven elsewhere.

    It holds the nodes that were given to it, whatever it tells: what it tells can only let it go on, node by node, in
    the order that it was sent. Until it stands at a node with nothing to do, nobody knows where it is; then the
    control gives it nothing.

    Args:
        plan: what it is.
        around: where it is one of a line.
        link: how it is reached.

    Attributes:
        orders: its orders.
        trouble: why it is given nothing now, "" if it is well.
    """

    def __init__(self, plan: VehiclePlan, around: Surroundings, link: Link) -> None:
        super().__init__(plan, around.track)
        self._around = around
        self.orders = Orders(Stamp(plan.manufacturer, plan.name, around.epoch), around)
        self.trouble = UNHEARD
        self._inbox = Inbox(plan.manufacturer, plan.name, link.refuse)
        self._contact = Contact(link, self.orders)
        self._dispatch = Dispatch(self.orders, link.order)
        self._known = self._found = self._driving = self._paused = False
        self._at: Point | None = None
        self._finished = False
        self._again: float | None = None

    def receive(self, topic: str, payload: bytes) -> None:
        """Takes a message of it, to be read in the next cycle; called by any thread."""
        self._inbox.receive(topic, payload)

    @property
    def position(self) -> Point:
        """Where it tells it is, m."""
        return super().position if self._at is None else self._at

    def sample(self) -> VehicleSample:
        """What its control is told: it stands only if that is certain."""
        sample = super().sample()
        stands = sample.standing and self._known and not self._driving and not self.orders.has_new
        return sample._replace(base_end=sample.base_end if self._known else 0, standing=stands)

    def obey(self, command: VehicleCommand) -> None:
        """Takes a command, and writes it into the order."""
        if node := self.given(command):
            self._give(self.path[-1], node)
            self.path.append(node)
        if (command.action, command.slot) == (self.action, self._slot):
            return
        before, self.action, self._slot = self.action, command.action, command.slot
        self._again = None
        if before and self.orders.action is not None:
            self._withdraw()
        elif before:
            self.orders.done(last=before == UNLOAD)
        if self.action:
            self._act()

    def advance(self, period: float) -> int:
        """Reads what it has told, and sends what it is to do; as for any vehicle."""
        contact = self._contact
        contact.now += period
        self._inbox.read(self._take)
        if absence := contact.absence():
            self._say(absence)
        if self._again is not None and contact.now >= self._again:
            self._again = None
            self._act()
        interval = contact.interval()
        if interval is not None and self._known and not self.trouble:
            self._dispatch.send_due(contact.now, interval)
        finished, self._finished = self._finished, False
        return self._slot if finished and self.action else 0

    def undisturbed(self, slot: int) -> float:
        return 0.0

    def retry(self) -> None:
        """The box could not be taken or given: the vehicle tries again in a second."""
        self._again = self._contact.now + _REPEATED

    def _take(self, message: State | Connection | Factsheet) -> None:
        if isinstance(message, Connection):
            self._contact.connection_came(message)
        elif isinstance(message, Factsheet):
            self._contact.factsheet_came(message)
        else:
            self._hold(message)

    def _hold(self, state: State) -> None:
        """Takes what it tells of itself."""
        fault = order_fault(state, self.orders)
        if fault:
            raise MessageError("invalid", fault)
        ours = bool(state.orderId) and state.orderId == self.orders.order_id
        before, path = self._dispatch.reached, self.path
        reached = before
        if self._known and ours:
            reached = progress(state, self.orders, before)
            path = path[sum(stop.new for stop in self.orders.stops[before + 1 : reached + 1]) :]
        elif not (self._known and self._dispatch.taken < 0 and is_idle(state) and state.lastNodeId == path[0]):
            self._find(state)
            return
        self._see(state)
        trouble = condition(state) or self._astray(state, path)
        if not trouble:
            self._note(state)
            self.path = path
            self._dispatch.progressed(reached, state.orderUpdateId if ours else None)
            if ours:
                self._look_at_action(state)
        self._say(trouble or self._contact.unfit())

    def _find(self, state: State) -> None:
        """Takes up a vehicle that has no order of this process: it must stand at a node that it may be at."""
        self._known = False
        self._see(state)
        trouble = condition(state)
        if not trouble and not is_idle(state):
            trouble = f"it carries out order {state.orderId!r}, which is not in force"
            self._contact.ask("cancelOrder", orderId=state.orderId)
        trouble = trouble or self._misplaced(state)
        if not trouble:
            self._note(state)
            self.path = self.path[self.path.index(state.lastNodeId) :] if self._found else [state.lastNodeId]
            self._known = self._found = True
            self._restart()
        self._say(trouble or self._contact.unfit())

    def _misplaced(self, state: State) -> str:
        """Why a vehicle cannot begin where it is, and with what it has; "" if it can."""
        zone, track = self._around.zone, self._around.track
        others = self._around.held()
        may = self.path if self._found else [node for node in track.nodes if node not in others]
        if state.lastNodeId not in may:
            return f"it is at node {state.lastNodeId!r}: expected one of {', '.join(may)}"
        if state.loads is not UNSET and bool(state.loads) != bool(self.box):
            expected = f"box {self.box}" if self.box else "none, as the line knows of none"
            return f"its loads: expected {expected}; load or unload it by hand"
        return place_fault(state, zone, track, state.lastNodeId, state.lastNodeId)

    def _restart(self) -> None:
        """What is left to do becomes a new order."""
        pending = self.action if self.orders.action is not None else 0
        self.orders.end()
        for before, node in zip(self.path, self.path[1:], strict=False):
            self._give(before, node)
        if pending:
            self._act()

    def _give(self, at: str, node: str) -> None:
        """A node is given to it."""
        self.orders.drive(at, node)
        self._dispatch.look()

    def _see(self, state: State) -> None:
        """It is there, wherever it is."""
        at = state.mobileRobotPosition
        self._contact.state_came()
        if at.localized and at.mapId == self._around.zone:
            self._at = at.x, at.y

    def _note(self, state: State) -> None:
        """Believes whether it drives, and what it has left."""
        self._driving = state.driving or bool(state.nodeStates)
        self.battery = min(max(state.powerSupply.stateOfCharge, 0.0), FULL)

    def _look_at_action(self, state: State) -> None:
        """Whether what it was told to do is done."""
        action = self.orders.action
        found = (
            None
            if action is None
            else next((each for each in state.actionStates if each.actionId == action.actionId), None)
        )
        if found is None or self._driving or not self.standing:
            return
        if found.actionStatus == "FINISHED":
            self.orders.action, self._finished = None, True
        elif found.actionStatus == "FAILED" and self._again is None:
            self.orders.action = None
            self._again = self._contact.now + _REPEATED
            log.warning("%s: it could not %s; it tries again", self.plan.name, found.actionType)

    def _astray(self, state: State, path: list[str]) -> str:
        """Why it is not where it should be; a vehicle that leaves its way is paused until it is back."""
        fault = place_fault(state, self._around.zone, self._around.track, path[0], path[min(1, len(path) - 1)])
        if fault:
            self._paused = True
            self._contact.ask("startPause")
        elif self._paused:
            self._paused = False
            self._contact.instant("stopPause")
        return fault

    def _act(self) -> None:
        """Releases what is to be done where it stands."""
        self.orders.act(self.path[-1], self.action, self._around.place(self._slot), self.box)
        self._dispatch.look()

    def _withdraw(self) -> None:
        """What it was told to do is not to be done any more (6.1.3)."""
        order = self.orders.order_id
        self.orders.end()
        self._known = False
        self._contact.ask_first("cancelOrder", orderId=order)

    def _say(self, trouble: str) -> None:
        if trouble != self.trouble:
            log.warning("%s: %s", self.plan.name, trouble or "it is well again")
        self.trouble = trouble
