"""Files onto a device by SFTP; the host key is checked before the password is sent."""

from __future__ import annotations

from typing import TYPE_CHECKING

import paramiko

from atlantis_netcfg.console._errors import ConsoleLost
from atlantis_netcfg.console._keys import PinnedKey
from atlantis_netcfg.console._ssh import connected
from atlantis_netcfg.console._types import CONNECT_S

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from atlantis_netcfg.secret import Secret

__all__ = ["upload"]


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
    try:
        with connected(address, port):
            client.connect(
                address,
                port,
                user,
                password.reveal(),
                timeout=timeout_s,
                banner_timeout=timeout_s,
                auth_timeout=timeout_s,
                allow_agent=False,
                look_for_keys=False,
            )
        try:
            with client.open_sftp() as sftp, source.open("rb") as file:
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
