"""A network that can be cut."""

from __future__ import annotations

import socket
import threading
import time
from typing import Final

from dtwin.services.service import hurry

_LOOK: Final = 0.01
"""s between two looks at a cut network"""


class Proxy:
    """Passes TCP on to a port of this machine; while it is cut nothing passes, and no end of a connection is told.

    Args:
        target: the port.

    Attributes:
        port: where the proxy listens, on the loopback interface.
        cut: set while nothing passes.
    """

    def __init__(self, target: int) -> None:
        self.cut = threading.Event()
        self._target = target
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port: int = self._listener.getsockname()[1]
        threading.Thread(target=self._accept, daemon=True).start()

    def close(self) -> None:
        """Accepts no further connection."""
        self._listener.close()

    def _accept(self) -> None:
        hurry()  # A network waits for no processor.
        while True:
            try:
                near, _ = self._listener.accept()
            except OSError:
                return
            try:
                far = socket.create_connection(("127.0.0.1", self._target))
            except OSError:
                near.close()
                continue
            for source, sink in ((near, far), (far, near)):
                source.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                threading.Thread(target=self._pass, args=(source, sink), daemon=True).start()

    def _pass(self, source: socket.socket, sink: socket.socket) -> None:
        try:
            while data := source.recv(65536):
                while self.cut.is_set():
                    time.sleep(_LOOK)
                sink.sendall(data)
        except OSError:
            pass
        for end in (source, sink):
            end.close()
