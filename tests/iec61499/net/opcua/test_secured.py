"""OPC UA with certificates: two devices that know one another, and others that do not."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from ipaddress import IPv4Address
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import rsa
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from iec61499.errors import ToolError
from iec61499.net.settings import read_connections
from tests.iec61499.net.opcua.conftest import endpoint, run, serving, wait
from tests.support.iec61499.served_device import build

if TYPE_CHECKING:
    from asyncua import Client, ua
else:
    asyncua = pytest.importorskip("asyncua", reason="the extra opcua is not installed")
    Client, ua = asyncua.Client, asyncua.ua


def certify(folder: Path, name: str) -> None:
    """A key and a certificate of an application that it signs itself."""
    key = rsa.generate_private_key(65537, 2048)
    subject = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, name)])
    now = datetime.now(UTC)
    signs = x509.KeyUsage(
        *(True, True, True, True),  # signatures, commitment, and encipherment of keys and data
        *(False, False, False, False, False),
    )
    certificate = (
        x509.CertificateBuilder(subject, subject, key.public_key(), x509.random_serial_number())
        .not_valid_before(now - timedelta(hours=1))
        .not_valid_after(now + timedelta(hours=1))
        .add_extension(
            x509.SubjectAlternativeName(
                [x509.UniformResourceIdentifier(f"urn:{name}"), x509.IPAddress(IPv4Address("127.0.0.1"))]
            ),
            False,
        )
        .add_extension(signs, True)
        .add_extension(
            x509.ExtendedKeyUsage([ExtendedKeyUsageOID.CLIENT_AUTH, ExtendedKeyUsageOID.SERVER_AUTH]), False
        )
        .sign(key, hashes.SHA256())
    )
    (folder / f"{name}.der").write_bytes(certificate.public_bytes(serialization.Encoding.DER))
    kinds = serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
    (folder / f"{name}.pem").write_bytes(key.private_bytes(*kinds))


OWN = """
[opcua]
listen = "127.0.0.1:0"
certificate = "press.der"
key = "press.pem"
trusted = ["trusted"]
"""
PEER = """
[[peer]]
endpoint = "ENDPOINT"
certificate = "NAME.der"
key = "NAME.pem"
server_certificate = "press.der"
"""
SERVED = """
IN SUBSCRIBE_1 QI=1 ID="opc_ua[READ;/Objects/1:Go]"
GO BOOL2BOOL
START.COLD -> IN.INIT
IN.IND -> GO.REQ
IN.RD_1 -> GO.IN
"""
CALLING = """
OUT CLIENT_1_0 QI=1 ID="opc_ua[WRITE;ENDPOINT#;/Objects/1:Go]"
GO BOOL2BOOL IN=TRUE
START.COLD -> OUT.INIT
OUT.INITO -> GO.REQ
GO.OUT -> OUT.SD_1
EVERY E_CYCLE DT=T#50ms
START.COLD -> EVERY.START
EVERY.EO -> OUT.REQ
"""


def test_who_is_trusted_may_write_and_nobody_else(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    (tmp_path / "trusted").mkdir()
    for name in ("press", "crane", "stranger"):
        certify(tmp_path, name)
    (tmp_path / "trusted" / "crane.der").write_bytes((tmp_path / "crane.der").read_bytes())
    (tmp_path / "own.toml").write_text(OWN)
    with serving(read_connections(tmp_path / "own.toml")) as served, served.client() as management:
        build(management, "R", SERVED)
        management.start("R")
        where = endpoint(served)

        async def plain() -> None:
            with pytest.raises((ua.UaError, OSError)):
                await Client(where, timeout=2.0).connect()

        run(plain)
        for name in ("stranger", "crane"):
            (tmp_path / "peer.toml").write_text(PEER.replace("ENDPOINT", where).replace("NAME", name))
            with serving(read_connections(tmp_path / "peer.toml")) as calling, calling.client() as other:
                build(other, "R", CALLING.replace("ENDPOINT", where))
                other.start("R")
                if name == "stranger":
                    wait(other, "OUT.STATUS", "DATA_TYPE_ERROR")
                    while "BadCertificateUntrusted" not in caplog.text:
                        other.read("R", "OUT.STATUS")
                    assert management.read("R", "GO.OUT") == "FALSE"
                else:
                    wait(management, "GO.OUT", "TRUE")


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ('[opcua]\nlisten = "press:4840"', "expected localhost or a numeric IPv4 host"),
        ('[opcua]\ncertificate = "own.toml"', "expected a certificate and its key, or none of both"),
        ('[opcua]\ntrusted = ["."]', "trusted needs a certificate and its key"),
        ('[opcua]\ncertificate = "no.der"\nkey = "no.pem"', r"no\.der: no such file, which certificate names"),
        ("[opcua]\nport = 1", "unknown field `port`"),
        (
            '[[peer]]\nendpoint = "opc.tcp://h:1"\nkey = "own.toml"',
            "certificate, key and server_certificate, or none",
        ),
        ("[opcua", "own.toml"),
    ],
)
def test_settings_that_cannot_be_are_told(tmp_path: Path, text: str, complaint: str) -> None:
    (tmp_path / "own.toml").write_text(text)
    with pytest.raises(ToolError, match=complaint):
        read_connections(tmp_path / "own.toml")
