"""Shows a cell to its operators on a web page, and passes their commands on to the bus.

The main thread keeps the service going; the web server has a thread of its own.
"""

from __future__ import annotations

import getpass
import logging
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final

from dtwin.bus.session import Bus
from dtwin.errors import ParameterError
from dtwin.run.options import CellFileOption
from dtwin.services.runfile import LINE
from dtwin.services.service import Link, Service, main

if TYPE_CHECKING:
    from dtwin.console.clocks import Clocks
    from dtwin.console.commands import Files
    from dtwin.console.console import Console
    from dtwin.console.hub import Hub
    from dtwin.console.people.audit import Audit
    from dtwin.console.people.users import Users
    from dtwin.console.web.listening import Bound, Web

log = logging.getLogger(__name__)

NAME: Final = "console"
MISSING: Final = "the console needs packages that are not installed: pip install 'dtwin[console]'"


@dataclass(frozen=True, kw_only=True)
class ConsoleOptions(CellFileOption):
    """Where a console listens, who may use it, and what it reads."""

    listen: str = "127.0.0.1"
    """Address to listen at; beyond loopback TLS and users are needed."""
    port: int = 0
    """TCP port to listen at, a free one if not given."""
    certificate: Path | None = None
    """File of the TLS certificate, PEM."""
    key: Path | None = None
    """File of the private key of the certificate, PEM."""
    users: Path | None = None
    """File of those who may log in, which `dtwin console user` makes; on loopback nobody need log in without it."""
    audit: Path = Path("console-audit.jsonl")
    """File that every command is appended to."""
    alarms: Path = Path("console-alarms.jsonl")
    """Journal of the alarms."""
    store: Path = Path("identified")
    """Folder of the identified models."""
    history: Path = Path("uploads.jsonl")
    """History of the settings."""
    recordings: Path | None = None
    """Folder of the logs that can be replayed."""
    viewer: str = ""
    """Address of the Rerun viewer that shows the arm in 3D, as a page."""

    @contextmanager
    def bound(self) -> Iterator[Bound]:
        """The port, which is taken before the bus is joined.

        Raises:
            DtwinError: an option cannot be used, the port cannot be had, or a package is missing.
        """
        try:
            from dtwin.console.web.listening import Listening  # the packages of the web server are an extra
        except ImportError:
            raise ParameterError(MISSING) from None
        listening = Listening(
            host=self.listen, port=self.port, certificate=self.certificate, key=self.key, viewer=self.viewer
        )
        listening.check(self.users is not None)
        bound = listening.bind()
        with bound.sock:
            yield bound

    def hub(self, bus: Bus, cell: str, arm: str, clocks: Clocks) -> Hub:
        """What gathers what the cell says, or the line, which has `line` in the place of the arm.

        Raises:
            DtwinError: the file of the cell cannot be used.
        """
        from dtwin.console.hub import Hub
        from dtwin.console.line.hub import LineHub

        if arm == LINE:
            return LineHub(bus, cell, clocks)
        return Hub(bus, cell, arm, clocks, self.task())

    def console(self, bus: Bus, hub: Hub, clocks: Clocks, audit: Audit, files: Files, users: Users | None) -> Console:
        """The console of a hub.

        Raises:
            RecordingError: the journal of the alarms cannot be read.
        """
        from dtwin.console.annunciator import Annunciator
        from dtwin.console.console import Console
        from dtwin.console.line.annunciator import LineAnnunciator
        from dtwin.console.line.console import LineConsole
        from dtwin.console.line.hub import LineHub

        user = getpass.getuser()
        if isinstance(hub, LineHub):
            return LineConsole(bus, hub, clocks, audit, files, users, user, LineAnnunciator(self.alarms))
        return Console(bus, hub, clocks, audit, files, users, user, Annunciator(self.alarms))

    @contextmanager
    def serving(self, bound: Bound, bus: Bus, cell: str, arm: str) -> Iterator[Web]:
        """The web server while it listens.

        Raises:
            DtwinError: an option cannot be used.
        """
        from dtwin.console.clocks import Clocks
        from dtwin.console.commands import Files
        from dtwin.console.people.audit import Audit
        from dtwin.console.people.users import Users
        from dtwin.console.web.listening import Web

        users = None if self.users is None else Users(self.users)
        if users is not None:
            users.read()
        clocks = Clocks(time.monotonic, time.time)
        hub = self.hub(bus, cell, arm, clocks)
        files = Files(self.store, self.history, self.recordings)
        console = self.console(bus, hub, clocks, Audit(self.audit), files, users)
        web = Web(console, bound)
        hub.listen()
        try:
            yield web
        finally:
            web.close()
            hub.close()


@dataclass(frozen=True, kw_only=True)
class Options(ConsoleOptions, Link):
    """Show a running cell to its operators on a web page."""

    def run(self) -> int:
        with (
            self.bound() as bound,
            Service(NAME, self) as service,
            self.serving(bound, service.bus, self.cell, self.arm) as web,
        ):
            log.info("the console is at %s", web.address)
            service.ready()
            while not service.stopping:
                service.next(0.2)
                if service.report_due():
                    service.report("running")
        return 0


if __name__ == "__main__":
    sys.exit(main(NAME, Options))
