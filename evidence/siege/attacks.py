"""The table of attacks on a cell by somebody who reaches its bus and does not know its key.

An attack returns whether it was told already: by a refusal in words. What the cell counts is looked at afterwards.
"""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable
from functools import partial
from typing import Any, Final, NamedTuple

import msgspec

from dtwin.bus.codec import encode
from dtwin.bus.messages import (
    ACTED,
    ALIVE,
    EVENTS,
    FAULT,
    LATCH,
    RELEASE,
    RESET,
    SENSORS,
    SETTINGS,
    SIGNAL,
    STATUS,
    STOP,
    SUMMARY,
    VOLTAGES,
    Acted,
    FaultRequest,
    LatchRequest,
    ReleaseRequest,
    ResetRequest,
    SettingsRequest,
    SignalRequest,
    Status,
    StopRequest,
    StopState,
    Summary,
)
from dtwin.bus.signature import Signer, new_key
from dtwin.bus.stopping import stop
from dtwin.bus.topics.topic import Topic
from dtwin.errors import CommunicationError
from dtwin.parameters import VOLTAGE_LIMIT, Gains, every_joint
from dtwin.signals import Event, EventKind, Sensors, Voltages
from evidence.siege.intruders import INTRUSIONS
from evidence.siege.replies import Reply, answer_often, echo, refuse, say
from evidence.siege.stage import Stage, named_bus, pause

DEEP: Final = 30_000 * b"[" + 30_000 * b"]"
HUGE: Final = (10_000_000, 900_000)
"""bytes; Zenoh drops the first, which is more than a session takes, and tells nobody"""
FAR: Final = 10**12
"""Number of a sample that the stranger makes up."""
DROPPED: Final = "Zenoh drops it"
FLAPS: Final = 30
"""times that three tokens come and go; Zenoh itself takes its time for each, and many more take it from the arm"""
LATE: Final = 6.0
"""s for which a request is held back"""
_ME: Final = "operator"
_FULL: Final = (VOLTAGE_LIMIT, -VOLTAGE_LIMIT, VOLTAGE_LIMIT, 0.0)
_REQUESTS: Final[dict[Topic, msgspec.Struct]] = {
    STOP: StopRequest("mallory", "no"),
    RELEASE: ReleaseRequest("mallory", "no"),
    RESET: ResetRequest(5),
    FAULT: FaultRequest(("K2*=0.1@0",)),
    LATCH: LatchRequest("torque off"),
    SETTINGS: SettingsRequest(Gains(every_joint(1.0), every_joint(1.0), every_joint(1.0)), 2.0),
    SIGNAL: SignalRequest(True),
}


class Attack(NamedTuple):
    """An entry of the table.

    Attributes:
        name: what is done, in words.
        action: does it; returns what was believed, "" for nothing.
        unheard: why nobody can tell of it, "" if it must be told.
    """

    name: str
    action: Callable[[Stage], str]
    unheard: str = ""


_KEPT: list[Any] = []
"""Queries that a hijacker never ends."""
_FALSE: Final = encode(StopState(0.0, "standstill"))


def hijack(topic: str, reply: Reply, stage: Stage) -> str:
    """The stranger answers for the cell, while the operator stops and releases the arm."""
    with stage.answering(topic, reply):
        try:
            found = stop(stage.operator, StopRequest(_ME, "an attack"))
            if found.trouble:
                return f"the first way is closed: {found.trouble}"
            released = stage.operator.ask(RELEASE, ReleaseRequest(_ME, "an attack"), StopState).stop
        except CommunicationError as error:
            return str(error)
        finally:
            _KEPT.clear()
    stage.forget()
    return "" if released == "none" else f"not released: {released}"


def belie(stage: Stage) -> str:
    """The stranger makes up a summary of the cell."""
    false = encode(Summary({}, ticks=10**9))
    with stage.answering(SUMMARY.name, partial(say, false, None)):
        return "a false summary" if stage.operator.ask(SUMMARY, None, Summary).ticks == 10**9 else ""


def replay_answers(stage: Stage) -> str:
    """The stranger passes on answers that belong to other requests."""
    kept: list[tuple[bytes, bytes]] = []

    def pass_on(query: Any) -> None:
        with query:
            found = stage.stranger.get(
                str(query.key_expr), payload=query.payload, attachment=query.attachment, timeout=1.0
            )
            kept.extend(
                (r.ok.payload.to_bytes(), r.ok.attachment.to_bytes()) for r in found if r.ok and r.ok.attachment
            )

    def replay(query: Any) -> None:
        with query:
            for payload, attachment in kept or [(_FALSE, bytes(33))]:
                query.reply(str(query.key_expr), payload, attachment=attachment)

    with stage.answering(STOP.name, pass_on):
        stage.operator.ask(STOP, None, StopState)
    return hijack(STOP.name, replay, stage)


def demand(topic: Topic, stage: Stage) -> str:
    """A request without a signature."""
    return "answered" if "ok" in stage.send(topic.name, encode(_REQUESTS[topic])) else ""


def demand_signed(stage: Stage) -> str:
    """A request with the signature of another key."""
    with named_bus(stage, new_key()) as bus, contextlib.suppress(CommunicationError):
        return bus.ask(STOP, StopRequest("mallory", "no"), StopState, 0.5).stop
    return ""


def send_raw(topic: str, payload: bytes, attachment: bytes | None, stage: Stage) -> str:
    """A request of any bytes."""
    return "answered" if "ok" in stage.send(topic, payload, attachment) else ""


def demand_of_all(stage: Stage) -> str:
    """One request to all keys."""
    found = stage.stranger.get(f"dtwin/{stage.name}/**", payload=encode(ResetRequest(5)), timeout=1.0)
    return "answered" if any(reply.ok for reply in found) else ""


def flood(topic: Topic, payload: bytes, stage: Stage) -> str:
    """Requests as fast as they can be sent, while the operator stops and releases the arm."""
    over = threading.Event()

    def send() -> None:
        while not over.is_set():
            stage.stranger.get(stage.key(topic.name), _ignore, payload=payload, timeout=1.0)

    thread = threading.Thread(target=send)
    thread.start()
    try:
        return hijack(topic.name, refuse, stage)
    finally:
        over.set()
        thread.join()


def _ignore(reply: Any) -> None:
    """Nobody wants to know."""


def _overhear(topic: Topic, act: Callable[[], object], stage: Stage) -> list[tuple[bytes, bytes]]:
    """The requests that an act of the operator sends, as a stranger sees them who answers everything."""
    found: list[tuple[bytes, bytes]] = []

    def keep(query: Any) -> None:
        with query:
            if (
                query.attachment is not None
                and query.payload is not None
                and str(query.key_expr) == stage.key(topic.name)
            ):
                found.append((query.payload.to_bytes(), query.attachment.to_bytes()))

    with stage.answering("**", keep):
        act()
    return found or [(encode(_REQUESTS[topic]), bytes(48))]


def _stop(stage: Stage) -> None:
    stop(stage.operator, StopRequest(_ME, "an attack"))


def _release(stage: Stage) -> None:
    stage.operator.ask(RELEASE, ReleaseRequest(_ME, "an attack"), StopState)


def replay_stop(held_back: float, stage: Stage) -> str:
    """The operator's stop comes again after its release."""
    requests = _overhear(STOP, partial(_stop, stage), stage)
    _release(stage)
    stage.forget()
    pause(held_back)
    for request in requests:
        stage.send(STOP.name, *request)
    return stage.shown()


def replay_release(stage: Stage) -> str:
    """The operator's release comes again while the arm is stopped anew."""
    _stop(stage)
    requests = _overhear(RELEASE, partial(_release, stage), stage)
    _stop(stage)
    for request in requests:
        stage.send(RELEASE.name, *request)
    found = stage.operator.ask(STOP, None, StopState).stop
    _release(stage)
    stage.forget()
    return "released" if found == "none" else ""


def change_request(stage: Stage) -> str:
    """The operator's reading becomes a stop, with its signature."""
    requests = _overhear(STOP, lambda: stage.operator.ask(STOP, None, StopState), stage)
    return "answered" if any("ok" in stage.send(STOP.name, _FALSE, sealed) for _, sealed in requests) else ""


def publish(topic: Topic, message: Callable[[Sensors], msgspec.Struct], key: bytes | None, stage: Stage) -> str:
    """A message of the stranger for every sample, without a signature or with that of another key."""
    with named_bus(stage, key) as bus:
        send = bus.publisher(topic, "bridge")
        bus_samples = bus if key is None else named_bus(stage, None)
        heard = threading.Semaphore(0)

        def answer(sample: Sensors) -> None:
            if sample.sequence < FAR:
                send(message(sample))
                heard.release()

        bus_samples.subscribe(SENSORS, Sensors, answer)
        for _ in range(50):
            heard.acquire(timeout=1.0)
        if bus_samples is not bus:
            bus_samples.close()
    return ""


def publish_raw(topic: Topic, payload: bytes, count: int, stage: Stage) -> str:
    """Any bytes, some with the form of a signature."""
    sealed = Signer(new_key(), stage.key(topic.name))
    for k in range(count):
        stage.stranger.put(stage.key(topic.name), payload, attachment=sealed(payload[:100]) if k % 2 else None)
    return ""


def replay_publications(topic: Topic, stage: Stage) -> str:
    """What the cell has published comes again, with its signatures."""
    for payload, attachment in list(stage.overheard.get(stage.key(topic.name), ())):
        stage.stranger.put(stage.key(topic.name), payload, attachment=attachment)
    return ""


def announce(proof: str, count: int, stage: Stage) -> str:
    """Tokens of services that are not the stranger's."""
    for _ in range(count):
        for service in ("emulator", "bridge", "nobody"):
            key = stage.key(ALIVE.name.replace("*", service))
            stage.stranger.liveliness().declare_token(f"{key}{proof}").undeclare()
    return ""


def _hijacks() -> list[Attack]:
    false = partial(say, _FALSE, None)
    return [
        Attack("answer controller/stop", partial(hijack, STOP.name, false)),
        Attack("answer emulator/stop", partial(hijack, LATCH.name, false)),
        Attack("answer controller/release", partial(hijack, RELEASE.name, false)),
        Attack("answer everything", partial(hijack, "**", false)),
        Attack("answer with a made-up signature", partial(hijack, "**", partial(say, _FALSE, bytes(33)))),
        Attack("answer 2,000 times", partial(hijack, "**", answer_often)),
        *(
            Attack(
                f"answer with {size / 1e6:g} MB",
                partial(hijack, "**", partial(say, bytes(size), None)),
                DROPPED * (size == HUGE[0]),
            )
            for size in HUGE
        ),
        Attack(
            "answer with NaN", partial(hijack, "**", partial(say, b'{"schema":1,"time":NaN,"stop":"none"}', None))
        ),
        Attack("answer with deep nesting", partial(hijack, "**", partial(say, DEEP, bytes(33)))),
        Attack("answer with a refusal", partial(hijack, "**", refuse)),
        Attack("answer with the request", partial(hijack, "**", echo)),
        Attack("never end an answer", partial(hijack, "**", _KEPT.append), "nothing is said"),
        Attack("answer with answers to others", replay_answers),
        Attack("make up a summary", belie),
    ]


def _requests() -> list[Attack]:
    unsigned = [Attack(f"ask {topic.name} unsigned", partial(demand, topic)) for topic in _REQUESTS]
    return [
        *unsigned,
        Attack("ask with another key", demand_signed),
        Attack("ask everything at once", demand_of_all),
        Attack("ask with a made-up signature", partial(send_raw, STOP.name, encode(_REQUESTS[STOP]), bytes(48))),
        Attack("ask with NaN", partial(send_raw, LATCH.name, b'{"schema":1,"stop":"none","number":NaN}', None)),
        Attack("ask with deep nesting", partial(send_raw, STOP.name, DEEP, None)),
        *(
            Attack(
                f"ask with {size / 1e6:g} MB",
                partial(send_raw, STOP.name, bytes(size), None),
                DROPPED * (size == HUGE[0]),
            )
            for size in HUGE
        ),
        Attack("a flood of requests", partial(flood, STOP, encode(_REQUESTS[STOP]))),
        Attack("a flood of readings", partial(flood, STOP, b"")),
        Attack("a stop comes again", partial(replay_stop, 0.0)),
        Attack("a stop comes late", partial(replay_stop, LATE)),
        Attack("a release comes again", replay_release),
        Attack("another message in a signed request", change_request),
    ]


def _publications() -> list[Attack]:
    def full(sample: Sensors) -> Voltages:
        return Voltages(sample.sequence, sample.time, _FULL, False)

    def without(sample: Sensors) -> Acted:
        return Acted(sample.sequence, sample.time, (0.0, 0.0, 0.0, 0.0), False)

    return [
        Attack("voltages unsigned", partial(publish, VOLTAGES, full, None)),
        Attack("voltages with another key", partial(publish, VOLTAGES, full, new_key())),
        Attack("voltages again", partial(replay_publications, VOLTAGES)),
        Attack("samples again", partial(replay_publications, SENSORS)),
        Attack(
            "samples of the far future",
            partial(publish, SENSORS, lambda s: Sensors(FAR, 1e9, s.theta, 0.9, False, ""), None),
        ),
        Attack(
            "events that the arm is safe",
            partial(publish, EVENTS, lambda s: Event(s.time, EventKind.SAFE, "made up"), None),
        ),
        Attack(
            "events that the arm is stopped",
            partial(publish, EVENTS, lambda s: Event(s.time, EventKind.STOP, "made up"), None),
        ),
        Attack("voltages that did not act", partial(publish, ACTED, without, None)),
        Attack(
            "a status of the bridge",
            partial(publish, STATUS, lambda s: Status("bridge", "stopping", 1), None),
        ),
        Attack("voltages of deep nesting", partial(publish_raw, VOLTAGES, DEEP, 10)),
        Attack("voltages of NaN", partial(publish_raw, VOLTAGES, b'{"schema":1,"sequence":NaN}', 10)),
        *(
            Attack(
                f"voltages of {size / 1e6:g} MB",
                partial(publish_raw, VOLTAGES, bytes(size), 2),
                DROPPED * (size == HUGE[0]),
            )
            for size in HUGE
        ),
        Attack("a flood of voltages", partial(publish_raw, VOLTAGES, b"{}", 20_000)),
        Attack("tokens without proof", partial(announce, "", 1)),
        Attack("tokens with a made-up proof", partial(announce, f"/{24 * '00'}", 1)),
        Attack("a flood of tokens", partial(announce, f"/{24 * 'ff'}", FLAPS)),
    ]


ATTACKS: Final = (*_hijacks(), *_requests(), *_publications())
"""Attacks on the bus, in every setting."""
INTRUDERS: Final = tuple(Attack(name, action) for name, action in INTRUSIONS.items())
"""Attacks on a secured cell with certificates."""
