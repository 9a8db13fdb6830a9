"""The viewer as a process: a page listens on the loopback interface only, and ends with whoever has it."""

import os
import signal
import subprocess
import sys
import urllib.request
from pathlib import Path

from dtwin.parameters import ROOT
from dtwin.view.viewer import Ports, ViewerProcess
from tests.support.ports import free_port
from tests.support.waiting import until


def listeners(*ports: int) -> set[str]:
    """The addresses, as the kernel writes them, at which something listens on these ports."""
    found = set()
    for table in ("tcp", "tcp6"):
        for line in Path(f"/proc/net/{table}").read_text().splitlines()[1:]:
            local, state = line.split()[1], line.split()[3]
            address, port = local.split(":")
            if state == "0A" and int(port, 16) in ports:
                found.add(address)
    return found


def test_a_page_is_served_on_the_loopback_interface_and_ends_when_it_is_closed() -> None:
    ports = Ports(free_port(), free_port())
    viewer = ViewerProcess("web", ports)
    try:
        until(lambda: listeners(ports.page), "the page is served")
        assert listeners(ports.page, ports.data) == {"0100007F"}
        with urllib.request.urlopen(ports.page_url, timeout=10) as page:
            assert b"rerun" in page.read().lower()
    finally:
        viewer.close()
    until(lambda: not listeners(ports.page, ports.data), "nothing listens any more")


def test_a_page_ends_when_whoever_has_it_is_killed() -> None:
    ports = Ports(free_port(), free_port())
    program = f"""
from dtwin.view.viewer import Ports, ViewerProcess
viewer = ViewerProcess("web", Ports({ports.page}, {ports.data}))
print("served", flush=True)
input()
"""
    holder = subprocess.Popen(
        [sys.executable, "-c", program],
        cwd=ROOT,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
    )
    assert holder.stdin is not None
    assert holder.stdout is not None
    with holder.stdin, holder.stdout:
        assert holder.stdout.readline() == b"served\n"
        os.kill(holder.pid, signal.SIGKILL)
        holder.wait()
    until(lambda: not listeners(ports.page, ports.data), "nothing listens any more")
