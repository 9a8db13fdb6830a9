"""Typed topics over real sessions: who meets whom, what is passed on, what is refused."""

import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from queue import SimpleQueue

import pytest
import zenoh

from dtwin.bus.codec import encode
from dtwin.bus.messages import ALIVE, EVENTS, RESET, SENSORS, STATUS, TOPICS, Done, ResetRequest
from dtwin.bus.opening import open_configured, open_peer
from dtwin.bus.session import Bus, Publisher
from dtwin.bus.signature import new_key
from dtwin.errors import CommunicationError, ParameterError, UnansweredError
from dtwin.parameters import ROOT
from dtwin.signals import Event, Sensors
from tests.support.ports import free_port
from tests.support.waiting import until

WAITS = zenoh.CongestionControl.BLOCK
"""behind five megabytes other messages are thrown away where a receiver is slow"""
SAMPLE = Sensors(1, 0.01, (0.1, 0.2, 0.3), 0.9, True, "red")
WAIT = 10.0
SHIPPED = sorted((ROOT / "config").rglob("*.json5"))

Join = Callable[..., Bus]


@pytest.fixture
def rendezvous() -> str:
    return f"tcp/127.0.0.1:{free_port()}"


@pytest.fixture
def join(rendezvous: str) -> Iterator[Join]:
    """Joins buses that meet each other, and closes them."""
    joined = []

    def make(cell: str = "cell") -> Bus:
        joined.append(Bus(open_peer(rendezvous), cell))
        return joined[-1]

    yield make
    for bus in joined:
        bus.close()


class Heard:
    """What a subscriber received."""

    def __init__(self, bus: Bus) -> None:
        self.messages: SimpleQueue[Sensors] = SimpleQueue()
        bus.subscribe(SENSORS, Sensors, self.messages.put)


def announced(bus: Bus, name: str) -> threading.Event:
    """An event that is set when the bus sees the service's token."""
    seen = threading.Event()
    bus.watch_alive(lambda service, alive: seen.set() if alive and service == name else None)
    return seen


def test_messages_arrive_whole_and_in_order(join: Join) -> None:
    sender, receiver = join(), join()
    heard = Heard(receiver)
    receiver.announce("receiver")
    assert announced(sender, "receiver").wait(WAIT)
    publish = sender.publisher(SENSORS, lossless=True)
    assert publish.wanted
    samples = [Sensors(k, 0.01 * k, (k / 3, -k / 7, 1e-300), 0.9, k % 2 == 0, "green") for k in range(500)]
    for sample in samples:
        publish(sample)
    assert [heard.messages.get(timeout=WAIT) for _ in samples] == samples


def test_a_receiver_too_slow_for_samples_misses_no_event(join: Join) -> None:
    sender, receiver = join(), join()
    hold, samples, events = threading.Event(), list[Sensors](), list[Event]()

    def wait(sample: Sensors) -> None:
        samples.append(sample)
        hold.wait(WAIT)

    receiver.subscribe(SENSORS, Sensors, wait)
    receiver.subscribe(EVENTS, Event, events.append)
    sample, tell = sender.publisher(SENSORS), sender.publisher(EVENTS)
    until(lambda: sample.wanted and tell.wanted, "both topics have a subscriber")
    for _ in range(100_000):  # more than sockets hold
        sample(SAMPLE)
    for k in range(50):
        tell(Event(0.01 * k, "test", "told while the receiver is busy"))
    hold.set()
    until(lambda: len(events) == 50, "all events arrive")
    assert len(samples) < 100_000


def test_nobody_wants_what_nobody_subscribes_to(join: Join) -> None:
    assert not join().publisher(SENSORS).wanted


def test_an_ended_subscription_hears_nothing_and_is_not_wanted(join: Join) -> None:
    sender, receiver = join(), join()
    first: SimpleQueue[Sensors] = SimpleQueue()
    subscription = receiver.subscribe(SENSORS, Sensors, first.put)
    publish = sender.publisher(SENSORS, lossless=True)
    until(lambda: publish.wanted, "the subscription is known")
    publish(SAMPLE)
    assert first.get(timeout=WAIT) == SAMPLE
    subscription.end()
    until(lambda: not publish.wanted, "its end is known")
    publish(SAMPLE)
    second = Heard(receiver)
    until(lambda: publish.wanted, "another subscription is known")
    publish(SAMPLE)
    assert second.messages.get(timeout=WAIT) == SAMPLE
    assert first.empty()


def test_three_meet_whoever_comes_first_and_goes(join: Join) -> None:
    first, second = join(), join()
    first.announce("first")
    assert announced(second, "first").wait(WAIT)
    first.close()
    third = join()
    third.announce("third")
    assert announced(second, "third").wait(WAIT)


def test_cells_do_not_hear_each_other(join: Join) -> None:
    sender, other, same = join("one"), join("two"), join("one")
    strange, heard = Heard(other), Heard(same)
    for bus, name in ((other, "other"), (same, "same")):
        bus.announce(name)
    assert announced(sender, "same").wait(WAIT)
    sender.publisher(SENSORS)(SAMPLE)
    assert heard.messages.get(timeout=WAIT) == SAMPLE
    assert strange.messages.empty()


def test_tokens_go_with_their_session(join: Join) -> None:
    watcher, service = join(), join()
    seen: SimpleQueue[tuple[str, bool]] = SimpleQueue()
    watcher.watch_alive(lambda name, alive: seen.put((name, alive)))
    service.announce("bridge")
    assert seen.get(timeout=WAIT) == ("bridge", True)
    service.close()
    assert seen.get(timeout=WAIT) == ("bridge", False)


def test_refused_messages_are_counted_by_reason(join: Join, caplog: pytest.LogCaptureFixture) -> None:
    receiver, sender = join(), join()
    heard = Heard(receiver)
    receiver.announce("receiver")
    assert announced(sender, "receiver").wait(WAIT)
    key = sender.key(SENSORS)
    raw = sender._session
    for payload in (
        b"",
        b"\x00\xff",
        b"[]",
        encode(SAMPLE).replace(b":1,", b":2,", 1),
        70_000 * b"x",
        5_000_000 * b"x",
    ):
        raw.put(key, payload, congestion_control=WAITS)
    raw.delete(key, congestion_control=WAITS)
    raw.put(key, encode(SAMPLE), congestion_control=WAITS)  # of the same priority, so it comes last
    assert heard.messages.get(timeout=WAIT) == SAMPLE
    # the largest one is more than the session takes, and never gets here
    assert receiver.refused == {"malformed": 3, "invalid": 2, "too long": 1}
    assert all("\n" not in record.getMessage() for record in caplog.records)


class Counter:
    """Answers queries, and counts what acted."""

    def __init__(self, bus: Bus) -> None:
        self.acted: list[ResetRequest] = []
        bus.answer(RESET, ResetRequest, self._act, self._read)

    def _act(self, asked: ResetRequest) -> Done:
        self.acted.append(asked)
        return self._read()

    def _read(self) -> Done:
        return Done(0.0, f"{len(self.acted)} actions")


def test_a_query_with_a_message_acts_and_one_without_reads(join: Join) -> None:
    asker, answerer = join(), join()
    counter = Counter(answerer)
    assert asker.ask(RESET, None, Done).text == "0 actions"
    assert asker.ask(RESET, ResetRequest(5), Done).text == "1 actions"
    assert asker.ask(RESET, None, Done).text == "1 actions"
    assert counter.acted == [ResetRequest(5)]


def test_a_wildcard_reads_and_never_acts(rendezvous: str, join: Join) -> None:
    counter = Counter(join())
    with open_peer(rendezvous) as session:
        until(lambda: replies(session, "dtwin/**", b"") == ["ok"], "the answerer is found")
        message = encode(ResetRequest(5))
        for expression in ("dtwin/**", "dtwin/cell/arm/emulator/*", "*/cell/arm/emulator/reset"):
            assert replies(session, expression, message) == ["error"]
        assert counter.acted == []
        assert replies(session, "dtwin/cell/arm/emulator/reset", message) == ["ok"]
    assert counter.acted == [ResetRequest(5)]


def replies(session: zenoh.Session, expression: str, payload: bytes) -> list[str]:
    found = session.get(expression, payload=payload, timeout=5.0)
    return ["ok" if reply.ok is not None else "error" for reply in found]


def test_an_empty_query_for_an_action_is_refused(join: Join) -> None:
    asker, answerer = join(), join()
    answerer.answer(RESET, ResetRequest, lambda asked: pytest.fail("must not be called"))
    with pytest.raises(CommunicationError, match="expected a ResetRequest"):
        asker.ask(RESET, None, Done)
    assert answerer.refused == {"empty": 1}


def test_only_who_has_the_key_of_a_cell_may_do_anything(rendezvous: str, join: Join) -> None:
    key = new_key()
    with Bus(open_peer(rendezvous), key=key) as answerer, Bus(open_peer(rendezvous), key=key) as service:
        counter = Counter(answerer)
        with pytest.raises(CommunicationError, match="unsigned"):
            join().ask(RESET, ResetRequest(1), Done)
        with Bus(open_peer(rendezvous), key=new_key()) as stranger, pytest.raises(UnansweredError, match="forged"):
            stranger.ask(RESET, ResetRequest(2), Done, 0.5)
        assert join().ask(RESET, None, Done).text == "0 actions"
        assert service.ask(RESET, ResetRequest(3), Done).text == "1 actions"
        assert counter.acted == [ResetRequest(3)]


def test_a_cell_with_a_key_hears_only_its_services(rendezvous: str) -> None:
    key = new_key()
    with (
        Bus(open_peer(rendezvous), key=key) as receiver,
        Bus(open_peer(rendezvous), key=key) as service,
        Bus(open_peer(rendezvous)) as rival,
        Bus(open_peer(rendezvous)) as watcher,
    ):
        heard, seen = Heard(receiver), Heard(watcher)
        forge, publish = rival.publisher(SENSORS, lossless=True), service.publisher(SENSORS, lossless=True)

        def refused() -> bool:
            forge(SAMPLE)
            return receiver.refused["unsigned"] > 0

        # Somebody who wants the topic may be the watcher alone, so that a first sample may not reach the receiver.
        until(refused, "the forged sample is refused")
        assert heard.messages.empty()

        def arrives() -> bool:
            publish(SAMPLE)
            return not heard.messages.empty()

        until(arrives, "the sample of a service is heard")
        assert heard.messages.get() == SAMPLE
        for sender in (forge, publish):
            while not seen.messages.empty():
                seen.messages.get()

            def passes(sender: Publisher = sender) -> bool:
                sender(SAMPLE)
                return not seen.messages.empty()

            until(passes, "a watcher without the key sees everything")


def test_the_first_stranger_is_told_once(rendezvous: str) -> None:
    key = new_key()
    told: list[str] = []
    with (
        Bus(open_peer(rendezvous), key=key) as receiver,
        Bus(open_peer(rendezvous)) as rival,
        Bus(open_peer(rendezvous), key=new_key()) as forger,
    ):
        receiver.subscribe(SENSORS, Sensors, lambda sample: None, stranger=lambda: told.append("stranger"))
        senders = [bus.publisher(SENSORS, lossless=True) for bus in (rival, forger)]

        def refused() -> bool:
            for publish in senders:
                publish(SAMPLE)
            return receiver.refused["unsigned"] > 3 and receiver.refused["forged"] > 3

        until(refused, "both are refused")
    assert told == ["stranger"]


def test_a_handler_that_fails_answers_and_goes_on_answering(join: Join) -> None:
    asker, answerer = join(), join()

    def fail(asked: ResetRequest) -> Done:
        if asked.seed == 1:
            raise OverflowError("too large")
        return Done(0.0, "done")

    answerer.answer(RESET, ResetRequest, fail)
    for _ in range(2):
        with pytest.raises(CommunicationError, match="failed: OverflowError"):
            asker.ask(RESET, ResetRequest(1), Done)
    assert asker.ask(RESET, ResetRequest(2), Done).text == "done"
    assert answerer.refused == {"failed": 2}


def test_a_query_gets_the_reason_for_a_refusal(join: Join) -> None:
    asker, answerer = join(), join()

    def refuse(asked: ResetRequest) -> Done:
        raise ParameterError("not today")

    answerer.answer(RESET, ResetRequest, refuse)
    with pytest.raises(CommunicationError, match="emulator/reset: not today"):
        asker.ask(RESET, ResetRequest(1), Done)


def test_a_malformed_query_never_reaches_the_handler(join: Join) -> None:
    asker, answerer = join(), join()
    answerer.answer(RESET, ResetRequest, lambda asked: pytest.fail("must not be called"))
    with pytest.raises(CommunicationError, match="invalid"):
        asker.ask(RESET, SAMPLE, Done)
    assert answerer.refused == {"invalid": 1}


def test_a_query_that_nobody_answers_says_who_is_missing(join: Join) -> None:
    with pytest.raises(UnansweredError, match="is the service emulator there"):
        join().ask(RESET, None, Done, 0.2)


def test_a_service_that_takes_too_long_is_not_taken_for_a_refusal(join: Join) -> None:
    answerer, asker, free = join(), join(), threading.Event()

    def slow(message: ResetRequest) -> Done:
        free.wait(WAIT)
        return Done(0.0, "late")

    answerer.answer(RESET, ResetRequest, slow)
    try:
        with pytest.raises(UnansweredError, match=r"reset: emulator did not answer within 0\.3 s$"):
            asker.ask(RESET, ResetRequest(1), Done, 0.3)
    finally:
        free.set()


def test_keys_of_all_topics_differ(join: Join) -> None:
    bus = join()
    keys = {bus.key(topic, "emulator") for topic in TOPICS}
    assert len(keys) == len(TOPICS)
    assert bus.key(STATUS, "bridge") == "dtwin/cell/arm/status/bridge"
    assert bus.key(ALIVE) == "dtwin/cell/arm/alive/*"
    for key in keys:
        zenoh.KeyExpr(key)


def test_many_urgent_messages_may_wait_however_a_session_is_opened(
    tmp_path: Path, rendezvous: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened: list[zenoh.Config] = []
    open_really = zenoh.open

    def note(configuration: zenoh.Config) -> zenoh.Session:
        opened.append(configuration)
        return open_really(configuration)

    monkeypatch.setattr(zenoh, "open", note)
    file = tmp_path / "service.json5"
    file.write_text('{ mode: "peer", scouting: { multicast: { enabled: false } } }')
    for session in (open_peer(rendezvous), open_configured(file)):
        session.close()
    sizes = [configuration.get_json("transport/link/tx/queue/size/real_time") for configuration in opened]
    assert sizes == ["16", "16"]


@pytest.mark.parametrize("endpoint", ["", "nowhere", "tcp/host", "tcp/127.0.0.1:x", "tcp/127.0.0.1:99999"])
def test_no_endpoint_is_an_error_in_one_line(endpoint: str) -> None:
    with pytest.raises(CommunicationError, match="expected an endpoint"):
        open_peer(endpoint)


def test_configuration_files_are_found_and_checked(tmp_path: Path) -> None:
    with pytest.raises(CommunicationError, match="missing"):
        open_configured(tmp_path / "missing.json5", "bridge")
    with pytest.raises(CommunicationError, match="no Zenoh configuration"):
        open_configured(tmp_path, "bridge")
    (tmp_path / "bridge.json5").write_text("{ mode: 'neither' }")
    with pytest.raises(CommunicationError, match="no Zenoh configuration"):
        open_configured(tmp_path, "bridge")


@pytest.mark.parametrize(
    "file", sorted((ROOT / "config").rglob("*.json5")), ids=lambda f: f"{f.parent.name}/{f.stem}"
)
def test_shipped_files_are_configurations_that_find_others_only_by_endpoint(file: Path) -> None:
    configuration = zenoh.Config.from_file(file)
    assert configuration.get_json("scouting/multicast/enabled") == "false"
    assert configuration.get_json("transport/shared_memory/enabled") == "false", "it would pass the limit by"
    assert int(configuration.get_json("transport/link/rx/max_message_size")) == 1 << 20


def test_clients_of_a_router_find_each_other_again_after_it_was_away(tmp_path: Path, rendezvous: str) -> None:
    host = rendezvous.removeprefix("tcp/")
    for file in (ROOT / "config" / "routed").glob("*.json5"):
        text = file.read_text().replace("0.0.0.0:7447", host).replace("127.0.0.1:7447", host)
        (tmp_path / file.name).write_text(text)
    router = open_configured(tmp_path, "router")
    sender, receiver = Bus(open_configured(tmp_path, "emulator")), Bus(open_configured(tmp_path, "recorder"))
    publish, heard = sender.publisher(SENSORS), Heard(receiver)
    lost = threading.Event()
    receiver.announce("receiver")
    sender.watch_alive(lambda name, alive: lost.set() if not alive else lost.clear())

    def passes() -> bool:
        publish(SAMPLE)
        return not heard.messages.empty()

    try:
        until(passes, "a message passes")
        router.close()
        assert lost.wait(WAIT)
        while not heard.messages.empty():
            heard.messages.get()
        router = open_configured(tmp_path, "router")
        until(passes, "messages pass again")
    finally:
        for end in (sender, receiver, router):
            end.close()
