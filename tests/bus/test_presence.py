"""Liveliness tokens of a cell with a key, and those that somebody else declares."""

from __future__ import annotations

import pytest

from dtwin.bus.messages import ALIVE
from dtwin.bus.opening import open_peer
from dtwin.bus.presence import token
from dtwin.bus.session import Bus
from dtwin.bus.signature import new_key
from tests.support.ports import free_port
from tests.support.waiting import until


@pytest.mark.parametrize("proof", [None, "", "00", 24 * "00", "another cell's"])
def test_nobody_announces_a_service_without_the_key(proof: str | None) -> None:
    meet, key = f"tcp/127.0.0.1:{free_port()}", new_key()
    seen: list[tuple[str, bool]] = []
    with Bus(open_peer(meet), key=key) as watcher, Bus(open_peer(meet), key=key) as service:
        watcher.watch_alive(lambda name, alive: seen.append((name, alive)))
        forged = watcher.key(ALIVE, "bridge")
        if proof == "another cell's":
            forged = token(forged, new_key())
        elif proof:
            forged += f"/{proof}"
        with open_peer(meet) as stranger:
            declared = stranger.liveliness().declare_token(forged)
            until(lambda: watcher.refused.total() > 0, "the token is refused")
            service.announce("emulator")
            until(lambda: seen, "a service of the cell is there")
            declared.undeclare()
            until(lambda: watcher.refused.total() > 1, "the end of the token is refused, too")
    assert {name for name, _ in seen} == {"emulator"}


def test_a_copied_token_does_not_hide_that_its_service_starts_again() -> None:
    meet, key = f"tcp/127.0.0.1:{free_port()}", new_key()
    seen: list[tuple[str, bool]] = []
    copied: list[str] = []
    with Bus(open_peer(meet), key=key) as watcher, open_peer(meet) as stranger:
        stranger.liveliness().declare_subscriber(
            watcher.key(ALIVE, "**"), lambda sample: copied.append(str(sample.key_expr))
        )
        watcher.watch_alive(lambda name, alive: seen.append((name, alive)))
        with Bus(open_peer(meet), key=key) as first:
            first.announce("emulator")
            until(lambda: copied and seen, "the first life is seen")
            kept = stranger.liveliness().declare_token(copied[0])
        with Bus(open_peer(meet), key=key) as second:
            second.announce("emulator")
            until(lambda: len(seen) == 2, "the second life is told")
            kept.undeclare()
    assert seen[:2] == [("emulator", True), ("emulator", True)]
