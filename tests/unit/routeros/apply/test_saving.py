"""The state before the change: whole or not at all, by script or by file."""

import asyncio

import pytest
from scripted import Scripted

from atlantis_netcfg.core.errors import DeviceError
from atlantis_netcfg.routeros.api import Command, Reply, Trap
from atlantis_netcfg.routeros.apply._state import fetch, parse_export
from atlantis_netcfg.routeros.apply._writer import ScriptWriter, SentenceWriter

EXPORT = "# 2026-01-01 08:00:00 by RouterOS 7.18.2\n# software id = X\n/ip pool\nadd name=lan\n"
PROBE = Reply(ret="atlantis")
REFUSED = Reply(trap=Trap("no such command", 0))


def test_complete_export_proves_that_scripts_run() -> None:
    found = parse_export(Reply(ret=EXPORT.replace("\n", "\r\n") + "atlantis: all of it\r\n"), REFUSED)
    assert found.text == EXPORT
    assert isinstance(found.writer, ScriptWriter)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "atlantis: all of it",
        EXPORT,
        EXPORT + "atlantis: all",
        "ok\natlantis: all of it",
        EXPORT + "atlantis: all of it\nmore",
    ],
    ids=["nothing", "no export", "no end", "cut off", "no header", "something behind"],
)
def test_incomplete_export_is_discarded(text: str) -> None:
    found = parse_export(Reply(ret=text), PROBE)
    assert found.text is None
    assert isinstance(found.writer, ScriptWriter)


@pytest.mark.parametrize("probe", [REFUSED, Reply(), Reply(ret="*5"), Reply(ret="atlantis\nand more")])
def test_device_without_script_output_gets_api_sentences(probe: Reply) -> None:
    found = parse_export(REFUSED, probe)
    assert found.text is None
    assert isinstance(found.writer, SentenceWriter)


def test_long_export_is_fetched_by_file_in_pieces() -> None:
    text = EXPORT + "".join(f"add name=pool{number} comment=é\n" for number in range(4000))
    data = text.encode()
    removed: list[Command] = []

    def answer(command: Command) -> Reply:
        arguments = dict(command.arguments)
        if command.path == "/file/read":
            start, size = int(arguments["offset"]), int(arguments["chunk-size"])
            assert size <= 32768
            return Reply(({"data": data[start : start + size].decode(errors="surrogateescape")},))
        removed.extend([command] if command.path == "/file/remove" else [])
        return Reply()

    assert asyncio.run(fetch(Scripted(answer))) == text
    assert len(removed) == 1


@pytest.mark.parametrize("broken", ["/export", "/file/read"])
def test_failed_save_raises_a_device_error(broken: str) -> None:
    def answer(command: Command) -> Reply:
        return Reply(trap=Trap("not enough permissions (9)")) if command.path == broken else Reply(({"data": ""},))

    with pytest.raises(DeviceError, match=r"cannot save the state before the change.*not enough permissions \(9\)"):
        asyncio.run(fetch(Scripted(answer)))


def test_empty_export_is_refused() -> None:
    with pytest.raises(DeviceError, match="its export is empty"):
        asyncio.run(fetch(Scripted(lambda _: Reply())))
