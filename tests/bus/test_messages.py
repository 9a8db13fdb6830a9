"""The bus's messages: what is refused and why, and the page that describes them."""

import re
from pathlib import Path
from typing import Any

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dtwin.bus.chain.messages import JointUploadRequest
from dtwin.bus.codec import SIZE_LIMIT, MessageError, Reader, encode
from dtwin.bus.messages import TOPICS, SettingsRequest
from dtwin.bus.twin_messages import UploadRequest
from dtwin.controller.settings import usual_gains
from dtwin.parameters import ArmParameters
from dtwin.signals import MONITOR, Event, EventKind, Sensors, Voltages

PAGE = (Path(__file__).resolve().parents[2] / "docs" / "zenoh.md").read_text()
COMMAND = Voltages(7, 0.07, (1.0, -8.0, 8.0, 3.0), True)
MESSAGES = sorted({m for topic in TOPICS for m in (topic.message, topic.reply) if m}, key=lambda m: m.__name__)

finite = st.floats(allow_nan=False, allow_infinity=False)
volts = st.floats(-8, 8)


def rows(text: str) -> list[list[str]]:
    """The cells of a Markdown table, without its head."""
    lines = [line for line in text.splitlines() if line.startswith("|")]
    return [[cell.strip().strip("`") for cell in line.strip("|").split("|")] for line in lines[2:]]


def section(title: str) -> str:
    found = re.search(rf"^##+ {title}\n(.*?)(?=^#|\Z)", PAGE, re.M | re.S)
    assert found, f"no section {title}"
    return found[1]


def kind(info: Any) -> str:
    """A type as the page writes it."""
    simple: dict[type, str] = {
        msgspec.inspect.FloatType: "number",
        msgspec.inspect.IntType: "integer",
        msgspec.inspect.BoolType: "boolean",
        msgspec.inspect.StrType: "string",
        msgspec.inspect.LiteralType: "string",
        msgspec.inspect.NoneType: "null",
    }
    if type(info) in simple:
        return simple[type(info)]
    if isinstance(info, msgspec.inspect.TupleType):
        kinds = [kind(item) for item in info.item_types]
        return f"{len(kinds)} x {kinds[0]}" if len(set(kinds)) == 1 else f"({', '.join(kinds)})"
    if isinstance(info, msgspec.inspect.VarTupleType) and info.min_length == info.max_length is not None:
        return f"{info.min_length} x {inner(info.item_type)}"
    if isinstance(info, msgspec.inspect.VarTupleType | msgspec.inspect.ListType):
        return f"list of {inner(info.item_type)}"
    if isinstance(info, msgspec.inspect.DictType):
        return f"object of {inner(info.value_type)}"
    if isinstance(info, msgspec.inspect.UnionType):
        return " or ".join(kind(member) for member in info.types)
    return info.cls.__name__


def inner(info: Any) -> str:
    """A type within another one as the page writes it."""
    return f"({kind(info)})" if isinstance(info, msgspec.inspect.UnionType) else kind(info)


def name_of(message: type) -> str:
    return message.__name__


def fields(message: type) -> tuple[msgspec.inspect.Field, ...]:
    info = msgspec.inspect.type_info(message)
    assert isinstance(info, msgspec.inspect.StructType | msgspec.inspect.DataclassType)
    return info.fields


def described(message: type) -> set[type]:
    """A message and the structures in it."""
    found = {message}
    for field in fields(message):
        parts = [field.type, *getattr(field.type, "types", ())]
        parts += [getattr(field.type, name) for name in ("value_type", "item_type") if hasattr(field.type, name)]
        found |= {part.cls for part in parts if hasattr(part, "cls")}
    return found


STRUCTURES: list[type] = sorted({part for message in MESSAGES for part in described(message)}, key=name_of)


def test_page_lists_the_topics() -> None:
    table = [[t.name, t.kind, *(m.__name__ if m else "" for m in (t.message, t.reply)), t.sender] for t in TOPICS]
    assert rows(section("Keys")) == table


@pytest.mark.parametrize(
    "message",
    STRUCTURES,
    ids=name_of,
)
def test_page_describes_every_field(message: type) -> None:
    expected = [[f.encode_name, kind(f.type) + ("" if f.required else " °")] for f in fields(message)]
    assert [row[:2] for row in rows(section(message.__name__))] == expected


def test_message_carries_the_schema() -> None:
    assert encode(COMMAND).startswith(b'{"schema":1,')
    assert Reader(Voltages)(encode(COMMAND)) == COMMAND


def test_unknown_fields_are_ignored() -> None:
    assert Reader(Voltages)(encode(COMMAND).replace(b"{", b'{"new": [1, {}], ', 1)) == COMMAND


@pytest.mark.parametrize(
    ("old", "new", "reason"),
    [
        (b'"schema":1,', b"", "invalid"),
        (b'"schema":1', b'"schema":2', "invalid"),
        (b'"schema":1', b'"schema":0', "invalid"),
        (b'"sequence":7,', b"", "invalid"),
        (b'"sequence":7', b'"sequence":"7"', "invalid"),
        (b'"sequence":7', b'"sequence":-7', "invalid"),
        (b'"sequence":7', b'"sequence":7.5', "invalid"),
        (b"-8.0", b"-8.0001", "invalid"),
        (b"-8.0", b"null", "invalid"),
        (b"-8.0", b"1e999", "invalid"),
        (b"-8.0", b"NaN", "malformed"),
        (b"-8.0,", b"", "invalid"),
        (b"true}", b"true", "malformed"),
        (b"true}", b'true, "deep": ' + 30_000 * b"[", "malformed"),
        (b"true}", b'true, "long": "' + SIZE_LIMIT * b"x" + b'"}', "too long"),
        (encode(COMMAND), b"", "malformed"),
        (encode(COMMAND), b"[]", "invalid"),
        (encode(COMMAND), b"\xff\xfe\x00", "malformed"),
    ],
)
def test_refusals(old: bytes, new: bytes, reason: str) -> None:
    payload = encode(COMMAND)
    assert old in payload
    with pytest.raises(MessageError) as refusal:
        Reader(Voltages)(payload.replace(old, new))
    assert refusal.value.reason == reason
    assert "\n" not in str(refusal.value)


def test_all_kinds_of_events_are_described_and_unknown_ones_are_passed_on() -> None:
    described = set(re.findall(r"`([a-z_ ]+)`", PAGE.partition("### Event\n")[2].partition("### Status\n")[0]))
    assert set(EventKind) <= described
    assert described - set(EventKind) <= {"time", "kind", "text", MONITOR, MONITOR + EventKind.STOP}
    newer = encode(Event(1.0, "of a newer peer", ""))
    assert encode(Reader(Event)(newer)) == newer
    assert encode(Event(1.0, EventKind.ROLL_BACK, "")) == encode(Event(1.0, "roll back", ""))


@pytest.mark.parametrize(
    ("message", "payload", "said"),
    [
        (SettingsRequest, b'{"schema":1,"gains":{"kp":[1,2,-3],"ki":[1,2,3],"kd":[1,2,3]}}', "kp3"),
        (SettingsRequest, b'{"schema":1,"gains":{"kp":[1,2,3]}}', "ki"),
        (SettingsRequest, b'{"schema":1,"model":{"mass":[0.1,0,0.1]}}', "m2"),
        (SettingsRequest, b'{"schema":1,"target_time":"2"}', "target_time"),
        (SettingsRequest, b'{"schema":1,"payload":0.2,"pole":9.0}', "unknown field `pole`"),
        (UploadRequest, b'{"schema":1,"who":"a","why":"b","based_on":1,"payload":0.2,"tuning":{}}', "field `tuning`"),
        (JointUploadRequest, b'{"schema":1,"who":"a","why":"b","based_on":1,"gains":{}}', "unknown field `gains`"),
        (SettingsRequest, b'{"schema":1,"model":{"masses":[1,1,1]}}', r"unknown field `masses` - at `\$.model`"),
        (UploadRequest, b'{"schema":1,"who":"a","why":"b","based_on":1,"model":{"mas":[1,1,1]}}', "field `mas` - at"),
        (JointUploadRequest, b'{"schema":1,"who":"a","why":"b","based_on":1,"tuning":{"polle":9}}', "`polle` - at"),
    ],
)
def test_settings_are_checked_where_they_arrive(message: type, payload: bytes, said: str) -> None:
    with pytest.raises(MessageError, match=said):
        Reader(message)(payload)


def test_settings_come_back_as_they_were() -> None:
    for request in (
        SettingsRequest(usual_gains("computed_torque", (1.0, 2.0, 3.0)), 1.5),
        SettingsRequest(model=ArmParameters()),
    ):
        assert Reader(SettingsRequest)(encode(request)) == request


@given(finite, finite, finite, volts, st.integers(0, 2**53), st.floats(0, 1e9))
def test_numbers_survive_exactly(a: float, b: float, c: float, v: float, sequence: int, time: float) -> None:
    sample = Sensors(sequence, time, (a, b, c), a, True, "red")
    command = Voltages(sequence, time, (v, v, v, v), False)
    assert Reader(Sensors)(encode(sample)) == sample
    assert Reader(Voltages)(encode(command)) == command


@given(st.sampled_from(MESSAGES), st.binary(max_size=200) | st.text(max_size=50).map(str.encode))
def test_any_bytes_are_a_message_or_refused(message: type, payload: bytes) -> None:
    with pytest.raises(MessageError):
        Reader(message)(payload)


json = st.recursive(
    st.none() | st.booleans() | st.integers() | finite | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=5), inner, max_size=4),
    max_leaves=10,
)


@given(st.data())
def test_any_json_is_a_message_or_refused(data: st.DataObject) -> None:
    message = data.draw(st.sampled_from(MESSAGES))
    names = [field.encode_name for field in fields(message)]
    content = data.draw(st.fixed_dictionaries({}, optional=dict.fromkeys([*names, "schema"], json | st.just(1))))
    try:
        found: object = Reader(message)(msgspec.json.encode(content))
    except MessageError:
        return
    assert isinstance(found, message)
