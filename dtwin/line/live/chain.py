"""The arms of other stations on the bus, as in a cell of such an arm: samples and commands go out, and come in."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from dtwin.bus.chain.messages import JointCommands, JointSensors, JointTick, JointTicks
from dtwin.bus.messages import EVENTS, JOINT_COMMANDS, JOINT_SENSORS, JOINT_TICKS
from dtwin.bus.passed import PassedJoints
from dtwin.bus.session import Bus
from dtwin.errors import ParameterError
from dtwin.line.chain.rows import ArmRows, Row
from dtwin.line.live.heard import believed
from dtwin.names import counted
from dtwin.parameters import PERIOD
from dtwin.run.chain import ChainSettings
from dtwin.signals import Event


class ChainArmPublisher:
    """Publishes what the log of a station has got since the last call, and forgets it.

    Args:
        bus: session with the station in the place of an arm.
        log: log of the station.
    """

    def __init__(self, bus: Bus, log: ArmRows) -> None:
        self._log = log
        self._sensors, self._commands = bus.publisher(JOINT_SENSORS), bus.publisher(JOINT_COMMANDS)
        self._passed = PassedJoints(bus.publisher(JOINT_TICKS))
        self._event = bus.publisher(EVENTS)

    def publish(self, events: Sequence[Event]) -> None:
        """Publishes the new ticks, and events."""
        log = self._log
        wanted = self._sensors.wanted, self._commands.wanted
        for number, row in enumerate(log.rows(), log.forgotten):
            time = round(number * log.period, 9)
            sample = JointSensors(number, time, row.q, row.box)
            command = JointCommands(number, time, row.sent, row.target, row.gripped)
            if wanted[0]:
                self._sensors(sample)
            if wanted[1]:
                self._commands(command)
            self._passed.add(sample, command)
        log.forget(len(log))
        for event in events:
            self._event(event)


class ChainArmFollower:
    """Collects what is published of an arm of n joints in a log, which has no true positions.

    Args:
        bus: session with the station in the place of an arm.
        settings: what the arm is and does, as far as a twin knows it.
        put: called on a thread of Zenoh with what has come, for `take` on another one.

    Attributes:
        log: what has come; its rows are numbered as the arm's ticks.
    """

    def __init__(
        self,
        bus: Bus,
        settings: ChainSettings,
        put: Callable[[ChainArmFollower, tuple[JointTick, ...]], None],
    ) -> None:
        self._settings = settings
        self.log = ArmRows(settings)
        bus.subscribe(JOINT_TICKS, JointTicks, believed(self._check, lambda passed: put(self, passed.ticks)))

    def _check(self, passed: JointTicks) -> None:
        """Checks that ticks are of an arm with as many joints. Raises ParameterError."""
        joints = len(self._settings.arm)
        for tick in passed.ticks:
            for values in (tick.sensors.theta, tick.acted.commands, tick.acted.target):
                if len(values) != joints:
                    raise ParameterError(f"tick: expected {counted(joints, 'joint')}, got {len(values)}")

    def take(self, came: tuple[JointTick, ...]) -> None:
        """Takes ticks that have passed; after lost ones, or an arm that begins anew, the log begins with them."""
        for tick in came:
            sensors, acted = tick.sensors, tick.acted
            if sensors.sequence != len(self.log):
                self.log = ArmRows(self._settings, sensors.sequence)
            self.log.append(
                Row(sensors.theta, acted.target, acted.commands, sensors.theta, 0, sensors.box, acted.gripped)
            )

    def forget(self, seconds: float) -> None:
        """Forgets what is older than some seconds."""
        self.log.forget(len(self.log) - round(seconds / min(PERIOD, self.log.period)))
