"""All services of a cell whose places, colours and boxes are not the usual ones use those of its file."""

from collections.abc import Iterator

import pytest

from dtwin.api.live import connect
from dtwin.bus.messages import PREDICT
from dtwin.bus.twin_messages import Predicted, PredictionRequest
from dtwin.run.cell_file import cell_of
from tests.support.desk import Desk, new_desk
from tests.support.waiting import until

TASK = cell_of("four-colours").task


@pytest.fixture(scope="module")
def desk() -> Iterator[Desk]:
    with new_desk() as desk:
        files = ("--history", str(desk.folder / "history.jsonl"), "--store", str(desk.folder / "models"))
        services = ("--simulation", "--identification", "--monitoring", "--log", str(desk.folder / "run.parquet"))
        desk.detach("--pace", "lockstep", "--seed", "2", "--cell-file", "four-colours", *services, *files)
        yield desk


def test_a_prediction_is_of_the_motions_and_boxes_of_the_cell(desk: Desk) -> None:
    with connect() as cell:
        found = cell.bus.ask(PREDICT, PredictionRequest(), Predicted)
        known = cell.bus.ask(PREDICT, PredictionRequest(box=TASK.boxes.middle), Predicted)
        usual = cell.bus.ask(PREDICT, PredictionRequest(box=0.2), Predicted)
        assert cell.settings().payload == TASK.boxes.middle == 0.24
    goals = {motion.goal for motion in found.motions if motion.carries}
    assert goals == {"yellow", "red", "violet", "green"}
    assert found == known != usual


def test_boxes_arrive_at_the_places_of_the_cell(desk: Desk) -> None:
    def delivered() -> str:
        with connect() as cell:
            events = cell.summary().events
        return " ".join(event.text for event in events if event.kind == "delivered")

    said = until(delivered, "a box is delivered", 60.0)
    assert any(colour in said for colour in TASK.colours)
