"""The drawing of the arm has the places and colours of the cell, also in what is looked back at."""

from collections.abc import Callable
from pathlib import Path

import msgspec
import pytest
from playwright.sync_api import Page

from dtwin.console.calculations.recall import recall
from dtwin.console.calculations.tasks import Recall
from dtwin.console.ring import COLUMNS, Ring
from dtwin.console.telling import Frame, spots
from dtwin.logs.collecting import RunLog
from dtwin.run.cell_file import cell_of
from dtwin.services.console import ConsoleOptions
from dtwin.signals import Sensors, StepRecord, Truth, Voltages
from dtwin.task import notes_of
from tests.support.console import serve
from tests.support.waiting import until

TASK = cell_of("four-colours").task
DRAWN = """async () => {
    const { drawArm } = await import("/static/js/arm.js");
    const { store } = await import("/static/js/store.js");
    const canvas = document.createElement("canvas");
    canvas.className = "arm";
    document.querySelector("main").append(canvas);
    const context = canvas.getContext("2d");
    const squares = [], texts = [], boxes = [], bars = [];
    context.strokeRect = (x, y, wide, high) => { squares.push([x + wide / 2, y + high / 2]); };
    context.fillRect = (x, y, wide, high) => { boxes.push([x + wide / 2, y + high / 2, context.fillStyle]); };
    context.fillText = (text) => { texts.push(text); };
    context.stroke = () => { bars.push(context.strokeStyle); };
    const frame = { theta: [0.1, 0.2, 0.3], gripper: 0.9, gripped: false, box: "violet" };
    drawArm(canvas, frame, store.live.state.places);
    const bounds = canvas.getBoundingClientRect();
    canvas.remove();
    return { squares, texts, boxes, bars, size: [bounds.width, bounds.height] };
}"""
KNOWN = "async () => Boolean((await import('/static/js/store.js')).store.live.state?.places.violet)"


@pytest.mark.parametrize("cell_file", ["four-colours", None])
def test_a_console_takes_the_places_from_the_file_of_its_cell(cell_file: str | None) -> None:
    names = ["pickup", "yellow", "red", "violet", "green"] if cell_file else ["pickup", "blue", "red", "green"]
    assert list(spots(ConsoleOptions(cell_file=cell_file).task())) == names


def test_places_are_told_with_their_colours() -> None:
    found = spots(TASK)
    assert (found["pickup"].x, found["pickup"].y, found["pickup"].rgb) == (0.18, -0.22, "")
    assert (found["violet"].x, found["violet"].y, found["violet"].rgb) == (0.13, 0.17, "#8e44c9")


def test_the_page_draws_every_place_where_it_is(tmp_path: Path, open_page: Callable[..., Page]) -> None:
    with serve(tmp_path, task=TASK) as served:
        page = open_page(served.web.address)
        served.live()
        until(lambda: page.evaluate(KNOWN), "the page knows the places")
        drawn = page.evaluate(DRAWN)
    places = spots(TASK)
    assert drawn["texts"][: len(places)] == list(places)
    wide, high = drawn["size"]
    (left, top), *others = drawn["squares"]
    pickup = places["pickup"]
    scales = []
    for (x, y), place in zip(others, list(places.values())[1:], strict=True):
        assert 0 < x < wide
        assert 0 < y < high
        scales.append((top - y) / (place.y - pickup.y))
        assert (x - left) == pytest.approx(scales[0] * (place.x - pickup.x), abs=1e-6)
    assert scales == pytest.approx([scales[0]] * 4)
    assert drawn["boxes"] == [[pytest.approx(left), pytest.approx(top), "#8e44c9"]]
    assert "violet box" in drawn["texts"]
    assert {place.rgb for place in places.values() if place.rgb} <= set(drawn["bars"])


def test_the_last_hour_keeps_the_colours_of_the_cell() -> None:
    ring = Ring(TASK.colours)
    ring.add(Frame(heard=1000.0, age=0.0, time=1.0, theta=(0.0, 0.0, 0.0), gripper=0.9, gripped=False, box="violet"))
    [row] = ring.rows(0.0, 2.0)
    assert ("", *ring.colours)[round(row[COLUMNS.index("box")])] == "violet"


def test_a_recording_is_shown_with_the_places_of_its_own_cell(tmp_path: Path) -> None:
    log = RunLog(notes_of(TASK))
    for tick in range(10):
        t = 0.01 * tick
        log.append(
            StepRecord(
                Truth(t, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0.9, 0.0),
                Sensors(tick, t, (0.0, 0.0, 0.0), 0.9, True, "yellow"),
                (0.0, 0.0, 0.0),
                Voltages(tick, t, (0.0, 0.0, 0.0, 0.0), False),
            )
        )
    log.freeze().write_parquet(tmp_path / "work.parquet")
    found = recall(tmp_path, Recall("work.parquet"))
    assert list(msgspec.to_builtins(found["state"])["places"]) == list(spots(TASK))
    assert found["colours"][round(found["rows"][-1][COLUMNS.index("box")])] == "yellow"
