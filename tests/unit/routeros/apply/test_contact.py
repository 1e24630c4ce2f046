"""Sessions that cannot be opened, and answers that lack something."""

from __future__ import annotations

import asyncio
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import pytest
from scripted import Scripted

from atlantis_netcfg.core.errors import DeviceError
from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.core.secret import Secret
from atlantis_netcfg.routeros import verify
from atlantis_netcfg.routeros.api import Endpoint, LoginError, Reply, Trap
from atlantis_netcfg.routeros.apply._contact import Contact
from atlantis_netcfg.routeros.apply._job import DeviceJob, Patience
from atlantis_netcfg.routeros.apply._settle import _is_reachable
from atlantis_netcfg.routeros.desired import read

if TYPE_CHECKING:
    from atlantis_netcfg.core.events import Event


def test_refused_login_ends_the_reachability_check() -> None:
    failures: list[Exception] = [DeviceError("away"), LoginError("no"), DeviceError("asked too often")]
    events: list[Event] = []

    async def connect(_: Endpoint) -> Any:  # noqa: ANN401 - it never returns
        raise failures.pop(0)

    endpoint = Endpoint("127.0.0.1", 1, "nobody", Secret("x"), None)
    patience = Patience(first_poll_s=0)
    job = DeviceJob("r", endpoint, read("", source="x"), events=events.append, patience=patience, connect=connect)
    work: Any = SimpleNamespace(contact=Contact(job), job=job)
    assert not asyncio.run(_is_reachable(work))
    assert len(failures) == 1
    assert [event.message for event in events] == ["testing access in a new session: waiting for a response"]


@pytest.mark.parametrize(
    ("reply", "words"), [(Reply(), "the response contains no .id"), (Reply(trap=Trap("no")), "no")]
)
def test_row_without_an_id_is_inconclusive(reply: Reply, words: str) -> None:
    session: Any = Scripted(lambda _: reply)
    verdict, reason = asyncio.run(verify._by_name(session))
    assert verdict is Verdict.INCONCLUSIVE
    assert words in reason
