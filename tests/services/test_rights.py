"""Who may do what in a secured cell: the table of docs/zenoh.md, the router's file and real sessions say the same."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from functools import partial
from typing import Any, Final, NamedTuple

import pytest
import zenoh

from dtwin.bus.messages import EVENTS, TOPICS
from dtwin.bus.opening import open_configured
from dtwin.bus.session import Bus
from dtwin.parameters import ROOT
from tests.support.secured import SECURED, copy_secured
from tests.support.waiting import until

ROUTER: Final = SECURED / "router.json5"
SERVICES: Final = (
    "emulator",
    "bridge",
    "controller",
    "recorder",
    "identification",
    "monitoring",
    "simulation",
    "recovery",
    "console",
    "line",
)
ROLES: Final = (*SERVICES, "operator", "ai-observe", "ai-propose", "ai-act")
PROBE: Final = b"a probe of rights"
DENIED: Final = 1.5
"""Time in which a query that may be answered is answered by far, s."""


class Right(NamedTuple):
    """Something that a role may do with a key below dtwin/CELL/ARM/."""

    role: str
    action: str
    topic: str


def cells() -> dict[str, tuple[str, str]]:
    """The rows of the page's table of rights: who publishes or answers a topic, and who asks."""
    page = (ROOT / "docs" / "zenoh.md").read_text()
    (table,) = re.findall(r"^\| topic \| published or answered by \| asked by \|\n\|.*\n((?:\|.*\n)+)", page, re.M)
    rows = [[cell.strip() for cell in line.strip().strip("|").split("|")] for line in table.splitlines()]
    return {topic.strip("`"): (sender, asker) for topic, sender, asker in rows}


def granted() -> set[Right]:
    """The rights of the page's table, one by one."""
    kinds = {topic.name: topic.kind for topic in TOPICS}
    actions = {"publication": "publish", "query": "answer", "token": "announce"}
    found = set()
    for topic, (senders, askers) in cells().items():
        action = actions[kinds[topic]]
        if senders == "each service under its own name":
            found |= {Right(name, action, topic.replace("*", name)) for name in SERVICES}
        else:
            roles = senders.replace("every service", ", ".join(SERVICES)).split(", ")
            found |= {Right(name, action, topic) for name in roles}
        found |= {Right(name, "ask", topic) for name in askers.split(", ") if name}
    return found


def conceivable() -> set[Right]:
    """Everything that any role might do with any topic."""
    found = set()
    for topic in TOPICS:
        for name in [topic.name.replace("*", service) for service in SERVICES] if "*" in topic.name else [topic.name]:
            actions = {"publication": ("publish",), "query": ("answer", "ask"), "token": ("announce",)}[topic.kind]
            found |= {Right(role, action, name) for role in ROLES for action in actions}
    return found


GRANTED: Final = granted()
CONCEIVABLE: Final = conceivable()
ASKER: Final = {right.topic: right.role for right in sorted(GRANTED) if right.action == "ask"}
"""A role that may ask a topic, for every topic that is asked."""


def test_the_table_has_a_row_for_every_topic_and_knows_the_roles() -> None:
    assert list(cells()) == [topic.name for topic in TOPICS]
    assert {right.role for right in GRANTED} == set(ROLES) == {f.stem for f in SECURED.glob("*.json5")} - {"router"}
    assert GRANTED < CONCEIVABLE
    assert set(ASKER) == {topic.name for topic in TOPICS if topic.kind == "query"}


class Rules:
    """The access control of the router's file: which messages may pass from or to whom."""

    def __init__(self) -> None:
        control = json.loads(zenoh.Config.from_file(ROUTER).get_json("access_control"))
        assert control["enabled"]
        assert control["default_permission"] == "deny"
        self._rules = {rule["id"]: rule for rule in control["rules"]}
        assert {rule["permission"] for rule in control["rules"]} == {"allow"}
        names = {subject["id"]: subject["cert_common_names"] for subject in control["subjects"]}
        self._held: dict[str, list[str]] = {role: [] for role in ROLES}
        for policy in control["policies"]:
            for subject in policy["subjects"]:
                for role in names[subject]:
                    self._held[role] += policy["rules"]

    def allow(self, role: str, message: str, flow: str, topic: str) -> bool:
        key = zenoh.KeyExpr(f"dtwin/cell/arm/{topic}")
        return any(
            message in rule["messages"]
            and flow in rule["flows"]
            and any(zenoh.KeyExpr(expression).includes(key) for expression in rule["key_exprs"])
            for rule in (self._rules[name] for name in self._held[role])
        )

    def grant(self, right: Right) -> bool:
        role, action, topic = right
        if action == "answer":
            ways = [("declare_queryable", "ingress"), ("reply", "ingress"), ("query", "egress")]
        else:
            ways = [({"publish": "put", "announce": "liveliness_token", "ask": "query"}[action], "ingress")]
        return all(self.allow(role, message, flow, topic) for message, flow in ways)


def test_the_routers_file_grants_what_the_table_says_and_no_more() -> None:
    rules = Rules()
    assert {right for right in CONCEIVABLE if rules.grant(right)} == GRANTED


def test_everybody_may_watch_everything() -> None:
    rules = Rules()
    for role in ROLES:
        for message, flow in (("declare_subscriber", "ingress"), ("put", "egress"), ("liveliness_token", "egress")):
            assert all(rules.allow(role, message, flow, right.topic) for right in CONCEIVABLE)


class Sessions(NamedTuple):
    """Two sessions of every role, because a session that asks itself needs no router."""

    first: dict[str, Bus]
    second: dict[str, Bus]


@pytest.fixture(scope="module")
def sessions(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Sessions]:
    """Sessions at a router with the shipped configuration."""
    if shutil.which("openssl") is None:
        pytest.skip("needs the openssl command: install it")
    folder = tmp_path_factory.mktemp("rights")
    copy_secured(folder)
    with ExitStack() as stack:
        stack.callback(open_configured(folder, "router").close)
        yield Sessions(
            *({role: stack.enter_context(Bus(open_configured(folder, role))) for role in ROLES} for _ in range(2))
        )


def key(topic: str) -> str:
    return f"dtwin/cell/arm/{topic}"


def of(rights: set[Right], role: str, action: str) -> set[str]:
    return {right.topic for right in rights if (right.role, right.action) == (role, action)}


@pytest.mark.parametrize("role", ROLES)
def test_a_role_publishes_and_announces_what_the_table_says(sessions: Sessions, role: str) -> None:
    listener = sessions.second["recorder"]
    session = sessions.first[role]._session
    heard: set[tuple[str, str]] = set()
    mine = role.encode()  # What the role before has said may still be on its way.

    def publication(sample: zenoh.Sample) -> None:
        if sample.payload.to_bytes() == mine:
            heard.add(("publish", str(sample.key_expr).removeprefix(key(""))))

    def announcement(sample: zenoh.Sample) -> None:
        if sample.kind == zenoh.SampleKind.PUT:
            heard.add(("announce", str(sample.key_expr).removeprefix(key(""))))

    ends: list[Any] = [
        listener._session.declare_subscriber(key("**"), publication),
        listener._session.liveliness().declare_subscriber(key("alive/*"), announcement),
    ]
    tokens: list[zenoh.LivelinessToken] = []
    expected = {(action, topic) for action in ("publish", "announce") for topic in of(GRANTED, role, action)}

    def passes() -> bool:
        """What everybody may publish comes last on the same way: then nothing else is on its way.

        A token that the router hears of before it hears of the listener is not announced, so all are declared anew.
        """
        while tokens:
            tokens.pop().undeclare()
        tokens.extend(session.liveliness().declare_token(key(topic)) for topic in of(CONCEIVABLE, role, "announce"))
        for topic in sorted(of(CONCEIVABLE, role, "publish") - {EVENTS.name}):
            session.put(key(topic), mine)
        tell(sessions, role, mine)
        return expected <= heard and ("publish", EVENTS.name) in heard

    try:
        until(passes, "what is granted passes", 60.0)
        assert heard - {("publish", EVENTS.name)} == expected - {("publish", EVENTS.name)}
        assert (("publish", EVENTS.name) in expected) == may_tell(role)
    finally:
        for declared in tokens:
            declared.undeclare()
        # The next role's listener must not hear of these tokens: they are told before what is published after them.
        heard.clear()
        mine = mine + b" is done"

        def done() -> bool:
            tell(sessions, role, mine)
            return ("publish", EVENTS.name) in heard

        until(done, "nothing is on its way any more", 60.0)
        for declared in ends:
            declared.undeclare()


@pytest.mark.parametrize("role", ROLES)
def test_a_role_answers_what_the_table_says(sessions: Sessions, role: str) -> None:
    """Whoever may ask a topic asks it; a role that may not answer is not found."""
    heard: list[str] = []
    listener = sessions.second["recorder"]._session.declare_subscriber(
        key(EVENTS.name), lambda sample: heard.append(str(sample.key_expr))
    )
    declared = [
        sessions.first[role]._session.declare_queryable(key(topic), lambda query: query.reply(query.key_expr, PROBE))
        for topic in of(CONCEIVABLE, role, "answer")
    ]

    def passes() -> bool:
        """An event comes after what was declared, on the same way."""
        tell(sessions, role, PROBE)
        return bool(heard)

    try:
        until(passes, "the router knows what was declared", 60.0)
        for topic in of(GRANTED, role, "answer"):
            until(partial(ask, sessions.second[ASKER[topic]], topic), f"{topic} is answered", 60.0)
        assert answered(sessions.second, ASKER) == of(GRANTED, role, "answer")
    finally:
        listener.undeclare()
        for queryable in declared:
            queryable.undeclare()


@pytest.mark.parametrize("role", ROLES)
def test_a_role_asks_what_the_table_says(sessions: Sessions, role: str) -> None:
    """All topics are answered by those who may."""
    declared = [
        sessions.first[right.role]._session.declare_queryable(
            key(right.topic), lambda query: query.reply(query.key_expr, PROBE)
        )
        for right in GRANTED
        if right.action == "answer"
    ]
    try:
        for topic, asker in ASKER.items():
            until(partial(ask, sessions.second[asker], topic), f"{topic} is answered", 60.0)
        assert answered(sessions.second, dict.fromkeys(ASKER, role)) == of(GRANTED, role, "ask")
    finally:
        for queryable in declared:
            queryable.undeclare()


def may_tell(role: str) -> bool:
    """Whether a role may publish events."""
    return Right(role, "publish", EVENTS.name) in GRANTED


def tell(sessions: Sessions, role: str, payload: bytes) -> None:
    """An event after all that a role has sent; for one that may publish none the operator tells it.

    A query of the role that has ended shows that the router has taken what the role sent before.
    """
    own = sessions.first[role]
    if may_tell(role):
        own._session.put(key(EVENTS.name), payload)
        return
    own._session.put(key(EVENTS.name), b"a forged event")
    ask(own, "twin/simulation/look")
    sessions.first["operator"]._session.put(key(EVENTS.name), payload)


def ask(bus: Bus, topic: str) -> bool:
    """Whether somebody has answered."""
    return any(reply.ok is not None for reply in bus._session.get(key(topic), timeout=DENIED))


def answered(buses: dict[str, Bus], askers: dict[str, str]) -> set[str]:
    """The topics that are answered when all are asked at once."""
    with ThreadPoolExecutor(len(askers)) as pool:
        found = pool.map(lambda item: item[0] if ask(buses[item[1]], item[0]) else "", askers.items())
        return set(found) - {""}
