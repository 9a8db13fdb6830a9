"""What has one number for each joint is refused with another number of them, at every door."""

from pathlib import Path
from typing import Any

import msgspec
import pytest

from dtwin.bus import messages as wire
from dtwin.bus.codec import MessageError, Reader, encode
from dtwin.bus.controller.messages import SettingsRequest
from dtwin.bus.twin_messages import UploadRequest
from dtwin.errors import DtwinError, ParameterError
from dtwin.lengths import in_full
from dtwin.parameters import JOINTS, CellJoints, Gains, JointVector, every_joint, joint_vector
from dtwin.run import cell_file
from dtwin.signals import Sensors, Voltages

GAINS = Gains(every_joint(1.0), every_joint(2.0), every_joint(3.0))
MESSAGES: list[tuple[msgspec.Struct, tuple[str, ...]]] = [
    (Sensors(1, 0.01, every_joint(0.1), 0.9, False, ""), ("theta",)),
    (Voltages(1, 0.01, (1.0,) * (JOINTS + 1), False), ("volts",)),
    (wire.Path(1, 0.01, every_joint(0.1)), ("theta",)),
    (SettingsRequest(GAINS, 2.0), ("gains", "kp")),
    (UploadRequest("anna", "to try", 1, encoder_offset=every_joint(0.01)), ("encoder_offset",)),
]


@pytest.mark.parametrize(("message", "place"), MESSAGES, ids=[type(message).__name__ for message, _ in MESSAGES])
def test_a_message_with_too_few_or_too_many_is_refused(message: msgspec.Struct, place: tuple[str, ...]) -> None:
    read = Reader(type(message))
    assert read(encode(message)) == message
    for change in (lambda values: values[:-1], lambda values: [*values, 0.0], lambda values: []):
        content: Any = msgspec.json.decode(encode(message))
        *inside, name = place
        holder = content
        for part in inside:
            holder = holder[part]
        holder[name] = change(holder[name])
        with pytest.raises(MessageError, match="length") as refused:
            read(msgspec.json.encode(content))
        assert ".".join(place) in str(refused.value)


def test_a_file_with_too_few_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "cell.toml"
    path.write_text("[pickup]\nx = 0.2\ny = -0.2\ntheta = [0.1, 0.2]\n")
    with pytest.raises(DtwinError, match=f"length >= {JOINTS}"):
        cell_file.load(path)


def test_gains_with_too_few_are_refused() -> None:
    with pytest.raises(ParameterError, match=f"kd: expected {JOINTS} values, one a joint, got 2"):
        Gains(every_joint(1.0), every_joint(1.0), (1.0, 1.0))


def test_options_and_arguments_read_as_many_words_as_there_are_joints() -> None:
    assert in_full(CellJoints) == tuple[(float,) * JOINTS]  # type: ignore[misc]  # made from the number
    assert in_full(JointVector) == JointVector
    assert in_full(float) is float


def test_the_numbers_of_an_array_are_plain() -> None:
    found = joint_vector(msgspec.json.decode(b"[1, 2.5, 3]"))
    assert found == (1.0, 2.5, 3.0)
    assert {type(value) for value in found} == {float}
