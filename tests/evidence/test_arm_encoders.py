"""The experiment with encoders that lie: one lie, from its moment to what came of it."""

from evidence.arm_encoders import MOMENTS, Trial, encoders_report, lied


def test_an_encoder_that_jumps_at_rest_with_a_box_is_told_and_moves_nothing() -> None:
    found = lied(Trial("planar-2r", 9, 3, MOMENTS[0], ("bias", 0.3), 1))
    assert found.safe
    assert found.told == 2
    assert found.stopped is not None
    assert found.stopped < 0.2
    assert found.speed < 0.05
    assert "In 1 of 1 runs" in encoders_report("planar-2r", [found]).text
