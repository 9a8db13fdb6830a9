"""The thesis's experiments and the whole loop, each once."""

from __future__ import annotations

import re
from pathlib import Path

import msgspec
import numpy as np
import pytest

from dtwin.cli import main
from evidence.simulation.accuracy import NOISE, accuracy, identified
from evidence.simulation.upload import upload_run


def test_fits_of_an_identified_model() -> None:
    pairs = accuracy(identified(NOISE, seed=4))
    assert [pair.target_time for pair in pairs] == [1.0, 2.0, 4.0, 6.0, 8.0] * 2
    for pair in pairs:
        assert min(pair.fit) > 0.99
        assert pair.samples >= round(100 * pair.target_time) - 10
        settled = (pair.arm.figures.settling_time, pair.twin.figures.settling_time)
        assert pair.samples == round(100 * max(time or 0.0 for time in settled))


def test_accuracy_reports(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert (
        main(["experiment", "accuracy", "--runs", "2", "--workers", "1", "--out", str(tmp_path / "page"), "--json"])
        == 0
    )
    fits = msgspec.json.decode(capsys.readouterr().out)["fits"]
    assert list(fits) == ["1", "2", "4", "6", "8"]
    assert all(len(values) == 3 and min(values) >= 0.99 for values in fits.values())
    page = (tmp_path / "page" / "report.html").read_text()
    assert page.count("<svg") == 2
    assert len(re.findall(r"<td[^>]*>\d s</td>", page)) == 10


def test_uploads_help_and_interrupt_nothing(tmp_path: Path) -> None:
    run = upload_run(identified(NOISE, seed=0), tmp_path / "h.jsonl", seed=2, noise=0.002)
    np.testing.assert_allclose(np.diff(run.log.columns["t"]), 0.01, atol=1e-9)
    first, second, third = (max(phase.rms) for phase in run.phases)
    assert first > 1.0
    assert second < 0.1 * first
    assert third < 0.2 * second
    assert [phase.delivered > 0 for phase in run.phases] == [False, True, True]
    assert [entry.action for entry in run.entries] == ["start", "upload", "confirm", "upload", "confirm"]
    assert [entry.time for entry in run.entries[1::2]] == [60.0, 120.0]
    assert len(run.acknowledged) == 2
