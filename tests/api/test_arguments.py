"""What the public functions are given is checked at the door: by name, value and what was expected."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import dtwin
from dtwin.api.arguments import checked


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"noise": "much"}, "noise: expected a number or None, got 'much'"),
        ({"noise": True}, "noise: expected a number or None, got True"),
        ({"seed": 1.5}, "seed: expected a whole number, got 1.5"),
        ({"noise_kind": "pink"}, "noise_kind: expected none, uniform or gaussian or None, got 'pink'"),
        ({"law": "magic"}, "law: expected computed_torque, row_sum or cascade or None, got 'magic'"),
        ({"gains": 3}, "gains: expected Gains or None, got 3"),
        ({"friction": [0.1, 0.2]}, "friction: expected 3 numbers or None, got [0.1, 0.2]"),
        ({"fault": [1]}, "fault: expected a text or a sequence of a text, got [1]"),
        ({"colour": 1}, "unknown argument 'colour': expected cell_file, machine, set, "),
        ({"set": {"m9": 0.1}}, "unknown parameter 'm9': expected K1, K2, "),
        ({"set": {"m1": "heavy"}}, "set: expected a text, a sequence of a text or a mapping of names and numbers"),
        ({"fault": "K9*=0.1@4"}, "K9"),
        ({"machine": "none"}, "machine 'none': expected a file (*.toml, *.json), a number, or ideal, "),
        ({"gains": dtwin.usual_gains("computed_torque", kp=(1e9, 1.0, 1.0))}, "kp1: expected"),
        ({"gains": dtwin.usual_gains("computed_torque"), "tuned": "arm.json"}, "arm.json"),
    ],
)
def test_a_bad_argument_of_a_cell_is_named(given: dict[str, Any], said: str) -> None:
    with pytest.raises(dtwin.DtwinError) as refused:
        dtwin.Cell(**given)
    assert said in str(refused.value)


@pytest.mark.parametrize(
    ("function", "given", "said"),
    [
        (dtwin.Cell().run, {"seconds": "long"}, "seconds: expected a number, got 'long'"),
        (dtwin.Cell().run, {"seconds": -1}, "duration: expected at least one period"),
        (dtwin.Cell(seed=-1).run, {"seconds": 1}, "seed: expected a whole number from 0"),
        (dtwin.Cell(noise=-1).run, {"seconds": 1}, "noise: expected a finite magnitude"),
        (dtwin.load, {"path": "nowhere.parquet"}, "nowhere.parquet: cannot be read"),
        (dtwin.identify, {"data": 3}, "data: expected Run, a path or a text, got 3"),
        (dtwin.identify, {"data": "a.parquet", "loss": "none"}, "loss: expected adaptive, gaussian or huber"),
        (dtwin.monitor, {"data": "a.parquet", "method": "x"}, "unknown argument 'method': expected data, model, "),
        (dtwin.simulate, {"goal": "moon"}, "moon"),
        (dtwin.optimise, {"candidates": 0}, "candidates"),
        (dtwin.optimise, {"box": (1, 2, 3)}, "box: expected 2 numbers or None, got (1, 2, 3)"),
    ],
)
def test_a_bad_argument_of_a_function_is_named(
    function: Callable[..., Any], given: dict[str, Any], said: str
) -> None:
    with pytest.raises(dtwin.DtwinError) as refused:
        function(**given)
    assert said in str(refused.value)


def test_what_numpy_and_texts_say_is_converted() -> None:
    @checked
    def given(number: float, count: int, path: Path, three: tuple[float, float, float]) -> tuple[Any, ...]:
        return number, count, path, three

    loose: Callable[..., tuple[Any, ...]] = given
    found = loose(np.float64(1), np.int64(2), "a/b", np.array([1, 2, 3]))
    assert found == (1.0, 2, Path("a/b"), (1.0, 2.0, 3.0))
    assert [type(each) for each in found[:2]] == [float, int]


def test_there_are_no_other_names() -> None:
    assert set(dtwin.__all__) <= set(dir(dtwin))
    with pytest.raises(AttributeError, match="no attribute 'Robot'"):
        _ = dtwin.Robot
