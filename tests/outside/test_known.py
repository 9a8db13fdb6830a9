"""Healthy encoders that an effect coarsens: what their log shows keeps them from being taken for stopped ones."""

from tests.outside.known import Known, worked


def test_an_encoder_with_a_correction_table_is_known_by_its_log() -> None:
    """Believed to be as fine as the drawn one, it repeats a reading longer than that ever would, and is stopped."""
    known, found = worked(Known(96101, "correction table, 3 mrad"), learned=120.0)
    assert min(known.repeats) == 0 or min(known.repeats) > 100
    assert found.stopped == float("inf")
    assert found.delivered > 0
