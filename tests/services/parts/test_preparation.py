"""Preparation within a service: one that had to compile is started again, without the memory of the compiler."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numba
import numpy as np
import pytest

from dtwin.bus.opening import open_peer
from dtwin.bus.session import Bus
from dtwin.services.parts.readiness.preparation import prepare
from dtwin.services.supervisor import AGAIN, PREPARED, Program, Supervisor
from dtwin.twin.compiled import kernel
from tests.support.ports import free_port
from tests.support.waiting import until

KEY = b"k" * 32


class Frame:
    """A service's frame as far as a preparation needs it."""

    def __init__(self, supervised: bool) -> None:
        self.supervised = supervised
        self.doing = ""
        self.stopping = False

    @contextmanager
    def interruptible(self) -> Iterator[None]:
        yield

    def report_due(self) -> bool:
        return False


@pytest.fixture
def fresh(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    """A kernel that nobody has compiled."""
    (tmp_path / "fresh.py").write_text("def double(x):\n    return 2.0 * x\n")
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path))
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.delitem(sys.modules, "fresh", raising=False)
    import fresh  # type: ignore[import-not-found]  # written above

    return kernel(fresh.double)


def test_who_had_to_compile_is_started_again(fresh: Any) -> None:
    frame: Any = Frame(supervised=True)
    with pytest.raises(SystemExit) as ended:
        prepare(frame, [("the work", lambda: fresh(1.0))])
    assert ended.value.code == AGAIN
    prepare(frame, [("the work", lambda: fresh(2.0))])
    assert frame.doing == ""


def test_who_starts_again_or_alone_goes_on(fresh: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    alone: Any = Frame(supervised=False)
    prepare(alone, [("the work", lambda: fresh(1.0))])
    monkeypatch.setenv(PREPARED, "1")
    again: Any = Frame(supervised=True)
    prepare(again, [("the work", lambda: fresh(np.float32(1.0)))])


def test_the_supervisor_starts_it_again_at_once_and_counts_no_restart(tmp_path: Path) -> None:
    lives = tmp_path / "lives"
    code = f"import os, sys; print(os.environ.get({PREPARED!r}), file=open({str(lives)!r}, 'a')); sys.exit({AGAIN})"
    with Bus(open_peer(f"tcp/127.0.0.1:{free_port()}"), key=KEY) as bus:
        supervisor = Supervisor(bus, [Program("work", [sys.executable, "-c", code])], KEY)
        supervisor.start()

        def looked(count: int) -> bool:
            supervisor.look()
            return lives.exists() and len(lives.read_text().split()) >= count

        until(lambda: looked(2), "it is started again")
        assert supervisor.summary().services["work"].restarts == 0
        # Who asks for it once more has not kept what it compiled: that is a failure like any other.
        until(lambda: looked(3), "it is started once more")
        assert supervisor.summary().services["work"].restarts == 1
        supervisor.stop()
    assert lives.read_text().split()[:3] == ["None", "1", "1"]
