"""A bridge that was away answers the newest sample alone, also while those that it missed are still coming in."""

import threading
import time
from pathlib import Path

import pytest

from dtwin.bus.opening import open_peer
from dtwin.bus.session import Bus
from dtwin.services.parts import recent
from dtwin.services.parts.answering import connection
from dtwin.services.parts.gate import STALE
from dtwin.services.parts.state_file import StateFile
from dtwin.signals import Sensors, Voltages
from tests.services.test_settings_last import Device, Loop, Peer, bridged
from tests.services.test_stop_lasts import PATIENCE
from tests.support.ports import free_port
from tests.support.waiting import until

AWAY = 5
"""Number of the answer in which the bridge is held."""


def test_of_a_backlog_only_the_newest_sample_is_answered(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    answered: list[int] = []
    away, back = threading.Event(), threading.Event()

    class Held(Loop):
        def answer(self, sensors: Sensors) -> Voltages:
            answered.append(sensors.sequence)
            if len(answered) == AWAY:
                away.set()
                back.wait(PATIENCE)
            return super().answer(sensors)

    monkeypatch.setattr(connection, "ControlLoop", lambda address, patience: Held(Device()))
    meet = f"tcp/127.0.0.1:{free_port()}"
    with Bus(open_peer(meet)) as bus, bridged(meet, StateFile(tmp_path / "settings")):
        peer = Peer(bus)
        peer.until(away.is_set, "the bridge is held")
        began = time.monotonic()
        peer.until(lambda: time.monotonic() > began + 2 * STALE, "it has been away for long enough")
        # Longer than a busy machine keeps the publisher waiting.
        monkeypatch.setattr(recent, "PAUSE", 0.5)
        monkeypatch.setattr(recent, "CATCHING_UP", PATIENCE)
        back.set()
        for _ in range(200):
            peer.sample()
        until(lambda: len(answered) > AWAY, "the bridge answers again")
        assert answered[AWAY:] == [peer.tick]
