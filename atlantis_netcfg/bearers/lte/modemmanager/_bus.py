"""Reads over D-Bus: properties of ModemManager's objects, and nothing that it could be told to do.

Over D-Bus and not through `mmcli -J`: one call gives all modems with all their interfaces, where `mmcli` takes one
start for each view, and its JSON is nobody's contract while the properties are. A ModemManager that does not run is not
started by our question.
"""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any

from jeepney import DBusAddress, HeaderFields, MessageFlag, MessageType, new_method_call
from jeepney.io.blocking import open_dbus_connection

from atlantis_netcfg.core.errors import DeviceFailed

if TYPE_CHECKING:
    from types import TracebackType
    from typing import Self

    from jeepney.io.blocking import DBusConnection

__all__ = ["ROOT", "SERVICE", "TIMEOUT_S", "Bus", "MmUnreachable", "Objects", "plain"]

SERVICE = "org.freedesktop.ModemManager1"
ROOT = "/org/freedesktop/ModemManager1"
TIMEOUT_S = 30.0
"""The bus is in this computer; ModemManager itself may wait for its modem."""
SYSTEM_BUS = "unix:path=/run/dbus/system_bus_socket"

Objects = dict[str, dict[str, dict[str, Any]]]
"""Properties by object path and interface."""


class MmUnreachable(DeviceFailed):
    """No bus, no ModemManager on it, or no answer; nothing was changed."""


class Bus:
    """A connection to the system's bus; `with` opens and closes it."""

    def __init__(self, address: str | None = None, *, timeout_s: float = TIMEOUT_S) -> None:
        self._address = address or os.environ.get("DBUS_SYSTEM_BUS_ADDRESS") or SYSTEM_BUS
        self._timeout_s = timeout_s
        self._connection: DBusConnection | None = None
        self.calls = 0

    def __enter__(self) -> Self:
        try:
            self._connection = open_dbus_connection(self._address)
        except (OSError, ValueError, RuntimeError) as error:
            raise MmUnreachable(
                f"no D-Bus on this computer ({type(error).__name__})",
                hint="ModemManager lives in a Linux computer with D-Bus; another unit has another `driver`",
            ) from error
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._connection is not None:
            self._connection.close()

    def objects(self) -> Objects:
        """Every modem with all its properties. Raises MmUnreachable."""
        found = self._call(ROOT, "org.freedesktop.DBus.ObjectManager", "GetManagedObjects")
        return {
            str(path): {str(name): {key: plain(value) for key, value in of.items()} for name, of in interfaces.items()}
            for path, interfaces in found.items()
        }

    def properties(self, path: str, interface: str) -> dict[str, Any]:
        """All properties of one interface of an object. Raises MmUnreachable."""
        found = self._call(path, "org.freedesktop.DBus.Properties", "GetAll", "s", (interface,))
        return {name: plain(value) for name, value in found.items()}

    def _call(self, path: str, interface: str, method: str, signature: str = "", body: tuple[str, ...] = ()) -> Any:  # noqa: ANN401 - D-Bus of any shape
        connection = self._connection
        assert connection is not None  # noqa: S101 - entered
        target = DBusAddress(path, bus_name=SERVICE, interface=interface)
        message = new_method_call(target, method, signature or None, body)
        message.header.flags |= MessageFlag.no_auto_start
        self.calls += 1
        try:
            reply = connection.send_and_get_reply(message, timeout=self._timeout_s)
        except (TimeoutError, OSError) as error:
            raise MmUnreachable(
                f"ModemManager does not answer within {self._timeout_s:g} s ({type(error).__name__})",
                hint="look at `systemctl status ModemManager`",
            ) from error
        if reply.header.message_type is MessageType.error:
            raise _refusal(str(reply.header.fields.get(HeaderFields.error_name, "")))
        return reply.body[0]


def _refusal(name: str) -> MmUnreachable:
    if name.endswith((".ServiceUnknown", ".NameHasNoOwner")):
        return MmUnreachable(
            "ModemManager does not run on this computer",
            hint="start it (`sudo systemctl start ModemManager`), or write the `driver` that fits the unit",
        )
    return MmUnreachable(
        f"ModemManager refused to be read ({name.rpartition('.')[2] or 'no reason given'})",
        hint="may this user read it? Try `mmcli -L` as the same user",
    )


def plain(value: Any) -> Any:  # noqa: ANN401 - D-Bus of any shape
    """A value without the signatures of D-Bus' variants, at any depth."""
    if isinstance(value, tuple) and len(value) == 2 and isinstance(value[0], str) and _signature(value[0]):  # noqa: PLR2004
        return plain(value[1])
    if isinstance(value, dict):
        return {key: plain(each) for key, each in value.items()}
    if isinstance(value, list):
        return [plain(each) for each in value]
    return value


def _signature(text: str) -> bool:
    return 0 < len(text) < 20 and set(text) <= set("ybnqiuxtdsogvha(){}")  # noqa: PLR2004 - no property of ours is deeper
