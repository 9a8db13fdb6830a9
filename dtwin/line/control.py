"""The control of a line: all blocks on one resource, a resource for each device, or devices elsewhere.

On one resource they run as machine code where it can be had. On many they talk by PUBLISH and SUBSCRIBE blocks, in
process; a message is handed over when the one before it has been read, until nobody has anything left to do.
"""

from __future__ import annotations

import itertools
from collections import deque
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final, Protocol

from dtwin.controller.ports import BLOCKS
from dtwin.controller.runtime import running
from dtwin.errors import CommunicationError
from dtwin.line.line import CYCLE, MOST_OPERATIONS, Assignment, Line, ZonePlan
from dtwin.line.plant import Plant
from dtwin.line.situation import Situation
from dtwin.line.system import RESOURCE, on_one_resource, plant_of, setup_of, system
from dtwin.line.vehicle import VehicleCommand
from iec61499.library import Library
from iec61499.mapping import resource_network
from iec61499.model import BasicFBType
from iec61499.native.resource import NativeResource
from iec61499.runtime.communication import Channel, CommunicationPort, LocalTransport, Values
from iec61499.runtime.resource import Resource

_HALF: Final = 2**31
"""Half the range of the numbers of samples, which are DINT."""
_SET_UPS: Final = 100
"""Numbers by which a zone is ahead of the plant at most, one for each set-up between two samples."""
_MESSAGES: Final = 1000
"""Most messages that may follow from one sample."""


class Exchange(Protocol):
    """What a client of the blocks can do."""

    def exchange(self, block: str, values: Sequence[Any]) -> tuple[Any, ...]:
        """Sends values to a SERVER block and returns its answer. Raises CommunicationError."""

    def now(self) -> Any:
        """The state of the blocks between two samples, for `resume`; None where nobody can tell."""

    def resume(self, now: Any) -> None:
        """Goes back to a state of blocks of the same kind for the same line."""


class OneResource:
    """All blocks of a line on one resource.

    Args:
        line: the line.
        blocks: folder of the function-block library.

    Raises:
        FunctionBlockError: the library cannot be used.
    """

    def __init__(self, line: Line, blocks: Path = BLOCKS) -> None:
        library = Library([blocks])
        network = resource_network(library.complete(on_one_resource(system(line))))
        self._resource = running(network, library)
        self._servers = {name: self._resource.server(name) for name in servers(line)}
        self._resource.start()
        self._begun = self._resource.snapshot()
        self._at_first: dict[str, Any] = {}

    def exchange(self, block: str, values: Sequence[Any]) -> tuple[Any, ...]:
        return self._servers[block].exchange(values)

    def now(self) -> Any:
        return self._resource.snapshot()

    def resume(self, now: Any) -> None:
        self._resource.restore(now)

    def memory(self) -> dict[str, Any] | None:
        """Variables and charts that are otherwise than at the beginning; None where these are not machine code."""
        if not isinstance(self._resource, NativeResource):
            return None
        if not self._at_first:
            now = self.now()
            self.resume(self._begun)
            self._at_first = _values(self._resource)
            self.resume(now)
        return {name: value for name, value in _values(self._resource).items() if value != self._at_first[name]}

    def recall(self, memory: Mapping[str, Any]) -> Any:
        """The state of blocks that have such a memory. Raises FunctionBlockError: there are no such blocks."""
        self.resume(self._begun)
        if isinstance(self._resource, NativeResource):
            self._resource.recall(memory)
        return self.now()


def _values(resource: NativeResource) -> dict[str, Any]:
    """The values of all variables, and the states of all charts, by their names."""
    values = {f"{block}.{name}": value for block, own in resource.states().items() for name, value in own.items()}
    charts = [f"{name}.$ECC" for name in resource.names() if isinstance(resource.block_type(name), BasicFBType)]
    return values | {name: resource.read(name) for name in charts}


class Devices:
    """The blocks of a line, each on the resource of its device.

    Args:
        line: the line.
        blocks: folder of the function-block library.

    Attributes:
        resources: the resources by the names of their devices.

    Raises:
        FunctionBlockError: the library cannot be used.
    """

    def __init__(self, line: Line, blocks: Path = BLOCKS) -> None:
        library, transport = Library([blocks]), _Post()
        whole = library.complete(system(line))
        self.resources = {
            device.name: Resource(resource_network(whole, f"{device.name}.{RESOURCE}"), library, transport)
            for device in whole.devices
        }
        self._post = transport
        self._answers: dict[str, list[tuple[Any, ...]]] = {}
        self._ports = {}
        for resource in self.resources.values():
            names = set(resource.states())
            for name in set(servers(line)) & names:
                answers = self._answers[name] = []
                self._ports[name] = resource.port(name)
                self._ports[name].attach(answers.append)
        for resource in self.resources.values():
            resource.start()
        self._settle()

    def exchange(self, block: str, values: Sequence[Any]) -> tuple[Any, ...]:
        answers = self._answers[block]
        answers.clear()
        self._ports[block].deliver(values)
        self._settle()
        if len(answers) != 1:
            raise CommunicationError(f"{block} answered {len(answers)} times to one request: expected one RSP")
        return answers[0]

    def now(self) -> Any:
        return {name: resource.snapshot() for name, resource in self.resources.items()}

    def resume(self, now: Any) -> None:
        for name, resource in self.resources.items():
            resource.restore(now[name])

    def _settle(self) -> None:
        """Lets the devices run, and hands over one message after the other, until none has anything left to do."""
        for _ in range(_MESSAGES):
            for resource in self.resources.values():
                if not resource.is_idle:
                    resource.run_until_idle()
            if not self._post.hand_over():
                return
        raise CommunicationError(f"the devices of the line do not come to rest within {_MESSAGES} messages")


class _Post:
    """Carries messages between devices in this process, first in first out, each when the one before was read.

    A SUBSCRIBE block has room for one message: what came while another one waits there would take its place.
    """

    def __init__(self) -> None:
        self._local = LocalTransport()
        self._waiting: deque[tuple[CommunicationPort, Values]] = deque()

    def open(self, port: CommunicationPort) -> Channel:
        return self._local.open(port, lambda values: self._waiting.append((port, values)))

    def hand_over(self) -> bool:
        """Hands the oldest message over; whether there was one."""
        if not self._waiting:
            return False
        port, values = self._waiting.popleft()
        if port.is_open:
            port.deliver(values)
        return True


def servers(line: Line) -> list[str]:
    """Names of the SERVER blocks of a line."""
    zones = [name for zone in line.zones for name in (plant_of(zone.name), setup_of(zone.name))]
    stations = [plant_of(station.name) for station in line.stations]
    vehicles = [plant_of(vehicle.name) for zone in line.zones for vehicle in zone.vehicles]
    return zones + stations + vehicles


class Control:
    """Exchanges samples and commands between a plant and the blocks, once a cycle.

    Args:
        line: the line.
        blocks: the running blocks.
        patient: whether the plant goes on while blocks do not answer: arms finish what they have, vehicles drive to
            the last node that was given to them. When they answer again they are told the set-up anew.

    Attributes:
        blocks: the running blocks.
        absent: names of the blocks that do not answer.
        stopped: names of the stations whose arms are stopped.
    """

    def __init__(self, line: Line, blocks: Exchange, patient: bool = False) -> None:
        self._line, self.blocks, self._patient = line, blocks, patient
        self.absent: set[str] = set()
        self._renewed = False
        self._assignment: Assignment = line.assignment
        self._counts: dict[str, int] = {}
        self._orders: dict[str, int] = {}
        self._done_by: dict[str, dict[str, str]] = {zone.name: {} for zone in line.zones}
        self._behind: dict[str, dict[str, str]] = {}
        self._first = self._number = 0
        self.stopped: set[str] = set()

    def set_up(self, assignment: Assignment) -> bool:
        """Tells the zones which station does which operation from now on.

        Returns:
            Whether they take it. A zone refuses what would keep boxes from leaving that can leave now; then all go on
            as before.

        Raises:
            ParameterError: the stations cannot do that.
            CommunicationError: a zone does not answer, and the control is not patient.
        """
        self._line.check_assignment(assignment)
        for place, zone in enumerate(self._line.zones):
            if not self._send_assignment(zone, assignment):
                for other in self._line.zones[:place]:
                    self._send_assignment(other, self._assignment)
                return False
        self._assignment = assignment
        return True

    def set_up_zone(self, number: int, share: Assignment) -> bool:
        """Tells one zone alone, by its number, the jobs that its stations do from now on; whether it takes that."""
        return self._send_assignment(self._line.zones[number], share)

    def now(self, plant: Plant) -> Situation | None:
        """How the line is between two cycles; None where the blocks cannot tell their state."""
        blocks = self.blocks.now()
        done_by = {name: dict(jobs) for name, jobs in self._done_by.items()}
        return None if blocks is None else Situation(plant.now(), dict(self._counts), done_by, blocks)

    def resume(self, now: Situation) -> None:
        """Goes on with blocks of the same kind from there."""
        self.blocks.resume(now.blocks)
        self._number = round(now.plant.time / CYCLE)
        self._counts = dict(now.set_ups)
        self._orders.clear()
        self._done_by = {name: dict(jobs) for name, jobs in now.done_by.items()}

    def _send_assignment(self, zone: ZonePlan, assignment: Assignment) -> bool:
        """Tells a zone; whether it takes it."""
        names = [station.name for station in zone.stations]
        own = {name: station for name, station in assignment.items() if station in names}
        behind = self._taken_over(zone, assignment, own)
        share = own | behind
        digits = dict.fromkeys((operation.name for operation in self._line.operations), 0)
        for job in self._line.jobs:
            station = share.get(job.name, "")
            digits[job.operation] += 10**job.kind * (zone.station(station) if station else 0)
        numbers = [*digits.values(), *[0] * (MOST_OPERATIONS - len(digits))]
        answer = self._ask(setup_of(zone.name), numbers)
        if answer is None:
            return False
        self._keep_ahead(answer[1])
        taken = answer[0] != self._counts.get(zone.name)
        self._counts[zone.name] = answer[0]
        if taken:
            self._done_by[zone.name] |= own
            self._behind[zone.name] = behind
        return taken

    def _taken_over(self, zone: ZonePlan, assignment: Assignment, own: Assignment) -> dict[str, str]:
        """What the stations of a zone still do, beside its own jobs, of those that a zone before it has taken over.

        Boxes never go back, so the zone goes on to do these with the boxes that have come to it before: at another
        station than the one that has lost them, where there is one, because its arm may no longer be able to.
        """
        names = [station.name for station in zone.stations]
        number, before = self._line.zones.index(zone), self._done_by[zone.name]
        found = {}
        for job in itertools.takewhile(lambda job: job.name not in own, self._line.jobs):
            at = assignment.get(job.name)
            if job.name in before and (at is None or self._line.zone_of(at) < number):
                able = [n for n in self._line.able(job.operation) if n in names and n not in self.stopped]
                others = [station for station in able if station != before[job.name]]
                found[job.name] = others[0] if others else before[job.name]
        return found

    def _goes_on_behind(self, station: str) -> bool:
        """Whether a station does something that a zone before its own has taken over."""
        return any(station in jobs.values() for jobs in self._behind.values())

    def _keep_ahead(self, answered: int) -> None:
        """Goes on behind the numbers of a zone, whose blocks may know a plant that was there before this one."""
        ahead = _wrapped(answered - self._number)
        if ahead > _SET_UPS:
            self._first += ahead

    def _ask(self, block: str, values: Sequence[Any]) -> tuple[Any, ...] | None:
        """The answer of a block; None of one that does not answer."""
        try:
            answer = self.blocks.exchange(block, values)
        except CommunicationError:
            if not self._patient:
                raise
            self.absent.add(block)
            return None
        if block in self.absent:
            self.absent.remove(block)
            self._renewed = True
        return answer

    def step(self, plant: Plant) -> None:
        """One cycle: all samples go to the blocks, and their answers to the plant.

        Raises:
            CommunicationError: a block does not answer, and the control is not patient.
        """
        if self._renewed:
            self._counts.clear()  # a zone that has begun anew counts its set-ups from the first
            self._renewed = not self.set_up(self._assignment)
        # by it all that follows from these samples is known as newer than before (fb/line/NEWEST_MESSAGE.fbt)
        number = self._number = _wrapped(self._first + round(plant.time / CYCLE))
        for place in plant.active:
            zone = self._line.zones[place]
            for station in zone.stations:
                tags, report = plant.station_tags(station.name), plant.stations[station.name].report
                if report.stop and station.name not in self.stopped and self._goes_on_behind(station.name):
                    self._renewed = True  # boxes that a zone before would do now are to be done by another one
                (self.stopped.add if report.stop else self.stopped.discard)(station.name)
                if answer := self._ask(plant_of(station.name), (*tags, report.arm, report.stop, number)):
                    plant.offer(station.name, *answer)
            for planned in zone.vehicles:
                vehicle = plant.vehicles[planned.name]
                sample = vehicle.sample()
                place_and_load = sample.at, sample.standing, plant.tag(vehicle.box), sample.battery
                if answer := self._ask(plant_of(planned.name), (*place_and_load, sample.base_end, number)):
                    node, action, slot, answered = answer
                    # what was given for an earlier sample may be somebody else's by now
                    vehicle.obey(VehicleCommand(node if answered == number else 0, action, slot))
            if answer := self._ask(plant_of(zone.name), (plant.entry_tag(place), plant.room(place), number)):
                self._keep_ahead(answer[1])
                if answer[0] < self._orders.get(zone.name, 0):  # it has begun anew between two samples
                    self._renewed = True
                self._orders[zone.name] = answer[0]


def _wrapped(number: int) -> int:
    """A number as DINT."""
    return (number + _HALF) % (2 * _HALF) - _HALF
