"""A log as a film: pictures at even times, with what the controller is at and what happened, as MP4 or GIF."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from dtwin.emulation.picture import DrawnBox, Studio
from dtwin.errors import DtwinError, ParameterError, RecordingError
from dtwin.files import replacing
from dtwin.logs.log import Log
from dtwin.parameters import ArmParameters, joint_vector
from dtwin.signals import NO_COLOUR
from dtwin.task import Task, task_of
from dtwin.twin.kinematics import forward
from dtwin.view.boxes import grasps, placements, waiting
from dtwin.view.shown.film_settings import FilmSettings
from dtwin.view.story import Story, marks

KINDS: Final = (".mp4", ".gif")
_FASTEST_GIF: Final = 50
"""Pictures a second that viewers of a GIF show without slowing them down."""
_SHOWN: Final = 4.0
"""Time for which a moment that is worth a look is told, plant time, s."""
DARK, _RED, _WHITE = (40, 45, 52), (190, 30, 30), (255, 255, 255)
_QUALITY: Final = {"crf": "21", "preset": "medium", "threads": "1"}
"""One thread, so that equal films are equal byte by byte."""


def write_film(
    log: Log,
    model_file: Path,
    path: Path,
    arm: ArmParameters,
    settings: FilmSettings,
    progress: Callable[[int, int], None] = lambda done, of: None,
) -> int:
    """Renders a log to a film; the file appears complete or not at all. Equal logs give equal pictures.

    Args:
        log: the run, of at least one tick.
        model_file: MJCF of the cell.
        path: file to write, *.mp4 or *.gif.
        arm: arm of the run, whose link lengths are drawn.
        settings: how the film is made.
        progress: told the pictures done and their number.

    Returns:
        The number of pictures.

    Raises:
        ParameterError: a setting does not fit the log or the model, or the name of the file says no kind of film.
        RecordingError: the log is empty, or the path cannot be written.
        DtwinError: there is no OpenGL here, or no encoder.
    """
    check_kind(path, settings)
    if not len(log):
        raise RecordingError(f"{path}: expected a log of at least one tick to draw")
    ticks = settings.ticks(log.columns["t"])
    encode(path, _pictures(log, model_file, arm, settings, ticks, progress), settings, len(ticks))
    return len(ticks)


def check_kind(path: Path, settings: FilmSettings) -> None:
    """Checks that the name of a file says a kind of film that can be made so.

    Raises:
        ParameterError: it does not.
    """
    kind = path.suffix.lower()
    if kind not in KINDS:
        raise ParameterError(f"{path}: expected a film *{' or *'.join(KINDS)}")
    if kind == ".gif" and settings.fps > _FASTEST_GIF:
        raise ParameterError(f"fps: expected at most {_FASTEST_GIF} for a GIF, got {settings.fps}")


def encode(path: Path, pictures: Iterator[Image.Image], settings: FilmSettings, count: int) -> None:
    """Writes pictures, of which the number is known, to a film that appears complete or not at all."""
    write = _encode_mp4 if path.suffix.lower() == ".mp4" else encode_gif
    with replacing(path) as temporary:
        write(temporary, pictures, settings, count)


def _pictures(
    log: Log,
    model_file: Path,
    arm: ArmParameters,
    settings: FilmSettings,
    ticks: NDArray[np.int64],
    progress: Callable[[int, int], None],
) -> Iterator[Image.Image]:
    task = task_of(log.metadata)
    theta, gripper = log.angles(), log.columns["gripper"]
    boxes = _Boxes(log, task, arm)
    captions = Captions(log)
    with Studio(model_file, task, arm, settings.width, settings.height, settings.camera) as studio:
        for done, tick in enumerate(ticks.tolist()):
            pixels = studio.picture(theta[tick].tolist(), float(gripper[tick]), boxes.at(tick))
            picture = Image.fromarray(pixels)
            if settings.caption:
                captions.write(picture, tick)
            yield picture
            progress(done + 1, len(ticks))


class _Boxes:
    """The boxes at any tick of a log."""

    def __init__(self, log: Log, task: Task, arm: ArmParameters) -> None:
        self._task = task
        self._waiting, self._grasps = waiting(log), grasps(log)
        theta = log.angles()
        ends = [forward(joint_vector(theta[grasp.end]), arm) for grasp in self._grasps if grasp.end is not None]
        released = np.array([(x, 0.0, z) for x, z, _ in ends]).reshape(-1, 3)
        self._placed = placements(self._grasps, released, task.places)

    def at(self, tick: int) -> list[DrawnBox]:
        """Those that wait, are held, or lie where they were let go; of those at one place the last."""
        task = self._task
        colour = [change.colour for change in self._waiting if change.tick <= tick][-1]
        found = [DrawnBox(task.rgb(colour), (task.pickup.x, 0.0, task.pickup.y))] if colour != NO_COLOUR else []
        found += [
            DrawnBox(task.rgb(grasp.colour))
            for grasp in self._grasps
            if grasp.start <= tick and (grasp.end is None or tick < grasp.end)
        ]
        lying = {}
        for number, box in enumerate(self._placed):
            if box.tick <= tick:
                x, y, z = box.position.tolist()
                lying[box.place or f"beside {number}"] = DrawnBox(task.rgb(box.colour), (x, y, z))
        return [*found, *lying.values()]


def write_lines(picture: Image.Image, lines: Sequence[tuple[str, tuple[int, int, int]]]) -> None:
    """Writes lines into the lower edge of a picture, white on a band of their colour."""
    size = max(picture.height // 30, 10)
    font = ImageFont.load_default(size)
    draw = ImageDraw.Draw(picture)
    step = size * 3 // 2
    for number, (text, colour) in enumerate(reversed(lines), 1):
        top = picture.height - number * step
        text = " ".join(text.split())
        wide = draw.textlength(text, font) + size
        draw.rectangle((0, top, wide, top + step), fill=colour)
        draw.text((size // 2, top + size // 5), text, _WHITE, font)


class Captions:
    """Writes plant time, the controller's state and what happened into pictures of a log."""

    def __init__(self, log: Log) -> None:
        self._t = log.columns["t"]
        self._changes = Story().changes(log)
        self._marks = marks(log.events)

    def write(self, picture: Image.Image, tick: int) -> None:
        """Writes into the picture of a tick, at its lower edge; a stop and a moment worth a look stand in a band."""
        t = float(self._t[tick])
        _, state, stop = [change for change in self._changes if change[0] <= tick][-1]
        recent = [mark for mark in self._marks if mark.time <= t < mark.time + _SHOWN]
        lines = [(f"{t:.2f} s, {state}", DARK)]
        if stop:
            lines.append((f"STOPPED: {stop}", _RED))
        lines += [(f"{mark.kind}: {mark.text}", _RED) for mark in recent if mark.text != stop]
        write_lines(picture, lines)


def _encode_mp4(path: Path, pictures: Iterator[Image.Image], settings: FilmSettings, count: int) -> None:
    try:
        import av  # the extra film
    except ImportError:
        raise DtwinError("an MP4 needs the extra film: pip install 'dtwin[film]'; a GIF does without") from None
    with av.open(str(path), "w", format="mp4") as container:
        stream = container.add_stream("libx264", rate=settings.fps, options=_QUALITY)
        stream.width, stream.height, stream.pix_fmt = settings.width, settings.height, "yuv420p"
        for picture in pictures:
            container.mux(stream.encode(av.VideoFrame.from_image(picture)))
        container.mux(stream.encode())


def encode_gif(path: Path, pictures: Iterator[Image.Image], settings: FilmSettings, count: int) -> None:
    """Writes some pictures, of which the number is known, to a GIF."""
    # It counts hundredths of a second: pictures last longer and shorter in turn, so that it keeps time.
    shown = (10 * np.diff(np.round(100.0 / settings.fps * np.arange(count + 1))).astype(int)).tolist()
    first = next(pictures).quantize(256)
    rest = (picture.quantize(palette=first, dither=Image.Dither.NONE) for picture in pictures)
    first.save(path, format="GIF", save_all=True, append_images=rest, duration=shown, loop=0)
