"""Arrays of another program: one measurement, whatever their units, or a refusal that names the argument."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import dtwin
from dtwin.measurements.arrays import UNITS
from dtwin.measurements.columns import ANGLES, EFFORTS, TIME
from dtwin.measurements.reading import read_measurement
from tests.support.chains import motion_of
from tests.support.pages.blocks import blocks

T, Q, V, _ = motion_of(3, 3.0, 100.0, 5)
RIGHT: dict[str, Any] = {"t": T, "q": Q, "command": Q + 0.01, "velocity": V, "torque": 3.0 * V + Q}


@given(
    t=st.sampled_from(list(UNITS["t"])),
    q=st.sampled_from(list(UNITS["q"])),
    torque=st.sampled_from(list(UNITS["torque"])),
)
def test_units_change_nothing(t: str, q: str, torque: str) -> None:
    angle, effort = ANGLES[q], EFFORTS[torque][0]
    log = dtwin.from_arrays(
        T / TIME[t],
        Q / angle,
        (Q + 0.01) / angle,
        velocity=V / angle,
        torque=(3.0 * V + Q) / effort,
        names=("a", "b", "c"),
        units={"t": t, "q": q, "torque": torque},
    )
    assert log.joints == ("a", "b", "c")
    assert log.kind == "torque"
    assert log.v is not None
    assert log.effort is not None
    assert log.command is not None
    for got, expected in ((log.t, T), (log.q, Q), (log.v, V), (log.command, Q + 0.01), (log.effort, 3.0 * V + Q)):
        assert np.allclose(got, expected, rtol=1e-9, atol=1e-9)


def test_a_rate_stands_for_stamps_and_a_vector_for_one_joint() -> None:
    log = dtwin.from_arrays(100.0, Q[:, 0].tolist(), current=V[:, 0])
    assert np.allclose(log.t, T)
    assert log.joints == ("1",)
    assert log.kind == "current"
    assert log.q.shape == (len(T), 1)


def test_stamps_that_begin_again_are_episodes() -> None:
    rows = np.concatenate([np.arange(150)] * 2)
    log = dtwin.from_arrays(T[rows], Q[rows])
    assert log.starts == (0, 150)
    assert "begin again" in log.oddities[0].what


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"q": np.zeros((3, 2, 2))}, r"q: expected shape \(N, n\), got \(3, 2, 2\)"),
        ({"q": [["a"]]}, "q: expected numbers, got"),
        ({"t": T[:-1]}, r"t: expected shape \(300,\), one stamp for each row of q, got \(299,\)"),
        ({"t": 0.0}, "t: expected stamps, or rows a second above 0, got 0"),
        ({"command": Q[:, :2]}, r"command: expected shape \(300, 3\), as q has, got \(300, 2\)"),
        ({"velocity": V[:-1]}, r"velocity: expected shape \(300, 3\), as q has, got \(299, 3\)"),
        ({"current": V}, "torque, current: expected one of them"),
        ({"names": ("a", "b")}, "names: expected 3, one for each column of q, got 2"),
        ({"names": ("a", "b", "a")}, "joint 'a': expected it once"),
        ({"units": {"angle": "deg"}}, "units: expected t, q, command, velocity, torque or current, got 'angle'"),
        ({"units": {"q": "degrees"}}, "units: q: expected rad, deg, turn, m, mm or percent, got 'degrees'"),
        ({"units": {"torque": "A"}}, "units: torque: expected N m, mN m or N, got 'A'"),
        ({"velocity": np.degrees(V)}, r"column velocity.1 \[rad\], row 0: .*velocities are in degrees"),
        ({"t": 1e3 * T}, "a row every 10 s: is time_unit = 'ms' meant"),
        ({"torque": np.full_like(Q, np.nan)}, r"column torque.1 \[N m\], row 0: expected numbers, got none"),
    ],
)
def test_what_is_no_log_is_refused_by_name(change: dict[str, Any], message: str) -> None:
    given = RIGHT | change
    with pytest.raises(dtwin.DtwinError, match=message):
        dtwin.from_arrays(given.pop("t"), given.pop("q"), given.pop("command"), **given)


def test_the_python_of_the_page_writes_a_log(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (block,) = (b for b in blocks() if (b.page, b.language) == ("docs/real-logs.md", "python"))
    exec(compile(block.text, block.page, "exec"), {})
    found = read_measurement(Path("own.csv"))
    assert found.kind == "current"
    assert found.joints == ("lift", "turn")
    assert found.command is not None
    assert np.allclose(found.command - found.q, np.radians(0.1))
    assert re.match(r'"t \[s\]","position.lift \[rad\]"', Path("own.csv").read_text())
