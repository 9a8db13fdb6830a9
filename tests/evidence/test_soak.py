"""The table of troubles, what is made of it, and the network that can be cut."""

from __future__ import annotations

import signal
import socket
import subprocess
import sys
import threading
from pathlib import Path
from typing import cast

import pytest

from dtwin.bus.messages import Latency
from dtwin.errors import CommunicationError
from dtwin.services.runfile import find, folder
from dtwin.signals import BoxCounts, Event
from evidence.soak.cell import TroubledCell, dtwin
from evidence.soak.chaos import Borne, ChaosRun
from evidence.soak.latency import LatencyRun
from evidence.soak.proxy import Proxy
from evidence.soak.troubles import TROUBLES, Aftermath
from tests.support.desk import new_desk
from tests.support.waiting import until


def counts(arrived: int, picked: int, delivered: int, misplaced: int = 0, held: int = 0) -> BoxCounts:
    return BoxCounts(arrived, picked=picked, delivered=delivered, misplaced=misplaced, held=held)


def aftermath(after: BoxCounts, recovered: bool = True) -> Aftermath:
    return Aftermath(counts(3, 2, 2), after, (Event(1.0, "safe", "silence"),), recovered, 2.5)


def run(seen: Aftermath, *broken: str, same: bool = True, left: dict[str, int] | None = None) -> ChaosRun:
    return ChaosRun((Borne(TROUBLES[0], seen, not broken, broken),), same, 3, 100, left or {})


@pytest.mark.parametrize(
    ("after", "kept"),
    [
        (counts(4, 3, 3), True),
        (counts(4, 3, 2, held=1), True),
        (counts(4, 4, 2, misplaced=1, held=1), True),
        (counts(4, 3, 2), False),
        (counts(4, 3, 3, held=1), False),
        (counts(4, 2, 3), False),
        (counts(2, 2, 2), False),
        (counts(4, 1, 1), False),
    ],
)
def test_no_box_is_forgotten(after: BoxCounts, kept: bool) -> None:
    promise = next(promise for promise in TROUBLES[0].promises if promise.name == "count_kept")
    nobody = cast(TroubledCell, None)  # what is counted is all in the aftermath
    assert promise.kept(nobody, aftermath(after)) == kept


def test_troubles_have_names_of_their_own_and_promise_something() -> None:
    assert len({trouble.name for trouble in TROUBLES}) == len(TROUBLES)
    assert all(trouble.promises for trouble in TROUBLES)


def test_a_run_passes_only_when_every_promise_is_kept() -> None:
    seen = aftermath(counts(4, 3, 3))
    assert run(seen).passed
    assert not run(seen, "recovered").passed
    assert not run(seen, same=False).passed
    assert not run(seen, left={"bridge": 7}).passed
    figures = run(seen, "recovered").figures()["troubles"][0]
    assert (figures["safe"], figures["recovered"], figures["seconds"], figures["misplaced"]) == (True, True, 2.5, 0)
    assert "| kill controller | yes | 2.5 | 0 | recovered |" in run(seen, "recovered").report().text
    assert "| never |" in run(aftermath(counts(4, 3, 3), recovered=False)).report().text


def test_latency_is_held_against_what_is_promised() -> None:
    def found(p50: float, p99: float, late: float) -> bool:
        return LatencyRun(Latency(p50, p99, max=9.0, trend_per_minute=0.0), late, counts(1, 1, 1)).passed

    assert found(1.5, 5.0, 0.001)
    assert not found(1.6, 5.0, 0.001)
    assert not found(1.5, 5.1, 0.001)
    assert not found(1.5, 5.0, 0.002)


def test_nothing_passes_a_cut_network_and_nothing_is_lost() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        proxy = Proxy(server.getsockname()[1])
        with socket.create_connection(("127.0.0.1", proxy.port)) as near, server.accept()[0] as far:
            near.sendall(b"first")
            assert far.recv(100) == b"first"
            proxy.cut.set()
            near.sendall(b"second")
            far.settimeout(0.1)
            with pytest.raises(TimeoutError):
                far.recv(100)
            far.settimeout(10.0)
            threading.Timer(0.05, proxy.cut.clear).start()
            assert far.recv(100) == b"second"
        proxy.close()


def test_what_a_command_complains_of_is_told() -> None:
    with pytest.raises(CommunicationError, match="'no-such-cell' is not up"):
        dtwin("down", "--cell", "no-such-cell")


@pytest.mark.thorough
@pytest.mark.parametrize("ready", [False, True])
def test_a_storm_that_is_asked_to_end_leaves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, ready: bool
) -> None:
    made = tmp_path / "made"
    made.mkdir()
    monkeypatch.setenv("TMPDIR", str(made))
    command = [sys.executable, "-m", "dtwin", "experiment", "soak", "storm", "--out", str(tmp_path / "out")]
    with (
        new_desk() as desk,
        subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE) as storm,
    ):

        def has_come_so_far() -> bool:
            up = find(f"soak-{storm.pid}")
            return up is not None and (up.ready or not ready)

        until(has_come_so_far, "the cell is there", 120.0)
        storm.send_signal(signal.SIGTERM)
        _, said = storm.communicate(timeout=120)
        assert (storm.returncode, said) == (128 + signal.SIGTERM, b"")
        assert not desk.processes()
        assert not list(folder().iterdir())
    assert not list(made.iterdir())


def test_the_script_starts_the_experiment() -> None:
    script = (Path(__file__).resolve().parents[2] / "scripts" / "soak").read_text()
    assert 'exec "$python" -m dtwin experiment soak "$@"' in script
