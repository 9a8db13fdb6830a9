"""A device that does not list the blocks of applications, as 4diac FORTE 2 does not."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import pytest

from iec61499.deploy.build import deploy
from iec61499.deploy.difference import change, difference
from iec61499.deploy.listing import NOTE, SHORT_PIECE, Listing, listed, write_note
from iec61499.deploy.plan import Deployment, plan_deployment
from iec61499.management.client import ManagementClient, Step
from iec61499.management.protocol import (
    ManagedBlock,
    ManagedConnection,
    ManagementError,
    RequestAction,
    Response,
    Subject,
)
from tests.support.iec61499.networks import network
from tests.support.iec61499.served_device import ServedDevice


class OldClient(ManagementClient):
    """A session with a device that answers as FORTE 2 does: it hides names with dots, and prints 15 digits."""

    def request(self, resource: str, action: RequestAction, subject: Subject | None = None) -> Response:
        return self._old(super().request(resource, action, subject))

    def request_all(self, steps: Sequence[Step]) -> list[Response]:
        return [self._old(response) for response in super().request_all(steps)]

    @staticmethod
    def _old(response: Response) -> Response:
        blocks, links, value = response.blocks, response.connections, response.value
        if value is not None and value.count(".") == 1 and value.replace(".", "").isdecimal():
            value = f"{float(value):.15g}"
        return Response(
            response.id,
            response.reason,
            value,
            None if blocks is None else tuple(b for b in blocks if "." not in b.name),
            None if links is None else tuple(ManagedConnection(_last(w.source), _last(w.destination)) for w in links),
            response.names,
            response.watches,
            response.interface,
        )


def _last(end: str) -> str:
    return ".".join(end.split(".")[-2:])


def plan(served: ServedDevice, extra: str = "", pv: str = "3") -> Deployment:
    drawn = network(
        f"START: E_RESTART; CYCLE: E_CYCLE; APP.N: E_CTU; APP.S: F_MUL{extra}",
        "START.COLD -> CYCLE.START; CYCLE.EO -> APP.N.CU; APP.N.CUO -> APP.S.REQ",
        parameters={"CYCLE.DT": "T#1s", "APP.N.PV": pv, "APP.S.IN1": "LREAL#0.23533333333333334"},
    )
    return plan_deployment("R", drawn, served.library)


@pytest.fixture
def client(served: ServedDevice) -> Iterator[OldClient]:
    with OldClient(served.management.address) as session:
        yield session


def test_nothing_differs_after_a_deployment(served: ServedDevice, client: OldClient) -> None:
    before, after = plan(served), plan(served, "; APP.M: E_CTU", "4")
    deploy(client, before)
    assert [block.name for block in client.blocks("R") if "." in block.name] == []
    assert difference(client, before).lines() == []
    assert sorted(difference(client, after).lines()) == ["+ APP.M: E_CTU", "~ APP.N.PV is 3, shall be 4"]
    change(client, after)
    assert difference(client, after).lines() == []
    assert change(client, before).lines() == ["- APP.M: E_CTU", "~ APP.N.PV is 4, shall be 3"]


def test_the_note_is_cut_into_pieces(served: ServedDevice, client: OldClient) -> None:
    blocks = tuple((f"APP.{number:x}{number * 2654435761 % 2**64:x}", "E_CTU") for number in range(300))
    client.create_block("", "R", "EMB_RES")
    client.start("R")
    for short, least in ((True, 3), (False, 1)):
        write_note(client, "R", Listing(blocks, (("START.COLD", f"{blocks[0][0]}.CU"),)), short)
        notes = [block.name for block in client.blocks("R") if block.name.startswith(NOTE)]
        assert len(notes) >= least
        assert all(len(client.read("R", f"{name}.ID")) <= SHORT_PIECE for name in notes) or not short
        assert listed(client, "R").blocks == blocks


def test_a_note_that_is_none_is_refused(served: ServedDevice, client: OldClient) -> None:
    client.create_block("", "R", "EMB_RES")
    client.create_block("R", f"{NOTE}1", "PUBLISH_0")
    client.write("R", f"{NOTE}1.ID", '"bm8="')
    with pytest.raises(ManagementError, match="a note of what was deployed that cannot be read"):
        listed(client, "R")
    client.demand("R", "DELETE", ManagedBlock(f"{NOTE}1", ""))


def test_names_with_the_resource_in_front(
    served: ServedDevice, client: OldClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A FORTE 3 writes so."""
    with ManagementClient(served.management.address) as plain:
        deploy(plain, plan(served))
        demanded = ManagementClient.demand

        def demand(self: ManagementClient, *step: Any) -> Response:
            response = demanded(self, *step)
            links = response.connections
            if links is None:
                return response
            ends = tuple(ManagedConnection(f"R.{w.source}", f"R.{w.destination}") for w in links)
            return Response(response.id, connections=ends)

        monkeypatch.setattr(ManagementClient, "demand", demand)
        assert difference(plain, plan(served)).lines() == []
