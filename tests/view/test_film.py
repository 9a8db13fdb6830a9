"""A log as a film: when its pictures are taken, where boxes are in them, and what the renderer makes of it."""

import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image, ImageSequence

from dtwin.cli import main
from dtwin.errors import ParameterError
from dtwin.parameters import PERIOD, PICKUP, PLACES, ROOT, JointVector
from dtwin.signals import Event
from dtwin.view.shown.film import Captions, encode_gif
from dtwin.view.shown.film_settings import FilmSettings
from tests.view.test_story import AWAY, work
from tests.view.test_write import MODEL

WIDTH, HEIGHT = 480, 270


@pytest.mark.parametrize(
    ("settings", "ticks"),
    [
        (FilmSettings(fps=25, start=0.0, end=0.2), [0, 4, 8, 12, 16, 20]),
        (FilmSettings(fps=10, speed=4.0, start=1.0, end=2.0), [100, 140, 180]),
        (FilmSettings(fps=1, start=-5.0, end=99.0), [0, 100, 200, 300]),
        (FilmSettings(fps=100, speed=0.5, start=0.0, end=0.02), [0, 0, 1, 1, 2]),
    ],
)
def test_pictures_show_the_rows_at_even_times(settings: FilmSettings, ticks: list[int]) -> None:
    assert settings.ticks(work().columns["t"]).tolist() == ticks


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        (lambda: FilmSettings(width=321), "width: expected an even number"),
        (lambda: FilmSettings(height=10), "height: expected an even number from 64"),
        (lambda: FilmSettings(fps=0), "fps: expected 1 to 100, got 0"),
        (lambda: FilmSettings(speed=0.0), "speed: expected 0.01 to 1000, got 0"),
        (lambda: FilmSettings(speed=float("nan")), "speed: expected 0.01 to 1000, got nan"),
    ],
)
def test_settings_out_of_range_are_refused(settings: Callable[[], FilmSettings], message: str) -> None:
    with pytest.raises(ParameterError, match=message):
        settings()


def test_a_film_of_nothing_or_too_much_is_refused() -> None:
    with pytest.raises(ParameterError, match=r"from 0 to 3\.49 s"):
        FilmSettings(start=2.0, end=1.0).ticks(work().columns["t"])
    with pytest.raises(ParameterError, match="at most"):
        FilmSettings(speed=0.01, fps=100).ticks(PERIOD * np.arange(1e5))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["film", "run.parquet", "film.avi"], "expected a film *.mp4 or *.gif"),
        (["film", "run.parquet", "film.gif", "--fps", "60"], "fps: expected at most 50 for a GIF, got 60"),
        (["film", "run.parquet", "film.gif", "--fps", "0"], "fps: expected 1 to 100, got 0"),
        (["film", "none.parquet", "film.gif"], "none.parquet: cannot be read"),
        (["film", "run.rrd", "film.gif"], "expected the log of `dtwin run --log`"),
        (["film", "run.parquet", "no/film.gif"], "no/film.gif: cannot be written"),
    ],
)
def test_what_cannot_be_filmed_is_said_and_leaves_nothing(
    arguments: list[str],
    message: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    work().write_parquet(tmp_path / "run.parquet")
    assert main(arguments) == 2
    assert message in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["run.parquet"]


def film(tmp_path: Path, file: str) -> Path:
    """Four pictures of `work`, a second apart from 0.6 s on, by a process that chooses its own OpenGL."""
    work().write_parquet(tmp_path / "run.parquet")
    options = ["--width", str(WIDTH), "--height", str(HEIGHT), "--fps", "2", "--speed", "1.8", "--no-caption"]
    command = [sys.executable, "-m", "dtwin", "film", str(tmp_path / "run.parquet"), str(tmp_path / file), *options]
    done = subprocess.run([*command, "--start", "0.6"], cwd=ROOT, capture_output=True, text=True, check=False)
    if "no OpenGL" in done.stderr:
        pytest.skip(done.stderr.strip())
    assert done.returncode == 0, done.stderr
    assert "4 pictures, 2.0 s" in done.stdout
    return tmp_path / file


def pixel(point: NDArray[np.float64], data: mujoco.MjData, model: mujoco.MjModel) -> tuple[int, int]:
    """Where a point (m) is in a picture of the camera overview: a pinhole of a given angle of view."""
    camera = model.camera("overview").id
    x, y, z = data.cam_xmat[camera].reshape(3, 3).T @ (point - data.cam_xpos[camera])
    focal = HEIGHT / 2 / np.tan(np.radians(model.cam_fovy[camera]) / 2)
    return round(WIDTH / 2 - focal * x / z), round(HEIGHT / 2 + focal * y / z)


def test_a_film_shows_arm_and_box_where_the_log_has_them(tmp_path: Path) -> None:
    model = mujoco.MjModel.from_xml_path(str(MODEL))
    data = mujoco.MjData(model)

    def elbow(theta: JointVector) -> tuple[int, int]:
        data.qpos[:3] = theta
        mujoco.mj_forward(model, data)
        return pixel(data.geom("link_2_hub_cap").xpos, data, model)

    with Image.open(film(tmp_path, "film.gif")) as opened:
        pictures = []
        for number in range(4):  # at 0.6, 1.5, 2.4 and 3.3 s
            opened.seek(number)
            pictures.append(np.asarray(opened.convert("RGB")).astype(int))
    assert pictures[0].shape == (HEIGHT, WIDTH, 3)

    def is_orange(number: int, at: tuple[int, int]) -> bool:
        red, green, blue = pictures[number][at[1], at[0]]
        return bool(red > 1.4 * green and green > 1.2 * blue)

    def is_green(number: int, at: tuple[int, int]) -> bool:
        red, green, blue = pictures[number][at[1], at[0]]
        return bool(green > 1.3 * red and green > 1.2 * blue)

    log = work()
    near, far = elbow(PICKUP.theta), elbow(AWAY)
    for number, tick in enumerate((60, 150, 240, 330)):
        first, second, third = log.stack("theta")[tick].tolist()
        assert is_orange(number, elbow((first, second, third))), number
    assert is_orange(0, near)
    assert not is_orange(0, far)
    assert is_orange(2, far)
    assert not is_orange(2, near)

    pickup, place = (pixel(np.array([p.x, -0.018, p.y]), data, model) for p in (PICKUP, PLACES["green"]))
    assert [is_green(number, pickup) for number in range(4)] == [True, False, False, False]
    # In the third picture the open gripper is in front of the box.
    assert [is_green(number, place) for number in (0, 1, 3)] == [False, False, True]


@pytest.mark.parametrize("fps", [7, 30, 50])
def test_a_gif_keeps_time(tmp_path: Path, fps: int) -> None:
    """Its pictures last whole hundredths of a second."""
    count = 2 * fps + 1
    pictures = (Image.new("RGB", (64, 64), (number % 200, 100, 255 - number % 100)) for number in range(count))
    encode_gif(tmp_path / "film.gif", pictures, FilmSettings(fps=fps), count)
    lasts = 0
    with Image.open(tmp_path / "film.gif") as opened:
        for frame in ImageSequence.Iterator(opened):
            assert frame.info["duration"] >= 20
            lasts += frame.info["duration"]
    assert lasts == pytest.approx(1000 * count / fps, abs=5)


def test_a_caption_tells_time_state_and_what_happened_in_one_line_each() -> None:
    events = (Event(1.0, "fault", "two\nlines"), Event(1.5, "stop", "safe stop: braking"))
    captions = Captions(replace(work(), events=events))
    heights = []
    for tick in (50, 120, 200):
        picture = Image.new("RGB", (400, 300), (0, 255, 0))
        captions.write(picture, tick)
        covered = (np.asarray(picture) != (0, 255, 0)).any(axis=(1, 2))
        heights.append(int(covered.sum()))
    assert heights == [15, 30, 45]


def test_an_mp4_has_as_many_pictures(tmp_path: Path) -> None:
    av = pytest.importorskip("av", reason="pip install 'dtwin[film]' to run this")
    with av.open(str(film(tmp_path, "film.mp4"))) as container:
        sizes = [(frame.width, frame.height) for frame in container.decode(video=0)]
    assert sizes == [(WIDTH, HEIGHT)] * 4
    assert sorted(path.name for path in tmp_path.iterdir()) == ["film.mp4", "run.parquet"]
