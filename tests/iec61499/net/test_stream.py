"""Streams and UDP under the communication blocks, and the blocking client: loopback, free ports, one reactor."""

from __future__ import annotations

import random
import select
import socket
import threading
import tracemalloc
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing, contextmanager, suppress
from functools import partial
from typing import Any

import pytest

from dtwin.errors import CommunicationError
from iec61499.net.address import (
    LOOPBACK,
    Address,
    StreamAddress,
    parse_address,
    parse_block_id,
)
from iec61499.net.client import BlockingClient
from iec61499.net.reactor import READ, Reactor
from iec61499.net.sockets import connected_socket
from iec61499.net.stream import CANDIDATES, StreamListener, StreamServer
from iec61499.net.tcp import TcpClient
from iec61499.net.udp import UdpPublisher, UdpSubscriber
from iec61499.net.wire import Message, Signature
from iec61499.types import elementary
from tests.support.waiting import until

ANY_PORT = Address(LOOPBACK, 0)
PATIENCE = 10.0
SENSORS = Signature([elementary(name) for name in ["LREAL"] * 4 + ["BOOL", "STRING"]])
VOLTAGES = Signature([elementary(name) for name in ["LREAL"] * 4 + ["BOOL"]])
NUMBER = Signature([elementary("DINT")])
NOTHING = Signature([])


def pump(reactor: Reactor, condition: Callable[[], Any]) -> None:
    """Runs the reactor in this thread until the condition is true."""
    until(condition, "what the reactor is to do", PATIENCE, lambda: reactor.run_once(0.05))


def connect(address: StreamAddress) -> socket.socket:
    return connected_socket(address, PATIENCE)


@contextmanager
def served(reactor: Reactor) -> Iterator[None]:
    thread = threading.Thread(target=reactor.run)
    thread.start()
    try:
        yield
    finally:
        reactor.stop()
        thread.join(PATIENCE)
        assert not thread.is_alive()


@pytest.fixture
def reactor() -> Iterator[Reactor]:
    with Reactor() as reactor:
        yield reactor


def number_server(reactor: Reactor, address: StreamAddress) -> StreamServer:
    """A server that answers every number with its double."""
    server = StreamServer(reactor, address, NUMBER, NUMBER, lambda message: server.send([2 * message[0]]))
    return server


@pytest.fixture
def doubler(reactor: Reactor, stream_address: StreamAddress) -> Iterator[StreamServer]:
    with closing(number_server(reactor, stream_address)) as server:
        yield server


def test_timers_come_in_order_and_cancelled_ones_never(reactor: Reactor) -> None:
    seen: list[str] = []
    now = reactor.now()
    reactor.call_at(now + 0.002, lambda: seen.append("late"))
    reactor.call_at(now, lambda: seen.append("first"))
    reactor.call_at(now, lambda: seen.append("second"))
    reactor.call_at(now, lambda: seen.append("never")).cancel()
    pump(reactor, lambda: len(seen) == 3)
    assert seen == ["first", "second", "late"]
    assert reactor.now() >= now + 0.002


def test_a_timer_asked_for_when_it_is_due_already_waits_for_the_next_turn(reactor: Reactor) -> None:
    seen: list[str] = []

    def again() -> None:
        seen.append("timer")
        reactor.call_at(reactor.now() - 1.0, again)

    near, far = socket.socketpair()
    with near, far:
        reactor.watch(near, READ, lambda events: seen.append(near.recv(1).decode()))
        reactor.call_at(reactor.now(), again)
        for text in ("a", "b"):
            far.send(text.encode())
            reactor.run_once(0.0)
        reactor.forget(near)
    assert seen == ["a", "timer", "b", "timer"]


def test_one_call_asked_for_soon_is_made_in_a_turn(reactor: Reactor) -> None:
    seen: list[str] = []
    for name in ("first", "second"):
        reactor.call_soon(partial(seen.append, name))
    reactor.call_soon(lambda: seen.append("never")).cancel()
    reactor.call_at(reactor.now(), lambda: seen.append("timer"))
    reactor.run_once(None)
    assert seen == ["first", "timer"]
    reactor.run_once(None)
    assert seen == ["first", "timer", "second"]


def test_another_thread_asks_for_a_call(reactor: Reactor) -> None:
    thread = threading.Thread(target=lambda: reactor.call_soon_threadsafe(reactor.stop))
    thread.start()
    reactor.run()
    thread.join()


def test_stop_from_another_thread_ends_run(reactor: Reactor) -> None:
    with served(reactor):
        pass
    with served(reactor):
        pass


def test_a_socket_closed_in_the_same_round_is_not_served(reactor: Reactor) -> None:
    pairs = [socket.socketpair(), socket.socketpair()]
    rounds: list[int] = []

    def serve(events: int) -> None:
        rounds.append(events)
        for near, _ in pairs:
            reactor.forget(near)

    for near, far in pairs:
        reactor.watch(near, READ, serve)
        far.send(b"x")
    reactor.run_once(1.0)
    assert rounds == [READ]
    for pair in pairs:
        for sock in pair:
            sock.close()


@pytest.mark.parametrize(
    ("text", "address"),
    [
        ("localhost:61500", ("127.0.0.1", 61500)),
        (":0", ("127.0.0.1", 0)),
        ("fbdk[].ip[192.168.0.7:1]", ("192.168.0.7", 1)),
    ],
)
def test_block_ids(text: str, address: tuple[str, int]) -> None:
    assert parse_block_id(text) == address


@pytest.mark.parametrize(
    "text", ["", "localhost", "localhost:", "a:65536", "a:-1", "host.example:1", "raw[].ip[a:1]"]
)
def test_bad_block_ids(text: str) -> None:
    with pytest.raises(CommunicationError, match="expected"):
        parse_block_id(text)


def test_addresses_with_a_scheme() -> None:
    assert parse_address("tcp://plant:61500", "tcp") == ("plant", 61500)
    with pytest.raises(CommunicationError, match="expected tcp://HOST:PORT"):
        parse_address("udp://plant:61500", "tcp")


def test_server_answers_split_and_joined_messages(reactor: Reactor, doubler: StreamServer) -> None:
    stream = b"".join(NUMBER.encode([n]) for n in (1, 2, 3))
    with served(reactor), connect(doubler.address) as sock:
        for i in range(len(stream)):
            sock.send(stream[i : i + 1])
        sock.send(stream)
        answers = b""
        while len(answers) < 30:
            answers += sock.recv(100)
    assert answers == b"".join(NUMBER.encode([n]) for n in (2, 4, 6)) * 2


def test_a_server_without_values_answers_null(reactor: Reactor, stream_address: StreamAddress) -> None:
    server = StreamServer(reactor, stream_address, NOTHING, NOTHING, lambda message: server.send([]))
    with served(reactor), connect(server.address) as sock:
        sock.send(b"\x05")
        assert sock.recv(10) == b"\x05"
    server.close()


def test_what_is_sent_reaches_those_who_only_listen(reactor: Reactor, stream_address: StreamAddress) -> None:
    server = StreamServer(reactor, stream_address, NOTHING, NUMBER, lambda message: None)
    first, second = connect(server.address), connect(server.address)
    reactor.run_once(0.05)
    reactor.run_once(0.05)
    server.send([7])
    for sock in (first, second):
        assert sock.recv(100) == NUMBER.encode([7])
    # who speaks first becomes the one client
    first.sendall(NOTHING.encode([]))
    with suppress(ConnectionError):
        pump(reactor, lambda: _ended(second))
    server.send([8])
    assert first.recv(100) == NUMBER.encode([8])
    for sock in (first, second):
        sock.close()
    server.close()


def _ended(sock: socket.socket) -> bool:
    sock.setblocking(False)
    try:
        return sock.recv(100) == b""
    except BlockingIOError:
        return False


def test_second_client_is_refused_and_the_first_stays(
    reactor: Reactor, doubler: StreamServer, caplog: pytest.LogCaptureFixture
) -> None:
    with served(reactor), BlockingClient(doubler.address, NUMBER, NUMBER, PATIENCE) as first:
        assert first.exchange([4]) == (8,)
        with connect(doubler.address) as second:
            assert second.recv(1) == b""
        assert first.exchange([5]) == (10,)
    assert len(caplog.records) == 1
    assert "refused" in caplog.text


def test_the_port_is_free_again_after_the_client_has_gone(reactor: Reactor, doubler: StreamServer) -> None:
    with served(reactor):
        for number in range(5):
            with BlockingClient(doubler.address, NUMBER, NUMBER, PATIENCE) as client:
                assert client.exchange([number]) == (2 * number,)


def test_silent_clients_keep_nobody_out(
    reactor: Reactor, doubler: StreamServer, caplog: pytest.LogCaptureFixture
) -> None:
    with served(reactor):
        silent = [connect(doubler.address) for _ in range(100)]
        silent[-1].send(b"\x44")
        with BlockingClient(doubler.address, NUMBER, NUMBER, PATIENCE) as client:
            assert client.exchange([21]) == (42,)
            for sock in silent:
                assert sock.recv(1) == b""
                sock.close()
            assert client.exchange([1]) == (2,)
    assert len(caplog.records) == 100
    assert CANDIDATES < 100


def test_wrong_bytes_cost_one_line_and_the_connection(
    reactor: Reactor, doubler: StreamServer, caplog: pytest.LogCaptureFixture
) -> None:
    with served(reactor):
        with connect(doubler.address) as sock:
            sock.send(b"\x4b")
            assert sock.recv(1) == b""
        with BlockingClient(doubler.address, NUMBER, NUMBER, PATIENCE) as client:
            assert client.exchange([3]) == (6,)
    assert len(caplog.records) == 1
    assert "byte 0: expected tag 0x44 (DINT), got 0x4B (LREAL)" in caplog.text


def test_fuzzed_bytes_do_no_harm(reactor: Reactor, doubler: StreamServer) -> None:
    rng = random.Random(3)
    with served(reactor):
        for _ in range(100):
            with connect(doubler.address) as sock:
                data = rng.randbytes(rng.randrange(1, 200))
                sock.send(data)
                sock.shutdown(socket.SHUT_WR)
                drain(sock)
        with BlockingClient(doubler.address, NUMBER, NUMBER, PATIENCE) as client:
            assert client.exchange([3]) == (6,)


def drain(sock: socket.socket) -> None:
    """Reads until the peer closes."""
    with suppress(ConnectionResetError):
        while sock.recv(65536):
            pass


def flood(sock: socket.socket, data: bytes) -> None:
    for _ in range(100_000):
        sock.send(data)


def test_a_peer_that_does_not_read_is_dropped(
    reactor: Reactor, stream_address: StreamAddress, caplog: pytest.LogCaptureFixture
) -> None:
    text = Signature([elementary("STRING")])
    server = StreamServer(reactor, stream_address, NUMBER, text, lambda message: server.send(["x" * 60000]))
    tracemalloc.start()
    with served(reactor), connect(server.address) as sock, pytest.raises((ConnectionResetError, BrokenPipeError)):
        flood(sock, NUMBER.encode([1]))
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    server.close()
    assert "bytes unread" in caplog.text
    assert peak < 8 << 20


def test_listening_on_a_port_in_use_names_it(reactor: Reactor, doubler: StreamServer) -> None:
    with pytest.raises(CommunicationError, match=f"cannot listen on {doubler.address}: Address already in use"):
        StreamListener(reactor, doubler.address, lambda sock, peer: None)


def test_client_exchanges_with_a_server(reactor: Reactor) -> None:
    doubler = number_server(reactor, ANY_PORT)
    assert isinstance(doubler.address, Address)
    opened: list[str] = []
    confirmed: list[Message] = []
    lost: list[bool] = []
    client = TcpClient(
        reactor,
        doubler.address,
        NUMBER,
        NUMBER,
        opened=opened.append,
        confirm=confirmed.append,
        lost=lambda: lost.append(True),
    )
    with pytest.raises(CommunicationError, match="not connected"):
        client.send([1])
    pump(reactor, lambda: opened)
    assert opened == [""]
    client.send([50])
    pump(reactor, lambda: confirmed)
    assert confirmed == [(100,)]
    doubler.close()
    pump(reactor, lambda: lost)
    assert not client.connected
    client.close()


def test_client_says_why_it_cannot_connect(reactor: Reactor) -> None:
    doubler = number_server(reactor, ANY_PORT)
    address = doubler.address
    assert isinstance(address, Address)
    doubler.close()
    opened: list[str] = []
    TcpClient(reactor, address, NUMBER, NUMBER, opened=opened.append, confirm=print, lost=print)
    pump(reactor, lambda: opened)
    assert opened == [f"{address}: cannot connect: Connection refused"]


def test_blocking_client_names_late_and_lost_answers(reactor: Reactor, stream_address: StreamAddress) -> None:
    server = StreamServer(reactor, stream_address, NUMBER, NUMBER, lambda message: None)
    with served(reactor):
        client = BlockingClient(server.address, NUMBER, NUMBER, timeout=0.05)
        with pytest.raises(CommunicationError, match=rf"{server.address}: no answer within 0.05 s"):
            client.exchange([1])
        with pytest.raises(CommunicationError, match="connection lost"):
            client.exchange([1])
    server.close()
    with pytest.raises(CommunicationError, match="cannot connect: "):
        BlockingClient(server.address, NUMBER, NUMBER, timeout=1.0)


def test_blocking_client_notices_that_the_server_closes(reactor: Reactor, stream_address: StreamAddress) -> None:
    server = StreamServer(reactor, stream_address, NUMBER, NUMBER, lambda message: server.close())
    client = BlockingClient(server.address, NUMBER, NUMBER, PATIENCE)
    with served(reactor), client, pytest.raises(CommunicationError, match="connection lost"):
        client.exchange([1])


def test_blocking_client_refuses_two_answers(reactor: Reactor, stream_address: StreamAddress) -> None:
    answers = NUMBER.encode([1]) + NUMBER.encode([2])

    with ExitStack() as peers:

        def accepted(sock: socket.socket, peer: str) -> None:
            peers.enter_context(sock).sendall(answers)

        listener = StreamListener(reactor, stream_address, accepted)
        client = BlockingClient(listener.address, NUMBER, NUMBER, PATIENCE)
        with served(reactor), client, pytest.raises(CommunicationError, match="more than one answer"):
            client.exchange([1])
        listener.close()


def test_blocking_client_takes_no_late_answer_for_that_of_the_next_request(
    reactor: Reactor, stream_address: StreamAddress
) -> None:
    requests: list[int] = []

    def doubled(message: Message) -> None:
        requests.append(message[0])
        if len(requests) == 2:
            server.send([2 * requests[0]])  # the first client has given up; who asks now is answered
        if len(requests) > 1:
            server.send([2 * message[0]])

    server = StreamServer(reactor, stream_address, NUMBER, NUMBER, doubled)
    with served(reactor):
        first = BlockingClient(server.address, NUMBER, NUMBER, timeout=0.05)
        with pytest.raises(CommunicationError, match="no answer"):
            first.exchange([1])
        with BlockingClient(server.address, NUMBER, NUMBER, PATIENCE) as second, suppress(CommunicationError):
            second.exchange([5])
            until(lambda: select.select([second._sock], [], [], 0.0)[0], "the answer to it has come, too")
            with pytest.raises(CommunicationError, match="more than one answer"):
                second.exchange([6])
        with BlockingClient(server.address, NUMBER, NUMBER, PATIENCE) as third:
            assert [third.exchange([number]) for number in (7, 8)] == [(14,), (16,)]
    server.close()


@pytest.mark.parametrize("host", ["127.0.0.1", "239.192.7.1"])
def test_published_messages_arrive(reactor: Reactor, host: str) -> None:
    messages: list[Message] = []
    subscriber = UdpSubscriber(reactor, Address(host, 0), SENSORS, messages.append)
    publisher = UdpPublisher(Address(host, subscriber.address.port), SENSORS)
    sample = (0.1, 0.2, 0.3, 0.9, False, "")
    publisher.send(sample)
    publisher.send(sample)
    pump(reactor, lambda: len(messages) == 2)
    assert messages == [sample, sample]
    publisher.close()
    subscriber.close()


def test_who_subscribes_at_the_address_of_another_one_is_refused_and_takes_nothing_away(reactor: Reactor) -> None:
    messages: list[Message] = []
    with closing(UdpSubscriber(reactor, ANY_PORT, NUMBER, messages.append)) as first:
        with pytest.raises(CommunicationError, match=f"cannot subscribe to {first.address}: Address already in use"):
            UdpSubscriber(reactor, first.address, NUMBER, messages.append)
        with closing(UdpPublisher(first.address, NUMBER)) as publisher:
            publisher.send([5])
            pump(reactor, lambda: messages)
    assert messages == [(5,)]
    UdpSubscriber(reactor, first.address, NUMBER, messages.append).close()


def test_wrong_datagrams_are_ignored(reactor: Reactor, caplog: pytest.LogCaptureFixture) -> None:
    messages: list[Message] = []
    subscriber = UdpSubscriber(reactor, ANY_PORT, NUMBER, messages.append)
    rng = random.Random(5)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        for _ in range(50):
            sock.sendto(b"\x00" + rng.randbytes(rng.randrange(0, 100)), subscriber.address)
        sock.sendto(NUMBER.encode([7]), subscriber.address)
        pump(reactor, lambda: messages)
    assert messages == [(7,)]
    assert len(caplog.records) == 50
    assert "datagram ignored" in caplog.text
    subscriber.close()
