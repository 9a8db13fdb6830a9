"""Who may: users with scrypt hashes, roles, the limit of attempts, and that beyond loopback nobody comes in plain."""

import json
import ssl
import subprocess
import sys
import urllib.request
from collections.abc import Iterator
from pathlib import Path

import pytest

from dtwin.console.commands import COMMANDS
from dtwin.console.people.sessions import ATTEMPTS, LIFETIME, PAUSE
from dtwin.console.people.users import ROLES, Users, may
from dtwin.console.web.listening import Listening
from dtwin.errors import ParameterError
from tests.support.console import Served, serve
from tests.support.secured import certify

PASSWORD = "correct horse battery"
CONTENT = {"fault": {"fault": "K2*=0.1@0"}, "upload": {"why": "to try", "based_on": 1}}


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
    assert users.role_of("some-engineer", PASSWORD) == "engineer"
    for name, password in (("some-engineer", "wrong"), ("some-engineer", ""), ("nobody", PASSWORD), ("", "")):
        assert users.role_of(name, password) is None


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


def test_attempts_are_limited_by_name_and_by_address(served: Served) -> None:
    for _ in range(ATTEMPTS):
        assert served.visitor().login("some-viewer", "wrong") == 401
    assert served.visitor().login("some-viewer", PASSWORD) == 429
    assert served.visitor().login("some-engineer", PASSWORD) == 429, "the address is the same"
    served.clock.ahead += PAUSE
    assert served.visitor().login("some-viewer", PASSWORD) == 200
    noted = [(entry["command"], entry["done"]) for entry in served.entries()]
    assert noted.count(("log in", False)) == ATTEMPTS
    assert noted.count(("log in", True)) == 1


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
    certify(tmp_path / "certificates", "localhost")
    files = [tmp_path / "certificates" / f"localhost.{end}" for end in ("pem", "key")]
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
    assert Users(tmp_path / "users.json").role_of("anna", PASSWORD) == "operator"
