"""Signed messages: what a subscriber with the cell's key takes and what it refuses."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dtwin.bus.codec import MessageError
from dtwin.bus.signature import Signer, Verifier, new_key

EXPRESSION = "dtwin/cell/arm/voltages"
KEY = bytes(range(32))


def refusal(verifier: Verifier, payload: bytes, attachment: bytes | None) -> str:
    with pytest.raises(MessageError) as found:
        verifier(payload, attachment)
    return found.value.reason


@given(st.lists(st.binary(max_size=200), min_size=1, max_size=20))
def test_messages_of_one_sender_are_taken_once_and_in_order(payloads: list[bytes]) -> None:
    sign, verify = Signer(KEY, EXPRESSION), Verifier(KEY, EXPRESSION)
    attachments = [sign(payload) for payload in payloads]
    senders = {verify(payload, seal) for payload, seal in zip(payloads, attachments, strict=True)}
    assert len(senders) == 1
    for payload, seal in zip(payloads, attachments, strict=True):
        assert refusal(verify, payload, seal) == "replayed"


@given(st.binary(max_size=100), st.binary(max_size=80))
def test_nobody_signs_without_the_key(payload: bytes, guess: bytes) -> None:
    assert refusal(Verifier(KEY, EXPRESSION), payload, None) == "unsigned"
    assert refusal(Verifier(KEY, EXPRESSION), payload, guess) in ("unsigned", "forged")
    assert refusal(Verifier(KEY, EXPRESSION), payload, Signer(new_key(), EXPRESSION)(payload)) == "forged"


@given(st.binary(min_size=1, max_size=100), st.data())
def test_a_signature_belongs_to_one_payload_under_one_key_expression(payload: bytes, data: st.DataObject) -> None:
    seal = Signer(KEY, EXPRESSION)(payload)
    at = data.draw(st.integers(0, 8 * (len(payload) + len(seal)) - 1))
    both = bytearray(payload + seal)
    both[at // 8] ^= 1 << at % 8
    assert refusal(Verifier(KEY, EXPRESSION), bytes(both[: len(payload)]), bytes(both[len(payload) :])) == "forged"
    assert refusal(Verifier(KEY, "dtwin/cell/arm/events"), payload, seal) == "forged"


def test_two_publishers_are_two_senders() -> None:
    verify = Verifier(KEY, EXPRESSION)
    first, second = (verify(b"a", Signer(KEY, EXPRESSION)(b"a")) for _ in range(2))
    assert first != second


def test_a_sender_is_met_by_what_it_says_now() -> None:
    """Whoever has kept old messages of a service cannot introduce it to a subscriber who comes later."""
    now = 10**18
    sign = Signer(KEY, EXPRESSION, lambda: now)
    kept, later = sign(b"a"), sign(b"b")
    verify = Verifier(KEY, EXPRESSION, lambda: now + 31 * 10**9)
    assert refusal(verify, b"a", kept) == "stale"
    assert refusal(Verifier(KEY, EXPRESSION, lambda: now - 31 * 10**9), b"a", kept) == "stale"
    soon = Verifier(KEY, EXPRESSION, lambda: now + 29 * 10**9)
    assert soon(b"a", kept) == soon(b"b", later) == sign.sender


def test_a_clock_that_is_set_back_silences_nobody() -> None:
    times = iter((10**18, 10**18 - 10**10, 10**18 - 10**10))
    sign = Signer(KEY, EXPRESSION, lambda: next(times))
    verify = Verifier(KEY, EXPRESSION, lambda: 10**18)
    assert [verify(b"a", sign(b"a")) for _ in range(3)] == 3 * [sign.sender]
