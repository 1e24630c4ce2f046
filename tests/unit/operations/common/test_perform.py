"""What the doors get when something goes wrong before or beside the devices."""

import json
import os
from pathlib import Path
from typing import Any, NoReturn

import pytest

from atlantis_netcfg.cli.base.playbook import _EventListener
from atlantis_netcfg.core.crash_report import InternalError
from atlantis_netcfg.core.errors import UsageError, fill_hint
from atlantis_netcfg.core.events import Event, Stage, ignore
from atlantis_netcfg.core.messages import Message, arg, msg
from atlantis_netcfg.core.stored_messages import unpack
from atlantis_netcfg.inventory import load
from atlantis_netcfg.operations import Request, Target, apply
from atlantis_netcfg.operations.common import session_link
from atlantis_netcfg.operations.common.jobs import device_job
from atlantis_netcfg.operations.common.request import EventStream
from atlantis_netcfg.runs import NoJournal

INVENTORY = Path(__file__).parents[4] / "inventory"


def told(reader: int) -> list[dict[str, Any]]:
    with os.fdopen(reader, encoding="utf-8") as lines:
        return [json.loads(line) for line in lines]


def test_internal_error_is_logged_and_sent_to_the_listener(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: object, **__: object) -> NoReturn:
        raise ZeroDivisionError("the password is swordfish")

    monkeypatch.setattr(apply, "open_inventory", broken)
    reader, writer = os.pipe()
    request = {"state": str(tmp_path), "events_fd": writer, "command": "provision site=coastal"}
    with pytest.raises(InternalError, match=r"^provision itself failed \(ZeroDivisionError\)") as caught:
        apply.perform(INVENTORY, ["coastal-router"], request, plan_only=True, decrypt=str)
    os.close(writer)
    (log,) = (tmp_path / "log").iterdir()
    assert caught.value.hint == f"please send us the log file {log}"
    assert "ZeroDivisionError" in log.read_text(encoding="utf-8")
    assert log.stat().st_mode & 0o077 == 0
    (line,) = map(unpack, told(reader))
    assert line == {"error": {"message": str(caught.value), "hint": caught.value.hint, "exit": 1}}


def test_example_values_are_refused_in_a_real_run(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="still contains example values"):
        apply.perform(INVENTORY, ["coastal-router"], {"state": str(tmp_path)}, plan_only=True, decrypt=str)


@pytest.mark.parametrize(
    ("host", "via", "name", "rtt_s"),
    [
        ("coastal-router", None, "lan", 0.001),
        ("coastal-router", "satellite", "satellite", 0.7),
        ("te4sea-router", None, "satellite", 0.7),
        ("te4sea-router", "lan", "lan", 0.001),
    ],
)
def test_session_link_is_the_declared_or_the_named_one(host: str, via: str | None, name: str, rtt_s: float) -> None:
    declaration = load(INVENTORY)
    bearer = session_link.site_link_of(declaration, declaration.hosts[host], via)
    assert (bearer.name, bearer.rtt_s) == (name, rtt_s)


def test_unknown_link_is_refused_with_the_known_ones() -> None:
    declaration = load(INVENTORY)
    with pytest.raises(UsageError, match="coastal has no such link") as caught:
        session_link.site_link_of(declaration, declaration.hosts["coastal-router"], "uplink")
    assert caught.value.hint == "its links: lan, wifi-ptp, 4g, satellite"


def test_guard_gets_the_declared_address_for_an_emulated_device(tmp_path: Path) -> None:
    declaration = load(INVENTORY)
    target = Target(host="127.0.0.1", port=1, pin="00")
    request = Request(state=tmp_path, rehearsed=True, targets={"coastal-router": target})
    job = device_job(declaration, declaration.hosts["coastal-router"], request, NoJournal(), ignore)
    assert (job.endpoint.host, job.endpoint.pin, job.address) == ("127.0.0.1", "00", "10.64.101.1")


def test_messages_keep_their_ids_on_the_way_to_the_command() -> None:
    """The engine's tasks send text lines: what they say is shown in the language of the command that reads them."""
    received: list[Event] = []
    with _EventListener(received.append, lambda _name, _result: None) as listener:
        stream = EventStream(listener.writer)
        stream.event(Event("cpe", Stage.OBSERVED, msg(f"{arg(3)} changes left")))
        stream.outcome({"cpe": {"message": msg(f"{arg('cpe')}: done"), "hint": None}}, {})
        stream.error(UsageError(f"{arg('cpe')} is gone", hint=fill_hint("look at site=…", site="scc")))
    assert listener.refusal is not None
    texts = [
        received[0].message,
        listener.outcome.devices["cpe"]["message"],
        str(listener.refusal),
        listener.refusal.hint,
    ]
    assert texts == ["3 changes left", "cpe: done", "cpe is gone", "look at site=scc"]
    assert [text.source for text in texts if isinstance(text, Message)] == [
        f"{arg(3)} changes left",
        f"{arg('cpe')}: done",
        f"{arg('cpe')} is gone",
        fill_hint("look at site=…", site="scc").source,  # type: ignore[attr-defined]
    ]
