"""What an upload asks for: values, and what files hold."""

import json
from pathlib import Path
from typing import Any, cast

import pytest

from dtwin.api.live import LiveCell
from dtwin.bus.session import Bus
from dtwin.bus.twin_messages import Upload, UploadRequest
from dtwin.controller.settings import usual_gains
from dtwin.errors import ModelError, ParameterError
from dtwin.parameters import ArmParameters

GAINS, ARM = usual_gains("computed_torque"), ArmParameters()
NOW = Upload(7, 0.0, "start", "", False, GAINS, 2.0, "computed_torque", ARM)


class Asked:
    """A bus that keeps what was asked for and answers with the settings in force."""

    def __init__(self) -> None:
        self.requests: list[UploadRequest] = []

    def ask(self, topic: Any, request: UploadRequest | None, kind: Any) -> Upload:
        if request is not None:
            self.requests.append(request)
        return NOW


def asked(**changes: Any) -> UploadRequest:
    """The request of an upload."""
    bus = Asked()
    LiveCell(cast(Bus, bus)).upload(**changes, why="a test", who="ada")
    (request,) = bus.requests
    assert (request.who, request.why) == ("ada", "a test")
    return request


def test_gains_that_are_not_given_stay() -> None:
    request = asked(kp=(1.0, 2.0, 3.0))
    assert (request.based_on, request.target_time, request.model) == (7, None, None)
    assert request.gains is not None
    assert (request.gains.kp, request.gains.ki, request.gains.kd) == ((1.0, 2.0, 3.0), GAINS.ki, GAINS.kd)


def test_gains_of_a_file_bring_their_target_time_unless_another_is_given(tmp_path: Path) -> None:
    file = tmp_path / "best.json"
    file.write_text(json.dumps({"target_time": 1.5, "gains": {"kp": [4, 5, 6], "ki": [1, 1, 1], "kd": [2, 2, 2]}}))
    request = asked(gains=file, kd=(3, 3, 3))
    assert request.gains is not None
    assert (request.gains.kp, request.gains.kd, request.target_time) == ((4.0, 5.0, 6.0), (3.0, 3.0, 3.0), 1.5)
    assert asked(gains=str(file), target_time=2.5).target_time == 2.5
    assert (request.law, asked(gains=str(file), law="row_sum").law) == (None, "row_sum")
    file.write_text(file.read_text().replace("{", '{"law": "cascade", ', 1))
    assert asked(gains=file).law == "cascade"
    file.write_text("{}")
    with pytest.raises(ModelError, match=r"best\.json: expected gains as dtwin optimise saves them"):
        asked(gains=file)


def test_values_of_a_model_that_are_not_given_are_those_in_force() -> None:
    assert asked(set={"m1": 0.12}, based_on=3).model == ARM.with_values({"m1": 0.12})
    assert asked(set="m1=0.12").based_on == 7
    other = ARM.with_values({"K2": 0.3})
    assert asked(model=other, set=("m1=0.12",)).model == other.with_values({"m1": 0.12})
    assert asked(version=4, arm=other) == UploadRequest("ada", "a test", 7, version=4, arm=other)


def test_what_changes_nothing_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ParameterError, match="expected gains, target_time or model, or a version"):
        asked(arm=ARM)
    with pytest.raises(ModelError, match="no model"):
        asked(model="nobody", store=tmp_path)
