"""`fb trace` and `fb replay`: what happened on a device, event by event."""

from __future__ import annotations

import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from iec61499.deploy.watched_trace import ResourceBlocks, WatchedEvents, resource_blocks
from iec61499.errors import ToolError, choices
from iec61499.files.project import project_of
from iec61499.library import Library
from iec61499.management.client import ManagementClient
from iec61499.mapping import resource_network
from iec61499.net.address import parse_stream_address
from iec61499.output import printable
from iec61499.trace.ctf import TraceWriter, read_trace
from iec61499.trace.replay import replay


@dataclass(frozen=True)
class FbTrace:
    """Record the events of a running device with their data, in the Common Trace Format; babeltrace2 FOLDER shows it.

    Of a device (4diac FORTE or `fb run`) the trace has what its watches tell at a reading: for every event how often
    it has come since the reading before, with the data and states of charts at the reading. So what happens between
    two readings is counted, but only its last data are seen, and its order is not. FORTE has watches if it was built
    with FORTE_SUPPORT_MONITORING; blocks whose types are not in the library are not seen.
    """

    what: tyro.conf.Positional[str]
    """HOST:PORT or unix:FOLDER/PORT of the device's management."""
    folder: tyro.conf.Positional[Path]
    """New folder for the trace."""
    duration: float = 60.0
    """Time to record, s, of the clock; Ctrl-C ends it sooner."""
    size: Annotated[int, tyro.conf.arg(metavar="MB")] = 200
    """Most megabytes of the trace; when it is full the oldest events give way, and are counted."""
    interval: float = 0.01
    """Time between two readings of a device, s."""
    resource: str = ""
    """Resource of the device; needed only if it has several."""
    only: tuple[str, ...] = ()
    """Blocks of the device to record; without it all, as far as the device has room for watches."""
    blocks: Path = Path()
    """Folder of the block types that the device has."""

    def execute(self) -> int:
        self.check()
        with ManagementClient(parse_stream_address(self.what)) as client:
            resource = self._resource(client)
            blocks = resource_blocks(client, resource, Library([self.blocks])).only(self.only)
            writer = self.writer({"device": self.what, "resource": resource})
            self._record(client, resource, blocks, writer)
        self.tell(writer)
        return 0

    def check(self) -> None:
        """Looks at the options. Raises ToolError."""
        if self.size < 1:
            raise ToolError(f"--size: expected at least 1 MB, got {self.size}")
        if not 0.001 <= self.interval < float("inf"):
            raise ToolError(f"--interval: expected at least 0.001 s, got {self.interval}")

    def writer(self, said: dict[str, str]) -> TraceWriter:
        """What writes the trace, which says of itself what is given."""
        return TraceWriter(self.folder, said, self.size * 1_000_000)

    def tell(self, writer: TraceWriter) -> None:
        """Prints how much has been recorded."""
        print(printable(f"{self.folder}: {writer.written} records"))
        if writer.dropped:
            print(f"the trace was full: the first {writer.dropped} records are left out")

    def _record(self, client: ManagementClient, resource: str, blocks: ResourceBlocks, writer: TraceWriter) -> None:
        try:
            watched = WatchedEvents(client, resource, blocks, writer)
            for problem, names in (("has no known type", blocks.unknown), ("is not watched", watched.refused)):
                if names:
                    more = f" and {len(names) - 3} more" if len(names) > 3 else ""
                    print(printable(f"{', '.join(names[:3])}{more} {problem}"), flush=True)
            came = 0
            began = time.monotonic()
            with suppress(KeyboardInterrupt):
                while time.monotonic() - began < self.duration:
                    came += watched.read(time.monotonic_ns() - int(began * 1e9))
                    time.sleep(self.interval)
            watched.close()
            print(f"{came} events")
        finally:
            writer.close()

    def _resource(self, client: ManagementClient) -> str:
        names = [block.name for block in client.blocks("")]
        if self.resource in names:
            return self.resource
        if self.resource or len(names) != 1:
            valid = choices(names) if names else "a device on which something is built"
            raise ToolError(f"--resource {self.resource or '?'}: expected {valid}")
        return names[0]


@dataclass(frozen=True)
class FbReplay:
    """Repeat a trace: the network gets what its service interface blocks issued then, and must do the same again.

    Stops at the first event that differs, with exit status 1, or where a chart enters a state. Constants that are
    others than in the trace are listed.
    """

    folder: tyro.conf.Positional[Path]
    """Folder of the trace."""
    system: Path
    """System (.sys) that is held against the trace."""
    resource: str = ""
    """Resource of the system, DEVICE.RESOURCE; needed only if it has several."""
    blocks: Path | None = None
    """Folder of the block types; without it the project of the system."""
    until: str = ""
    """BLOCK.STATE of a chart: the replay stops when the chart is in it for the first time."""

    def execute(self) -> int:
        library = Library([self.blocks or project_of(self.system)])
        network = resource_network(library.load_system(self.system), self.resource)
        found = replay(read_trace(self.folder), network, library, self.until)
        for name, then, now in found.constants:
            print(printable(f"{name} begins with {now!r}, in the trace with {then!r}"))
        stop = found.stop
        if stop is None:
            print(f"{found.count} events, all equal")
            return 0
        print(printable(f"event {stop.count + 1} at {stop.time / 1e9:.6f} s, {stop.event}: {stop.reason}"))
        return 0 if stop.is_breakpoint else 1
