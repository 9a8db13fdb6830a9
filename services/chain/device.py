"""The function blocks of an arm of n joints on a 4diac FORTE: put there by the bridge, which talks to their ports.

Blocks that shall begin anew are deployed anew. One thread steps them; others ask for their stop, or tell them what
was found.
"""

from __future__ import annotations

import logging
import math
import threading
import time
from collections.abc import Callable, Mapping
from contextlib import ExitStack, closing
from functools import partial
from typing import Any, Final

from dtwin.arm.adjustment import Adjustment
from dtwin.bus.chain.messages import JointCommands, JointSensors
from dtwin.controller.application import TIMEOUT, Application
from dtwin.controller.chain import application as chain
from dtwin.controller.ports import Port
from dtwin.errors import CommunicationError
from dtwin.signals import ARM_STATES, STOPS, ArmState, Stop
from iec61499.deploy.build import deploy, suited
from iec61499.deploy.plan import plan_deployment
from iec61499.library import Library
from iec61499.management.client import ManagementClient
from iec61499.mapping import device_network
from iec61499.net.address import Address
from iec61499.net.wire import Signature
from iec61499.types import BOOL, DINT, LREAL

log = logging.getLogger(__name__)

RESOURCE: Final = "EMB_RES"
PATIENCE: Final = 5.0
"""Time in which a FORTE has noticed that a client has gone, before it takes the next one, s."""
RETRY: Final = 0.05
"""Time between two attempts, s."""
_STOP: Final = f"{chain.STOP}.STOP"
_VERDICT: Final = Port(chain.VERDICT, chain.VERDICT_PORT, Signature([DINT, LREAL, BOOL]), Signature([DINT]))


class JudgedBlocks:
    """Blocks that hear verdicts on the arm and releases, and answer with the stop in force."""

    def now(self) -> Stop:
        """The stop in force."""
        return self.judge("nominal", 0.0)

    def judge(self, state: ArmState, confidence: float) -> Stop:
        """Sends a verdict on the arm and its probability."""
        return self._judge(state, confidence, release=False)

    def release(self) -> Stop:
        """Sends an operator's release."""
        return self._judge("nominal", 0.0, release=True)

    def _judge(self, state: ArmState, confidence: float, release: bool) -> Stop:
        """Sends both and returns the stop.

        Raises:
            CommunicationError: the blocks do not answer.
        """
        raise NotImplementedError


class DeviceBlocks(JudgedBlocks):
    """Blocks on a device, as the bridge uses them.

    Args:
        address: device management of the FORTE.
        joints: number of joints.
        values: gives the values of the inputs of blocks that begin.
        patience: longest wait for every answer, s.

    Attributes:
        stop: stop in force at the last sample.
        doubted: number of the first joint, from 1, whose readings are not believed; 0 for none.

    Raises:
        CommunicationError: the FORTE does not answer, or refuses.
    """

    def __init__(
        self,
        address: Address,
        joints: int,
        values: Callable[[], Mapping[str, Any]],
        patience: float = TIMEOUT,
    ) -> None:
        self._address = address
        self._patience = patience
        self._names = [chain.joint_name(k) for k in range(joints)]
        targets = (f"{name}.PATH.Q_D" for name in self._names)
        self._watched = (*targets, *(f"{name}.OBSERVER.DOUBT" for name in self._names), _STOP)
        self._values = values
        self._lock = threading.Lock()
        self._opened = ExitStack()
        self._adjustment: Adjustment | None = None
        self.stop: Stop = "none"
        self.doubted = 0
        self._deploy()

    def restart(self) -> None:
        """Deploys blocks that begin in the place of these."""
        with self._lock:
            self._deploy()

    def adjust(self, found: Adjustment) -> None:
        """Lets these blocks, and those that come in their place, count on what was found."""
        with self._lock:
            self._adjustment = found
            self._twin.exchange(found.message)

    def reckon_with(self, values: Mapping[str, float], another: bool = True) -> None:
        """As `ChainController.reckon_with`; no sample may be on its way meanwhile."""
        with self._lock:
            for name, value in values.items():
                self._application.write(name, value)
            if another:
                told = self._adjustment or Adjustment.none(len(self._names))
                self._twin.exchange(told.message)

    def step(self, sample: JointSensors) -> JointCommands:
        """The answer of the blocks to a sample.

        Raises:
            CommunicationError: it is late, lost or not finite.
        """
        with self._lock:
            answer = self._arm.exchange((*sample.theta, sample.box))
            *watched, stop = self._application.watched(self._watched)
        n = len(self._names)
        commands, grips, brakes = answer[:n], bool(answer[n]), tuple(map(bool, answer[n + 1 :]))
        if not all(map(math.isfinite, commands)):
            raise CommunicationError(f"{self._address}: expected finite commands, got {commands}")
        target, counts = watched[:n], watched[n:]
        self.stop, self.doubted = STOPS[int(stop)], chain.first_doubted(counts)
        return JointCommands(
            sample.sequence, sample.time, tuple(commands), tuple(target), grips, brakes if any(brakes) else ()
        )

    def _judge(self, state: ArmState, confidence: float, release: bool) -> Stop:
        with self._lock:
            (stop,) = self._verdict.exchange((ARM_STATES.index(state), confidence, release))
        return STOPS[int(stop)]

    def _deploy(self) -> None:
        self._opened.close()
        joints = len(self._names)
        made = chain.system("ARM", chain.network(joints), self._values())
        plan = partial(plan_deployment, RESOURCE, device_network(made), Library([chain.LIBRARY]), None)
        with _patiently(lambda: ManagementClient(self._address)) as client:
            deploy(client, suited(client, plan))
        arm = Port(chain.ARM, chain.PORT, *chain.messages(joints))
        twin = Port(chain.TWIN, chain.TWIN_PORT, chain.adjustment(joints), Signature([DINT]))
        with ExitStack() as opened:
            found = _patiently(lambda: Application(self._address, chain.APPLICATION, chain.ARM, self._patience))
            self._application = opened.enter_context(closing(found))
            self._application.watch(self._watched)
            self._arm, self._verdict, self._twin = (
                opened.enter_context(_patiently(partial(self._application.connect, port)))
                for port in (arm, _VERDICT, twin)
            )
            self._opened = opened.pop_all()
        if self._adjustment is not None:
            self._twin.exchange(self._adjustment.message)


def _patiently(connect: Callable[[], Any]) -> Any:
    """Connects once the FORTE listens, and has noticed that the client before has gone. Raises CommunicationError."""
    deadline = time.monotonic() + PATIENCE
    while True:
        try:
            return connect()
        except CommunicationError as error:
            if time.monotonic() > deadline:
                raise
            log.info("%s", error)
            time.sleep(RETRY)
