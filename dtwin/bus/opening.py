"""Opens Zenoh sessions: among peers of this machine, or after a configuration file.

Without a configuration file the sessions are peers on the loopback interface and need no broker. The first session
listens at the rendezvous endpoint and accepts the others, which then learn of each other and connect directly. When
the first one ends, the others stay connected and the next new session listens in its place. There is no discovery by
multicast.
"""

from __future__ import annotations

import errno
import json
import logging
import re
import socket
import threading
from collections.abc import Mapping
from concurrent.futures import Future
from pathlib import Path
from typing import Final

import zenoh

from dtwin.errors import CommunicationError

log = logging.getLogger(__name__)

RENDEZVOUS: Final = "tcp/127.0.0.1:7461"
"""Endpoint at which services meet unless they are told another one."""
EXPLAIN: Final = 2.0
"""Time that joining may take before its error is logged, s."""
_TRANSPORT_LIMIT: Final = 1 << 20
"""Largest message that a session reassembles from the fragments of a peer, bytes."""
_LOG: Final = (
    "off,zenoh_config=error,zenoh_link=error,zenoh_transport=error,zenoh::net::runtime::orchestrator=error,"
    "zenoh::net::routing::interceptor=error"
)
"""What Zenoh may log: what its user can do something about, such as an address, a certificate or a rule. The rest
tells of messages that were on their way to, or from, a session that has just closed, and of what strangers send."""
_WAITING: Final = 16
"""Urgent messages that may wait while a busy machine does not let their sender run, the most that Zenoh allows. With
its usual two, samples are lost while others work."""
_RETRY: Final = {"period_init_ms": 100, "period_max_ms": 1000, "period_increase_factor": 2}
_TLS_FILES: Final = tuple(
    f"transport/link/tls/{name}"
    for name in (
        "root_ca_certificate",
        "listen_certificate",
        "listen_private_key",
        "connect_certificate",
        "connect_private_key",
    )
)


def open_peer(rendezvous: str = RENDEZVOUS) -> zenoh.Session:
    """Opens a session without a file: a peer that meets others at an endpoint such as tcp/HOST:PORT.

    Raises:
        CommunicationError: the text is no endpoint of this machine.
    """
    taken = _taken(rendezvous)
    spoke = _peer([f"{rendezvous.rpartition(':')[0]}:0"], [rendezvous])
    if taken:
        return _open(spoke)
    try:
        return _open(_peer([rendezvous], []))
    except CommunicationError:
        # Another session has bound the endpoint in the meantime.
        if not _taken(rendezvous):
            raise
        return _open(spoke)


def _taken(endpoint: str) -> bool:
    """Whether a TCP endpoint is in use already."""
    match = re.fullmatch(r"tcp/(\d+(?:\.\d+){3}):(\d{1,5})", endpoint)
    if match is None or not 0 < int(match[2]) < 65536:
        raise CommunicationError(f"{endpoint!r}: expected an endpoint such as {RENDEZVOUS}")
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((match[1], int(match[2])))
        except OSError as error:
            if error.errno == errno.EADDRINUSE:
                return True
            raise CommunicationError(f"{endpoint}: {error.strerror}") from None
    return False


def open_configured(path: Path, *names: str) -> zenoh.Session:
    """Opens a session with a Zenoh configuration file.

    In a folder the file is the first `NAME.json5` that is there, else `service.json5`. Paths of certificates and keys
    are relative to the file. While the session joins, which may take for ever, signals are handled as at any other
    time.

    Raises:
        CommunicationError: the file is missing or is no Zenoh configuration, or the session cannot be opened.
    """
    file = _file(path, *names)
    opened = threading.Event()

    def explain() -> None:
        """Logs why joining fails: Zenoh retries silently, a session that gives up names the error."""
        while not opened.wait(EXPLAIN):
            hasty = _configuration(file)
            hasty.insert_json5("connect/exit_on_failure", "true")
            hasty.insert_json5("connect/timeout_ms", "0")
            try:
                zenoh.open(hasty).close()
            except zenoh.ZError as error:
                log.warning("cannot join yet: %s Is a router there, and does it take the certificate?", _line(error))

    configuration = _configuration(file)
    threading.Thread(target=explain, name="explain", daemon=True).start()
    try:
        return _open_apart(configuration)
    finally:
        opened.set()


def open_settings(settings: Mapping[str, object]) -> zenoh.Session:
    """Opens a session with settings of Zenoh, by their paths.

    Raises:
        CommunicationError: they are none, or the session cannot be opened.
    """
    configuration = zenoh.Config()
    try:
        for key, value in settings.items():
            configuration.insert_json5(key, json.dumps(value))
    except zenoh.ZError as error:
        raise CommunicationError(f"no Zenoh configuration: {_line(error)}") from None
    return _open(configuration)


def _open_apart(configuration: zenoh.Config) -> zenoh.Session:
    """Opens a session on another thread: Zenoh may wait for ever, and a handler of Python would wait with it."""
    opened: Future[zenoh.Session] = Future()

    def open_it() -> None:
        try:
            opened.set_result(_open(configuration))
        except CommunicationError as error:
            opened.set_exception(error)

    threading.Thread(target=open_it, name="open", daemon=True).start()
    return opened.result()


def has_certificates(path: Path, name: str) -> bool:
    """Whether the configuration that `open_configured` takes has certificates of TLS.

    Raises:
        CommunicationError: the file is missing or is no Zenoh configuration.
    """
    configuration = _configuration(_file(path, name))
    return any(json.loads(configuration.get_json(key)) for key in _TLS_FILES)


def _file(path: Path, *names: str) -> Path:
    if not path.is_dir():
        return path
    files = [path / f"{name}.json5" for name in (*names, "service")]
    return next((file for file in files if file.is_file()), files[-2])


def _configuration(file: Path) -> zenoh.Config:
    try:
        configuration = zenoh.Config.from_file(file)
        for key in _TLS_FILES:
            relative = json.loads(configuration.get_json(key))
            if relative:
                path = file.resolve().parent / relative
                if not path.is_file():
                    raise CommunicationError(f"{file}: {path} is missing: see scripts/certificates")
                configuration.insert_json5(key, json.dumps(str(path)))
    except zenoh.ZError as error:
        raise CommunicationError(f"{file}: no Zenoh configuration: {_line(error)}") from None
    return configuration


def _peer(listen: list[str], connect: list[str]) -> zenoh.Config:
    settings = {
        "mode": "peer",
        "scouting": {"multicast": {"enabled": False}},
        "listen": {"endpoints": listen, "exit_on_failure": True},
        "connect": {"endpoints": connect, "exit_on_failure": False, "timeout_ms": -1, "retry": _RETRY},
        # Shared memory would let large messages past the limit.
        "transport": {
            "link": {"rx": {"max_message_size": _TRANSPORT_LIMIT}},
            "shared_memory": {"enabled": False},
        },
    }
    try:
        return zenoh.Config.from_json5(json.dumps(settings))
    except zenoh.ZError as error:
        raise CommunicationError(f"expected Zenoh endpoints such as {RENDEZVOUS}: {_line(error)}") from None


def _open(configuration: zenoh.Config) -> zenoh.Session:
    zenoh.init_log_from_env_or(_LOG)
    configuration.insert_json5("transport/link/tx/queue/size/real_time", str(_WAITING))
    try:
        return zenoh.open(configuration)
    except zenoh.ZError as error:
        raise CommunicationError(f"cannot open a Zenoh session: {_line(error)}") from None


def _line(error: Exception) -> str:
    """The text of an error of Zenoh without the lines of its source code."""
    return " ".join(re.sub(r" at /\S+", "", str(error)).split())
