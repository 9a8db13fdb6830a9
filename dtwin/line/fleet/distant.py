"""A vehicle that others have made: it gets orders, and is where it tells it is, as far as that can be."""

from __future__ import annotations

import logging
from collections import deque
from typing import Final, Protocol

import msgspec
from msgspec import UNSET

from dtwin.bus.codec import MessageError
from dtwin.bus.vda5050.messages import CONNECTION, FACTSHEET, STATE, Connection, Factsheet, State
from dtwin.bus.vda5050.reading import RobotReader
from dtwin.line.fleet.judging import (
    condition,
    factsheet_fault,
    is_idle,
    order_fault,
    place_fault,
    progress,
)
from dtwin.line.fleet.orders import Orders, Stamp, Surroundings
from dtwin.line.line import CYCLE, VehiclePlan
from dtwin.line.track import Point
from dtwin.line.vehicle import FULL, UNLOAD, Vehicle, VehicleCommand, VehicleSample

log = logging.getLogger(__name__)

SILENT: Final = 30.0
"""Time without a state after which a vehicle counts as absent, s: it tells one every 30 s at least (6.6)."""
_ASKED: Final = 5.0
"""Time after which a vehicle is asked again, s."""
_RESENT: Final = 1.0
"""Time after which an order that it has not taken is sent again, s."""
_REPEATED: Final = 1.0
"""Time after which something that could not be done is tried again, s."""
_WAITING: Final = 100
"""Number of its messages that may wait for the next cycle; of more the oldest are lost."""
_UNHEARD: Final = "it has told no state yet"


class Link(Protocol):
    """How a vehicle is reached."""

    def order(self, message: msgspec.Struct) -> None:
        """Sends it an order."""

    def instant(self, message: msgspec.Struct) -> None:
        """Sends it an action that is to be done at once."""

    def refuse(self, reason: str, detail: str) -> None:
        """Counts a message of it that was not believed."""


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
        self._around, self._link = around, link
        self.orders = Orders(Stamp(plan.manufacturer, plan.name, around.epoch), around)
        self.trouble = _UNHEARD
        self._came: deque[tuple[str, bytes]] = deque(maxlen=_WAITING)
        names = plan.manufacturer, plan.name
        self._states = RobotReader(State, *names)
        self._connections = RobotReader(Connection, *names)
        self._sheets = RobotReader(Factsheet, *names)
        self._sheet: Factsheet | None = None
        self._now = 0.0
        self._heard: float | None = None
        self._offline = ""
        self._known = self._found = self._driving = self._paused = False
        self._order, self._reached, self._taken, self._first = "", 0, -1, 0
        self._sent_at = self._asked_at = self._sheet_at = -SILENT
        self._at: Point | None = None
        self._finished = False
        self._again: float | None = None

    def receive(self, topic: str, payload: bytes) -> None:
        """Takes a message of it, to be read in the next cycle; called by any thread."""
        self._came.append((topic, payload))

    @property
    def position(self) -> Point:
        """Where it tells it is, m."""
        return super().position if self._at is None else self._at

    def sample(self) -> VehicleSample:
        """What its control is told: it stands only if that is certain."""
        sample = super().sample()
        stands = sample.standing and self._known and not self._driving and not self.orders.has_new
        return VehicleSample(sample.at, stands, sample.loaded, sample.battery)

    def obey(self, command: VehicleCommand) -> None:
        """Takes a command, and writes it into the order."""
        if command.next and (node := self._track.name(command.next)) != self.path[-1]:
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
        self._now += period
        while self._came:
            topic, payload = self._came.popleft()
            try:
                self._take(topic, payload)
            except MessageError as error:
                self._link.refuse(error.reason, f"{self.plan.name}: {topic}: {error}")
        if self._offline or self._heard is None:
            self._say(self._offline or _UNHEARD)
        elif self._now - self._heard > self._patience():
            self._say("it tells nothing any more")
        if self._again is not None and self._now >= self._again:
            self._again = None
            self._act()
        self._speak()
        finished, self._finished = self._finished, False
        return self._slot if finished and self.action else 0

    def retry(self) -> None:
        """The box could not be taken or given: the vehicle tries again in a second."""
        self._again = self._now + _REPEATED

    def _take(self, topic: str, payload: bytes) -> None:
        if topic == CONNECTION:
            online = self._connections(payload).connectionState
            self._offline = "" if online == "ONLINE" else f"it is {online}"
            if not self._offline:
                self._states.forget()
                self._sheets.forget()
                self._sheet = None
        elif topic == FACTSHEET:
            self._sheet = self._sheets(payload)
        elif topic == STATE:
            self._hold(self._states(payload))

    def _hold(self, state: State) -> None:
        """Takes what it tells of itself."""
        fault = order_fault(state, self.orders)
        if fault:
            raise MessageError("invalid", fault)
        ours = bool(state.orderId) and state.orderId == self.orders.order_id
        reached, path = self._reached, self.path
        if self._known and ours:
            reached = progress(state, self.orders, self._reached)
            path = path[sum(stop.new for stop in self.orders.stops[self._reached + 1 : reached + 1]) :]
        elif not (self._known and self._taken < 0 and is_idle(state) and state.lastNodeId == path[0]):
            self._find(state)
            return
        self._see(state)
        trouble = condition(state) or self._astray(state, path)
        if not trouble:
            self._note(state)
            self.path, self._reached = path, reached
            if ours:
                self._taken = max(self._taken, state.orderUpdateId)
                self._look_at_action(state)
        self._say(trouble or self._unfit())

    def _find(self, state: State) -> None:
        """Takes up a vehicle that has no order of this process: it must stand at a node that it may be at."""
        self._known = False
        self._see(state)
        trouble = condition(state)
        if not trouble and not is_idle(state):
            trouble = f"it carries out order {state.orderId!r}, which is not in force"
            self._ask("cancelOrder", orderId=state.orderId)
        trouble = trouble or self._misplaced(state)
        if not trouble:
            self._note(state)
            self.path = self.path[self.path.index(state.lastNodeId) :] if self._found else [state.lastNodeId]
            self._known = self._found = True
            self._restart()
        self._say(trouble or self._unfit())

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

    def _unfit(self) -> str:
        """Why it cannot be one of the line, as far as it has told what it is; "" if it can."""
        return "it has told no factsheet yet" if self._sheet is None else factsheet_fault(self._sheet)

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
        self._look_at_order()

    def _look_at_order(self) -> None:
        """Whether another order has begun, of which it has taken nothing yet."""
        if self.orders.order_id != self._order:
            self._order, self._reached, self._taken = self.orders.order_id, 0, -1

    def _see(self, state: State) -> None:
        """It is there, wherever it is."""
        at = state.mobileRobotPosition
        self._heard, self._offline = self._now, ""
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
            self._again = self._now + _REPEATED
            log.warning("%s: it could not %s; it tries again", self.plan.name, found.actionType)

    def _astray(self, state: State, path: list[str]) -> str:
        """Why it is not where it should be; a vehicle that leaves its way is paused until it is back."""
        fault = place_fault(state, self._around.zone, self._around.track, path[0], path[min(1, len(path) - 1)])
        if fault:
            self._paused = True
            self._ask("startPause")
        elif self._paused:
            self._paused = False
            self._link.instant(self.orders.instant("stopPause", self._now))
        return fault

    def _act(self) -> None:
        """Releases what is to be done where it stands."""
        self.orders.act(self.path[-1], self.action, self._around.place(self._slot), self.box)
        self._look_at_order()

    def _withdraw(self) -> None:
        """What it was told to do is not to be done any more (6.1.3)."""
        order = self.orders.order_id
        self.orders.end()
        self._known = False
        self._asked_at = -SILENT
        self._ask("cancelOrder", orderId=order)

    def _speak(self) -> None:
        """Sends what is new, when it has taken what came before, or again what it has not taken."""
        if self._sheet is None:
            if self._now - self._sheet_at >= _ASKED and self._heard is not None:
                self._sheet_at = self._now
                self._link.instant(self.orders.instant("factsheetRequest", self._now))
            return
        least = max(self._sheet.protocolLimits.timing.minimumOrderInterval, CYCLE)
        since = self._now - self._sent_at
        if not self._known or self.trouble or since < least:
            return
        if self.orders.order_id and self._taken < self.orders.update:
            if since >= _RESENT:
                self._link.order(self.orders.message(self._first, self._now))
                self._sent_at = self._now
        elif self.orders.has_new:
            self._first = max(self.orders.sent - 1, 0)
            self._link.order(self.orders.next(self._now))
            self._sent_at = self._now

    def _ask(self, kind: str, **parameters: str) -> None:
        """Has it do something at once, again only after a while."""
        if self._now - self._asked_at >= _ASKED:
            self._asked_at = self._now
            self._link.instant(self.orders.instant(kind, self._now, **parameters))

    def _patience(self) -> float:
        """Time without a state after which it counts as absent, s."""
        usual = None if self._sheet is None else self._sheet.protocolLimits.timing.defaultStateInterval
        return min(SILENT, max(1.0, 3.0 * usual)) if isinstance(usual, float) else SILENT

    def _say(self, trouble: str) -> None:
        if trouble != self.trouble:
            log.warning("%s: %s", self.plan.name, trouble or "it is well again")
        self.trouble = trouble
