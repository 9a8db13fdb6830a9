"""Attacks on a secured cell by those who have no certificate, or not the right one."""

from __future__ import annotations

import subprocess
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, Final

from dtwin.bus.codec import encode
from dtwin.bus.messages import RESET, ResetRequest
from dtwin.bus.opening import open_settings
from dtwin.errors import CommunicationError
from dtwin.parameters import ROOT
from dtwin.services.service import free_port
from evidence.siege.stage import RECORDER, Stage


def _settings(mode: str, folder: Path, certificate: str | None) -> dict[str, object]:
    """The configuration of a session that shows a certificate, or none."""
    files = {
        f"{side}_{what}": str(folder / f"{certificate}.{ending}")
        for side in ("listen", "connect")
        for what, ending in (("certificate", "pem"), ("private_key", "key"))
    }
    tls = {"root_ca_certificate": str(folder / "ca.pem"), "enable_mtls": certificate is not None}
    return {
        "mode": mode,
        "listen": {"endpoints": []},
        "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": False}},
        "transport/link/tls": {**tls, **(files if certificate else {})},
    }


def _open(settings: dict[str, object]) -> Any:
    """The session, None if it cannot be opened."""
    try:
        return open_settings(settings)
    except CommunicationError:
        return None


def _connect(port: int) -> dict[str, object]:
    return {"endpoints": [f"tls/localhost:{port}"], "exit_on_failure": True, "timeout_ms": 2000}


def _certify(folder: Path, days: int, *names: str) -> None:
    script = ROOT / "scripts" / "certificates"
    environment = {"PATH": "/usr/local/bin:/usr/bin:/bin", "DAYS": str(days)}
    made = subprocess.run([script, folder, *names], env=environment, capture_output=True, text=True, check=False)
    if made.returncode:
        raise CommunicationError(f"{script}: {made.stderr.strip()}")


def _joins(mode: str, certificates: Callable[[Stage], Path], name: str | None, stage: Stage) -> str:
    """A session of the intruder joins the router and asks for a reset."""
    session = _open({**_settings(mode, certificates(stage), name), "connect": _connect(stage.port)})
    if session is None:
        return ""
    with session:
        found = session.get(stage.key(RESET.name), payload=encode(ResetRequest(5)), timeout=1.0)
        answered = any(reply.ok for reply in found)
        rightful = name == RECORDER and certificates is _own
        return "the cell begins anew" if answered else "" if rightful else "joins"


def _own(stage: Stage) -> Path:
    return stage.folder / "certificates"


def _foreign(stage: Stage) -> Path:
    """Certificates of another cell, but with this one's authority to trust."""
    folder = stage.folder / "foreign"
    if not folder.exists():
        _certify(folder, 30, RECORDER)
        (folder / "ca.pem").write_bytes((_own(stage) / "ca.pem").read_bytes())
    return folder


def _expired(stage: Stage) -> Path:
    """Certificates of this cell whose time is over."""
    folder = stage.folder / "expired"
    if not folder.exists():
        (stage.folder / "certificates-authority").rename(stage.folder / "expired-authority")
        try:
            _certify(folder, -1, RECORDER)
        finally:
            (stage.folder / "expired-authority").rename(stage.folder / "certificates-authority")
    return folder


def _poses(name: str, stage: Stage) -> str:
    """A router with somebody else's certificate: a service that is led to it must not join."""
    port = free_port()
    listen = {"endpoints": [f"tls/127.0.0.1:{port}"]}
    router = _open({**_settings("router", _own(stage), name), "listen": listen})
    if router is None:
        return ""
    with router:
        service = _open({**_settings("client", _own(stage), "operator"), "connect": _connect(port)})
        if service is None:
            return ""
        service.close()
        return "a service joins it"


INTRUSIONS: Final[dict[str, Callable[[Stage], str]]] = {
    "join without a certificate": partial(_joins, "client", _own, None),
    "join with another cell's certificate": partial(_joins, "client", _foreign, RECORDER),
    "join with an expired certificate": partial(_joins, "client", _expired, RECORDER),
    "join with the router's certificate": partial(_joins, "client", _own, "router"),
    "join as a router with the recorder's": partial(_joins, "router", _own, RECORDER),
    "be a router with the recorder's": partial(_poses, RECORDER),
    "be a router with the operator's": partial(_poses, "operator"),
}
"""What is tried, by its name."""
