"""Traces of running devices, by their watches: the embedded device and a 4diac FORTE are seen alike."""

from __future__ import annotations

from pathlib import Path

import pytest

from dtwin.errors import FunctionBlockError
from iec61499.deploy.watched_trace import NEW, WatchedEvents, resource_blocks
from iec61499.device.managed_resource import WATCHES
from iec61499.library import Library
from iec61499.management.client import ManagementClient
from iec61499.model import FBNetwork
from iec61499.trace.ctf import TraceWriter, read_trace
from iec61499.trace.replay import replay
from tests.support.iec61499.served_device import DOUBLING, ServedDevice, build, wait_for

SIZE = 1_000_000


def records(folder: Path) -> list[tuple[int, str, dict[str, object]]]:
    """Time, name and fields of what is in a trace."""
    trace = read_trace(folder)
    found = []
    for number, time, *values in trace.records():
        kind = trace.kinds[number]
        found.append((time, kind.name, {field.name: v for field, v in zip(kind.fields, values, strict=True)}))
    return found


def test_events_are_recorded_with_their_number_and_data(either: ManagementClient, tmp_path: Path) -> None:
    build(either, "R", "N E_CTU PV=100\nM E_CTU PV=100")
    either.connect("R", "N.CUO", "M.CU")
    either.start("R")
    either.watch("R", "M.PV")
    writer = TraceWriter(tmp_path / "t", {"device": "it"}, SIZE)
    blocks = resource_blocks(either, "R", Library())
    watched = WatchedEvents(either, "R", blocks.only(("N", "M")), writer)
    assert blocks.unknown == ()
    assert watched.read(1) == 0
    for _ in range(3):
        either.trigger("R", "N.CU")
    wait_for(either, "R", "M.CV", lambda value: value == "3")
    assert watched.read(2) == 12
    either.trigger("R", "M.R")
    wait_for(either, "R", "M.CV", lambda value: value == "0")
    assert watched.read(3) == 2
    watched.close()
    writer.close()
    assert set(either.watched("R")) == {"M.PV"}
    found = records(tmp_path / "t")
    assert {(time, name): fields[NEW] for time, name, fields in found} == {
        **dict.fromkeys([(2, "N.CU"), (2, "N.CUO"), (2, "M.CU"), (2, "M.CUO")], 3),
        **dict.fromkeys([(3, "M.R"), (3, "M.RO")], 1),
    }
    counts = {(time, name): fields.get("CV") for time, name, fields in found}
    assert counts[2, "N.CUO"] == counts[2, "M.CUO"] == "3"
    assert counts[3, "M.RO"] == "0"
    with pytest.raises(FunctionBlockError, match="is one of a device's watches"):
        replay(read_trace(tmp_path / "t"), FBNetwork(), Library())


def test_states_of_charts_are_recorded_by_name(served: ServedDevice, tmp_path: Path) -> None:
    with served.client() as client:
        build(client, "R", DOUBLING)
        client.start("R")
        writer = TraceWriter(tmp_path / "t", {}, SIZE)
        watched = WatchedEvents(client, "R", resource_blocks(client, "R", served.library).only(("D",)), writer)
        assert client.read("R", "D.$ECC") == "0"
        with served.connect("S") as peer:
            peer.exchange([2.0])
        assert watched.read(7) == 2
        watched.close()
        writer.close()
    assert records(tmp_path / "t") == [
        (7, "D.REQ", {"new": 1, "X": "2.0", "ECC": "START"}),
        (7, "D.CNF", {"new": 1, "Y": "4.0", "ECC": "START"}),
    ]


def test_what_a_device_has_no_room_to_watch_is_named(served: ServedDevice, tmp_path: Path) -> None:
    names = [f"N{number}" for number in range(WATCHES // 6 + 1)]
    with served.client() as client:
        build(client, "R", "\n".join(f"{name} E_CTU" for name in names))
        client.start("R")
        blocks = resource_blocks(client, "R", Library()).only(names)
        with pytest.raises(FunctionBlockError, match="unknown block 'M': expected N0, N1"):
            blocks.only(["M"])
        watched = WatchedEvents(client, "R", blocks, TraceWriter(tmp_path / "t", {}, SIZE))
        assert len(client.watched("R")) == WATCHES
        assert set(watched.refused) <= {f"{name}.{port}" for name in names for port in ("Q", "CV", "PV", "$ECC")}
        assert watched.refused
        watched.close()
        assert client.watched("R") == {}
