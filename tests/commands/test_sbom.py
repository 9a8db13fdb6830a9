"""`dtwin sbom`: valid, complete, and the same for the same installation."""

import importlib.metadata
import json
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest

from dtwin.cli import main

pytestmark = pytest.mark.skipif(
    find_spec("cyclonedx") is None, reason="needs the extra sbom: scripts/test installs it"
)


@pytest.fixture(scope="module")
def bill(tmp_path_factory: pytest.TempPathFactory) -> str:
    path = tmp_path_factory.mktemp("sbom") / "dtwin.cdx.json"
    assert main(["sbom", str(path)]) == 0
    return path.read_text()


@pytest.fixture(scope="module")
def content(bill: str) -> dict[str, Any]:
    found: dict[str, Any] = json.loads(bill)
    return found


def test_the_bill_follows_the_schema(bill: str) -> None:
    from cyclonedx.schema import SchemaVersion
    from cyclonedx.validation.json import JsonStrictValidator  # takes seconds, of every process that collects

    validator = JsonStrictValidator(SchemaVersion.V1_6)
    assert validator.validate_str(bill) is None
    assert validator.validate_str(bill.replace('"type": "library"', '"type": "shelf"', 1)) is not None


def test_it_lists_what_is_installed_with_versions_and_licences(content: dict[str, Any]) -> None:
    assert content["metadata"]["component"]["name"] == "dtwin"
    listed = {each["name"]: each for each in content["components"]}
    for name in ("numpy", "mujoco", "lxml", "eclipse-zenoh", "llvmlite"):
        assert listed[name]["version"] == importlib.metadata.version(name)
        assert listed[name]["purl"] == f"pkg:pypi/{name}@{listed[name]['version']}"
    said = {
        licence.get("expression") or licence["license"].get("id") or licence["license"]["name"]
        for licence in listed["scipy"]["licenses"] + listed["mujoco"]["licenses"]
    }
    assert any("BSD" in each for each in said)
    assert any("Apache" in each for each in said)
    nameless = [name for name, each in listed.items() if not each.get("licenses")]
    assert nameless == []
    assert "playwright" not in listed


def test_it_tells_who_needs_whom(content: dict[str, Any]) -> None:
    needs = {each["ref"]: set(each.get("dependsOn", ())) for each in content["dependencies"]}
    places = {each["name"]: each["bom-ref"] for each in [content["metadata"]["component"], *content["components"]]}
    assert set(needs) == set(places.values())
    assert places["numba"] in needs[places["dtwin"]]
    assert places["llvmlite"] in needs[places["numba"]]
    # Everything that is listed is needed, by way of others, by dtwin.
    reached, waiting = set(), [places["dtwin"]]
    while waiting:
        reached.add(place := waiting.pop())
        waiting += needs[place] - reached
    assert reached == set(needs)


def test_equal_installations_give_equal_bytes(bill: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["sbom"]) == 0
    assert capsys.readouterr().out == bill


def test_an_extra_adds_what_it_brings(tmp_path: Path) -> None:
    path = tmp_path / "console.cdx.json"
    assert main(["sbom", "--extra", "console", str(path)]) == 0
    assert "starlette" in {each["name"] for each in json.loads(path.read_text())["components"]}


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (["--extra", "nothing"], "--extra: expected console, "),
        (["missing/folder/x.json"], "missing/folder/x.json"),
    ],
)
def test_what_is_wrong_is_told_in_a_line(
    words: list[str], complaint: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["sbom", *words]) == 2
    assert complaint in capsys.readouterr().err


def test_something_that_is_missing_is_named(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    real = importlib.metadata.distribution

    def without(name: str) -> importlib.metadata.Distribution:
        if name == "numba":
            raise importlib.metadata.PackageNotFoundError(name)
        return real(name)

    monkeypatch.setattr(importlib.metadata, "distribution", without)
    assert main(["sbom"]) == 2
    assert "numba, which dtwin needs: expected it to be installed" in capsys.readouterr().err
