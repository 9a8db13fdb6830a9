"""Who may: users with scrypt hashes, roles, the limit of attempts, and that beyond loopback nobody comes in plain."""

import json
import ssl
import subprocess
import sys
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect
from websockets.typing import Origin

from dtwin.cli import main
from dtwin.console.commands import COMMANDS
from dtwin.console.people.sessions import ATTEMPTS, EACH, LIFETIME, PAUSE, SPRAYED, Attempts
from dtwin.console.people.users import ROLES, Users, may
from dtwin.console.web.listening import Listening
from dtwin.errors import ParameterError
from tests.support.console import Served, serve
from tests.support.secured import certify

PASSWORD = "correct horse battery"
_PROPOSAL = {"number": 1, "digest": "0" * 32}
CONTENT = {
    "fault": {"fault": "K2*=0.1@0"},
    "upload": {"why": "to try", "based_on": 1},
    "approve": _PROPOSAL,
    "decline": {**_PROPOSAL, "why": "not now"},
}


@pytest.fixture(scope="module")
def users(tmp_path_factory: pytest.TempPathFactory) -> Users:
    users = Users(tmp_path_factory.mktemp("users") / "users.json")
    for role in ROLES:
        users.set(f"some-{role}", role, PASSWORD)
    return users


@pytest.fixture
def served(tmp_path: Path, users: Users) -> Iterator[Served]:
    with serve(tmp_path, users) as served:
        served.live()
        yield served


def test_a_file_of_users_holds_no_password(users: Users) -> None:
    assert PASSWORD not in users.path.read_text()
    assert users.path.stat().st_mode & 0o077 == 0
    salts = {user.salt for user in users.read().values()}
    assert len(salts) == len(ROLES)


def test_only_the_right_password_gives_the_role(users: Users) -> None:
    found = users.verified("some-engineer", PASSWORD)
    assert found is not None
    assert found.role == "engineer"
    for name, password in (("some-engineer", "wrong"), ("some-engineer", ""), ("nobody", PASSWORD), ("", "")):
        assert users.verified(name, password) is None


@pytest.mark.parametrize(
    ("name", "role", "password"), [("<b>", "viewer", PASSWORD), ("a", "god", PASSWORD), ("a", "viewer", "short")]
)
def test_what_cannot_be_a_user_is_refused(tmp_path: Path, name: str, role: str, password: str) -> None:
    with pytest.raises(ParameterError, match="expected"):
        Users(tmp_path / "users.json").set(name, role, password)
    assert not (tmp_path / "users.json").exists()


def test_without_log_in_there_is_only_the_way_to_it(served: Served) -> None:
    visitor = served.visitor()
    status, headers, _ = visitor.ask("GET", "/")
    assert (status, headers["location"], visitor.cookie) == (303, "/login", "")
    for path in ("/api/session", "/api/past", "/api/history", "/api/models", "/api/logs", "/api/job/1"):
        assert visitor.ask("GET", path)[0] == 401
    assert visitor.post("/api/desk/occupy")[0] == 401


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_is_refused_for_a_viewer(served: Served, name: str) -> None:
    viewer = served.visitor()
    assert viewer.login("some-viewer", PASSWORD) == 200
    assert viewer.post("/api/desk/occupy")[0] == 409
    status, answer = viewer.post(f"/api/command/{name}", CONTENT.get(name))
    assert (status, answer["done"]) == (409, False)
    assert "needs the role" in answer["text"]
    assert served.cell.asked == []
    assert viewer.post("/api/job/simulate", {"task": "simulate"})[0] == 400


def test_an_operator_has_not_the_rights_of_an_engineer(served: Served) -> None:
    operator = served.visitor()
    assert operator.login("some-operator", PASSWORD) == 200
    assert operator.post("/api/desk/occupy")[0] == 200
    assert operator.post("/api/command/stop")[0] == 200
    for name, command in COMMANDS.items():
        if not may("operator", command.role):
            assert "needs the role engineer" in operator.post(f"/api/command/{name}", CONTENT.get(name))[1]["text"]
    assert {entry["user"] for entry in served.entries()} == {"some-operator"}


def test_attempts_are_limited_by_name_and_address_and_lock_nobody_else_out(served: Served) -> None:
    logged_in = served.visitor()
    assert logged_in.login("some-viewer", PASSWORD) == 200
    for _ in range(ATTEMPTS):
        assert served.visitor().login("some-viewer", "wrong") == 401
    assert served.visitor().login("some-viewer", PASSWORD) == 429
    assert served.visitor().login("some-engineer", PASSWORD) == 200, "another name"
    assert served.visitor("127.0.0.2").login("some-viewer", PASSWORD) == 200, "another address"
    assert logged_in.ask("GET", "/api/session")[0] == 200
    assert logged_in.login("some-viewer", PASSWORD) == 200, "who is logged in may log in again"
    served.clock.ahead += PAUSE
    noted = [(entry["command"], entry["done"]) for entry in served.entries()]
    assert noted.count(("log in", False)) == ATTEMPTS
    assert noted.count(("log in", True)) == 4
    assert served.visitor().login("some-viewer", PASSWORD) == 200


def test_an_address_that_tries_many_names_waits_alone() -> None:
    attempts = Attempts()
    for number in range(SPRAYED):
        assert attempts.wait("192.0.2.1", f"name{number}", 0.0) == 0.0
        attempts.fail("192.0.2.1", f"name{number}", 0.0)
    assert attempts.wait("192.0.2.1", "another", 10.0) == PAUSE - 10.0
    assert attempts.wait("192.0.2.2", "name0", 10.0) == 0.0
    assert attempts.wait("192.0.2.1", "another", PAUSE) == 0.0


def test_the_addresses_of_one_network_of_ipv6_are_one() -> None:
    attempts = Attempts()
    for number in range(ATTEMPTS):
        attempts.fail(f"2001:db8::{number}", "anna", 0.0)
    assert attempts.wait("2001:db8::ffff", "anna", 1.0) > 0.0
    assert attempts.wait("2001:db8:0:1::1", "anna", 1.0) == 0.0


def test_visits_cost_nothing_and_throw_nobody_out(tmp_path: Path, users: Users) -> None:
    with serve(tmp_path) as served:
        operator = served.visitor()
        operator.enter()
        keys = {served.console.sessions.visit("somebody").key for _ in range(2000)}
        assert len(keys) == 2000
        served.visitor().enter()
        assert operator.ask("GET", "/api/session")[0] == 200
        for cookie in (f"dtwin={sorted(keys)[0]}x", "dtwin=.", "dtwin=a.b", f"dtwin={'a' * 43}.{'0' * 64}"):
            assert operator.ask("GET", "/api/session", Cookie=cookie)[0] == 401
        sessions = served.console.sessions
        first = sessions.open("anna", "viewer", "", 0.0)
        other = sessions.open("bert", "viewer", "", 0.0)
        for _ in range(EACH):
            sessions.open("anna", "viewer", "", 0.0)
        assert sessions.find(first.key, 1.0) is None
        assert sessions.find(other.key, 1.0) == other, "nobody's sessions make room for another one's"


def test_rights_are_those_of_now(tmp_path: Path) -> None:
    users = Users(tmp_path / "users.json")
    for name in ("anna", "bert", "carl"):
        users.set(name, "engineer", PASSWORD)
    with serve(tmp_path, users) as served:
        served.live()
        visitors = {}
        for name in ("anna", "bert", "carl"):
            visitors[name] = served.visitor()
            assert visitors[name].login(name, PASSWORD) == 200
        anna = visitors["anna"]
        assert anna.post("/api/desk/occupy")[0] == 200
        content = json.loads(users.path.read_bytes())
        content["anna"]["role"] = "viewer"
        del content["bert"]
        users.path.write_text(json.dumps(content))
        users.set("carl", "engineer", f"another {PASSWORD}")
        answer = anna.post("/api/command/fault", CONTENT["fault"])[1]
        assert answer["text"] == "needs the role engineer, anna is viewer"
        assert "needs the role operator" in anna.post("/api/command/stop")[1]["text"]
        for name in ("bert", "carl"):
            assert visitors[name].ask("GET", "/api/session")[0] == 401
            assert visitors[name].post("/api/command/stop")[0] == 401
        assert served.cell.asked == []
        users.path.unlink()
        assert anna.ask("GET", "/api/session")[0] == 401, "who cannot be known has no rights"


def test_a_page_that_is_open_loses_its_rights_too(tmp_path: Path) -> None:
    users = Users(tmp_path / "users.json")
    users.set("anna", "operator", PASSWORD)
    users.set("bert", "operator", PASSWORD)
    with serve(tmp_path, users) as served:
        served.live()
        anna = served.visitor()
        anna.login("anna", PASSWORD)
        url, origin = f"ws://{anna.host}/api/stream", Origin(f"http://{anna.host}")
        with connect(url, origin=origin, additional_headers={"Cookie": anna.cookie}) as socket:

            def role() -> str:
                while (told := json.loads(socket.recv(20)))["tell"] != "you":
                    pass
                return str(told["role"])

            def change(content: dict[str, Any]) -> None:
                """Replaces the file as a whole: nobody has any rights by one that is half written."""
                other = users.path.with_name("other.json")
                other.write_text(json.dumps(content))
                other.replace(users.path)

            assert role() == "operator"
            content = json.loads(users.path.read_bytes())
            content["anna"]["role"] = "viewer"
            change(content)
            assert role() == "viewer"
            del content["anna"]
            change(content)
            with pytest.raises(ConnectionClosed):
                list(iter(lambda: socket.recv(20), ""))
            assert socket.close_code == 1008


def test_the_audit_tells_of_a_change_and_of_a_cut(
    tmp_path: Path, users: Users, capsys: pytest.CaptureFixture[str]
) -> None:
    with serve(tmp_path, users) as served:
        for _ in range(2):
            assert served.visitor().login("some-viewer", PASSWORD) == 200
    path = served.audit
    command = ["console", "audit", str(path)]
    assert main(command) == 0
    said = capsys.readouterr().out
    assert said.count("log in") == 2
    last = json.loads(path.read_text().splitlines()[-1])["hash"]
    assert f"2 lines, whole; the last has the hash {last}" in said
    assert main([*command, "--hash", last]) == 0
    content = path.read_text()
    lines = content.splitlines(keepends=True)
    for changed in (content.replace("welcome", "refused", 1), lines[1], lines[0], ""):
        path.write_text(changed)
        capsys.readouterr()
        assert main(command) == 1
        assert "audit.jsonl" in capsys.readouterr().out
    path.write_text(content)
    assert main([*command, "--hash", "0" * 32]) == 1


def test_a_session_ends_with_its_log_out_and_with_time(served: Served) -> None:
    visitor = served.visitor()
    visitor.login("some-operator", PASSWORD)
    visitor.post("/api/desk/occupy")
    assert visitor.post("/api/logout")[0] == 200
    assert visitor.ask("GET", "/api/session")[0] == 401
    other = served.visitor()
    other.login("some-operator", PASSWORD)
    assert other.post("/api/desk/occupy")[0] == 200, "the log-out has left the desk"
    served.clock.ahead += LIFETIME + 1
    assert other.ask("GET", "/api/session")[0] == 401


def test_beyond_loopback_nobody_listens_without_tls_and_log_in(tmp_path: Path) -> None:
    for host in ("0.0.0.0", "192.0.2.1", "::", "some.host"):
        with pytest.raises(ParameterError, match="expected TLS"):
            Listening(host=host).check(True)
    file = tmp_path / "x.pem"
    file.touch()
    with pytest.raises(ParameterError, match="users who log in"):
        Listening(host="0.0.0.0", certificate=file, key=file).check(False)
    Listening(host="0.0.0.0", certificate=file, key=file).check(True)
    Listening(host="::1").check(False)


def test_over_tls_the_cookie_is_secure(tmp_path: Path, users: Users) -> None:
    certify(tmp_path / "certificates", "router")
    files = [tmp_path / "certificates" / f"router.{end}" for end in ("pem", "key")]
    with serve(tmp_path, users, listening=Listening(certificate=files[0], key=files[1])) as served:
        assert served.web.address.startswith("https://")
        context = ssl.create_default_context(cafile=str(tmp_path / "certificates" / "ca.pem"))
        origin = served.web.address.rstrip("/")
        body = json.dumps({"name": "some-viewer", "password": PASSWORD}).encode()
        request = urllib.request.Request(f"{origin}/api/login", body, {"Origin": origin})
        with urllib.request.urlopen(request, timeout=20, context=context) as answer:
            cookie = answer.headers["Set-Cookie"]
            assert "max-age" in answer.headers["Strict-Transport-Security"]
        assert cookie.startswith("__Host-dtwin=")
        assert {"httponly", "secure", "samesite=strict", "path=/"} <= set(cookie.lower().split("; "))


def test_users_are_made_on_the_command_line(tmp_path: Path) -> None:
    command = ["console", "user", "anna", "--role", "operator", "--users", str(tmp_path / "users.json")]
    done = subprocess.run(
        [sys.executable, "-m", "dtwin", *command], input=f"{PASSWORD}\n", capture_output=True, text=True, timeout=60
    )
    assert done.returncode == 0, done.stderr
    found = Users(tmp_path / "users.json").verified("anna", PASSWORD)
    assert found is not None
    assert found.role == "operator"
