"""The store of identified models: every revision is kept, and what is missing is named."""

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from dtwin.errors import ModelError
from dtwin.identification.estimation.estimate import Estimate
from dtwin.identification.model import IdentifiedModel, read_model
from dtwin.identification.result import from_estimate
from dtwin.identification.store import ModelStore, open_model
from tests.support.arms import Array


def test_the_store_keeps_every_revision(
    estimate: Estimate, fit: Array, model: IdentifiedModel, tmp_path: Path
) -> None:
    store = ModelStore(tmp_path / "kept")
    assert store.names() == []
    other = from_estimate(estimate, fit, "another")
    entries = [store.save(each, "arm") for each in (model, other, model)]
    store.save(model, "left-arm")
    assert [str(entry) for entry in entries] == ["arm@1", "arm@2", "arm@3"]
    assert store.names() == ["arm", "left-arm"]
    assert store.load("arm") == model
    assert store.load("arm@2") == other
    assert open_model(str(entries[1].path), store) == other
    assert sorted(path.name for path in (tmp_path / "kept" / "arm").iterdir()) == [f"000{k}.json" for k in (1, 2, 3)]


def test_savers_at_once_get_a_revision_each(model: IdentifiedModel, tmp_path: Path) -> None:
    store = ModelStore(tmp_path)
    with ThreadPoolExecutor(8) as pool:
        entries = list(pool.map(lambda _: store.save(model, "arm"), range(24)))
    assert sorted(entry.revision for entry in entries) == list(range(1, 25))
    assert all(read_model(entry.path) == model for entry in entries)


def test_the_store_names_what_there_is(model: IdentifiedModel, tmp_path: Path) -> None:
    store = ModelStore(tmp_path)
    with pytest.raises(ModelError, match=r"no model 'arm' in .*: it is empty; dtwin identify --save NAME stores one"):
        store.load("arm")
    store.save(model, "arm")
    with pytest.raises(ModelError, match=r"no model 'leg' in .*: expected arm"):
        store.load("leg")
    with pytest.raises(ModelError, match=r"no revision '7' of model arm: expected 1"):
        store.load("arm@7")
    for name in ("", "../arm", ".hidden", "a/b", "a b"):
        with pytest.raises(ModelError, match=r"model name .*: expected letters"):
            store.save(model, name)
        with pytest.raises(ModelError, match=r"no model"):
            store.find(name)


def test_a_store_that_cannot_be_written_is_named(model: IdentifiedModel, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(ModelError, match=r"file/arm: cannot be written: Not a directory"):
        ModelStore(tmp_path / "file").save(model, "arm")
