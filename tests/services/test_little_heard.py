"""Services that only wait hear nothing every tick: what they are sent costs the senders as much as themselves."""

import subprocess
import sys
import time
from pathlib import Path

from dtwin.bus.messages import ACTED, SENSORS, TICKS, VOLTAGES
from dtwin.bus.opening import open_peer
from dtwin.bus.session import Bus
from dtwin.console.clocks import Clocks
from dtwin.console.hub import Hub
from dtwin.identification.store import ModelStore
from dtwin.parameters import ROOT
from dtwin.services.identification import Identification
from dtwin.services.service import Link, Service
from tests.support.ports import free_port
from tests.support.waiting import until

PROMPT = (SENSORS, VOLTAGES, ACTED)


def test_an_identification_that_waits_and_a_console_without_readers_hear_of_every_tick_only_afterwards(
    tmp_path: Path,
) -> None:
    meet = f"tcp/127.0.0.1:{free_port()}"
    with Bus(open_peer(meet)) as cell, Service("identification", Link(meet=meet)) as service:
        Identification(service, ModelStore(tmp_path), None, 0.2)
        after, *prompt = (cell.publisher(topic) for topic in (TICKS, *PROMPT))
        until(lambda: after.wanted, "the identification follows the cell")
        hub = Hub(service.bus, "cell", "arm", Clocks(time.monotonic, time.time))
        hub.listen()
        assert not any(publisher.wanted for publisher in prompt)
        hub.follow_path(True)
        until(lambda: all(publisher.wanted for publisher in prompt), "a reader sees each sample at once")
        hub.follow_path(False)
        until(lambda: not any(publisher.wanted for publisher in prompt), "the last reader has gone")
        hub.close()


def test_zenoh_works_in_one_thread_of_a_service() -> None:
    """By default it has one that waits at sockets, one or two that read, one that writes and one for all else."""
    code = (
        "from pathlib import Path\n"
        "from dtwin.services.service import Link, Service\n"
        "from tests.support.waiting import until\n"
        "def names():\n"
        "    return {(task / 'comm').read_text().strip() for task in Path('/proc/self/task').iterdir()}\n"
        f"with Service('console', Link(meet='tcp/127.0.0.1:{free_port()}')) as service:\n"
        "    service.ready()\n"
        "    until(lambda: 'app-0' in names(), 'a thread has its name')\n"
        "    print(*sorted(names()))\n"
    )
    said = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, timeout=60)
    names = set(said.stdout.split())
    assert "app-0" in names, said.stderr
    assert not {name for name in names if name.startswith(("rx-", "tx-", "acc-", "net-"))}
