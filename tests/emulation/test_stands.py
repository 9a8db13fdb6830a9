"""The stands of a cell where its task has them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from dtwin.emulation import MODEL_FILE
from dtwin.emulation.stands import check_task, drawn_model
from dtwin.errors import ModelError, ParameterError
from dtwin.parameters import Place
from dtwin.run.cell_file import cell_of
from dtwin.task import DEFAULT_TASK, BoxStream, Destination, Task

FOUR = cell_of("four-colours").task


def placed(model: mujoco.MjModel) -> dict[str, tuple[list[float], list[float]]]:
    """Position and size of every geom (m)."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    return {
        model.geom(i).name: (data.geom_xpos[i].round(6).tolist(), model.geom(i).size.round(6).tolist())
        for i in range(model.ngeom)
    }


def test_the_stands_of_the_usual_task_are_those_of_the_file() -> None:
    found, expected = (
        placed(drawn_model(MODEL_FILE, DEFAULT_TASK)),
        placed(mujoco.MjModel.from_xml_path(str(MODEL_FILE))),
    )
    assert found.keys() == expected.keys()
    assert {name for name in found if found[name] != expected[name]} == {
        f"stand_{colour}_bracket" for colour in DEFAULT_TASK.colours
    }


def test_every_colour_has_its_tray_under_its_boxes() -> None:
    model = drawn_model(MODEL_FILE, FOUR)
    shapes, half = placed(model), FOUR.boxes.size / 2
    assert {name for name in shapes if name.endswith("_tray")} == {f"{colour}_tray" for colour in FOUR.colours}
    for colour, place in FOUR.places.items():
        (x, _, z), size = shapes[f"{colour}_tray"]
        assert x == pytest.approx(place.x)
        assert z + size[2] == pytest.approx(place.y - half - 0.0025)  # a gap of 2.5 mm under a box that is brought
        (bracket, _, _), (width, _, _) = shapes[f"stand_{colour}_bracket"]
        assert bracket - width <= min(x, 0.15) - 0.011
        assert bracket + width >= max(x, 0.15) + 0.011
        rgb = np.array(FOUR.rgb(colour)) / 255
        np.testing.assert_allclose(model.mat_rgba[model.mat(f"tray_{colour}").id][:3], rgb, atol=1e-6)
    belt, size = shapes["conveyor_belt"]
    assert belt[2] + size[2] == pytest.approx(FOUR.pickup.y - half, abs=1e-5)
    assert shapes["box_held"][1] == shapes["box_waiting"][1] == [half] * 3
    floor = shapes["conveyor_leg_1"]
    assert floor[0][2] - floor[1][2] == pytest.approx(-0.55)


def test_the_arm_may_not_touch_what_is_at_a_place() -> None:
    for task in (FOUR, replace(DEFAULT_TASK, boxes=BoxStream(lightest=0.1))):
        check_task(task, MODEL_FILE, contact=False)
    near = Destination("orange", Place(0.15, 0.16, (2.475, -2.004, -0.471)))
    with pytest.raises(ParameterError, match=r"(red|orange): the arm at .* mm into .*_(tray|red|orange)"):
        check_task(Task(DEFAULT_TASK.pickup, (*DEFAULT_TASK.destinations, near)), MODEL_FILE, contact=False)


def test_the_arm_may_not_touch_itself(tmp_path: Path) -> None:
    """The links of models/arm.xml pass one another; those of this file lie in one plane."""
    text, beam = MODEL_FILE.read_text(), 'type="box" pos="0.079 0.078 0"'
    assert beam in text
    flat = tmp_path / "flat.xml"
    flat.write_text(text.replace(beam, 'type="box" pos="0.079 0 0"'))
    with pytest.raises(ParameterError, match=r"blue: the arm at .* would have its \w+ .* mm into \w+"):
        check_task(replace(DEFAULT_TASK, boxes=BoxStream(lightest=0.1)), flat, contact=False)


def test_a_file_without_stands_is_refused(tmp_path: Path) -> None:
    text = MODEL_FILE.read_text()
    start, end = text.index('<body name="rack"'), text.index('<body name="blue_belt"')
    bare = tmp_path / "bare.xml"
    bare.write_text(text[:start] + text[end:])
    with pytest.raises(ModelError, match=r"bare\.xml: no body is named 'rack'"):
        drawn_model(bare, FOUR)
