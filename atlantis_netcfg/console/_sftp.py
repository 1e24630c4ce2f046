"""Files onto a device by SFTP; the host key is checked before the password is sent."""

from __future__ import annotations

from typing import TYPE_CHECKING

import paramiko

from atlantis_netcfg.console._errors import ConsoleLost
from atlantis_netcfg.console._keys import PinnedKey
from atlantis_netcfg.console._ssh import TcpSocket, connected, ended_after
from atlantis_netcfg.console._types import CONNECT_S

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from atlantis_netcfg.core.secret import Secret

__all__ = ["upload"]

_SLOWEST_S, _SLOWEST_BYTES = 600.0, 2_000
"""A copy that is slower than 16 kbit/s on top of ten minutes is none."""


def upload(  # noqa: PLR0913 - all of it is one address and one file
    address: str,
    port: int,
    user: str,
    password: Secret,
    *,
    pin: str | None,
    source: Path,
    name: str,
    progress: Callable[[int, int], None] | None = None,
    timeout_s: float = CONNECT_S,
) -> None:
    """Copy `source` to the file `name` of the device. `progress(sent, total)` in bytes, often.

    Raises as `open_ssh`; ConsoleLost when the copy broke off or has another length: then the file on the device is
    not whole.
    """
    client = paramiko.SSHClient()
    client.set_missing_host_key_policy(PinnedKey(pin))
    size = source.stat().st_size
    sock: TcpSocket | None = None
    try:
        with connected(address, port), ended_after(client.close, 2 * timeout_s):
            sock = TcpSocket.connect_to(address, port, timeout_s)
            client.connect(
                address,
                port,
                user,
                password.reveal(),
                sock=sock,
                timeout=timeout_s,
                banner_timeout=timeout_s,
                auth_timeout=timeout_s,
                allow_agent=False,
                look_for_keys=False,
            )
        try:
            with (
                ended_after(client.close, _SLOWEST_S + size / _SLOWEST_BYTES),
                client.open_sftp() as sftp,
                source.open("rb") as file,
            ):
                channel = sftp.get_channel()
                if channel is not None:
                    channel.settimeout(timeout_s)
                sftp.putfo(file, name, size, progress, confirm=True)
        except (OSError, EOFError, paramiko.SSHException) as error:
            raise ConsoleLost(
                f"{address} port {port}: {name} was not copied whole ({type(error).__name__})",
                in_flight=True,
                hint="is there room on the device? Run the same command again: the copy starts anew",
            ) from error
    finally:
        client.close()
        if sock is not None:
            sock.close()
