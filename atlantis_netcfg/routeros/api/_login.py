"""The login sentences of both ages (manual, API, "Initial login"): one turn since RouterOS 6.43, two before."""

from __future__ import annotations

import binascii
import hashlib
from typing import TYPE_CHECKING

from atlantis_netcfg.routeros.api._errors import LoginRefused, ProtocolError, SessionLost
from atlantis_netcfg.routeros.api._values import Command

if TYPE_CHECKING:
    from atlantis_netcfg.routeros.api._values import Endpoint, Reply
    from atlantis_netcfg.routeros.api._wire import Wire

__all__ = ["log_in"]


async def log_in(wire: Wire, endpoint: Endpoint) -> None:
    """Log in over a TLS connection whose certificate was checked. Raises LoginRefused with the device's words.

    A device older than 6.43 answers name and password with a challenge; that it saw the password is no loss, since it
    is the pinned device and the words are encrypted.
    """
    password = endpoint.password.reveal()
    reply = await _ask(wire, endpoint, ("password", password))
    if reply.ret is not None:
        await _ask(wire, endpoint, ("response", _response(reply.ret, password, endpoint)))


async def _ask(wire: Wire, endpoint: Endpoint, proof: tuple[str, str]) -> Reply:
    command = Command("/login", (("name", endpoint.user), proof))
    patience_s = min(endpoint.connect_timeout_s, endpoint.reply_timeout_s)
    try:
        (reply,) = await wire.exchange([command], patience_s, patience_s)
    except SessionLost as lost:
        raise type(lost)(f"{lost} (during the login of `{endpoint.user}`)", in_flight=False) from None
    if reply.trap is not None:
        raise LoginRefused(
            f"{endpoint} refused the login of `{endpoint.user}`: {reply.trap.message}",
            hint="check the name and the vaulted password of this device in the inventory",
        )
    return reply


def _response(challenge: str, password: str, endpoint: Endpoint) -> str:
    try:
        salt = binascii.unhexlify(challenge)
    except ValueError:
        raise ProtocolError(f"{endpoint} sent a login challenge that is no number", in_flight=False) from None
    secret = password.encode("utf-8", "surrogateescape")
    return "00" + hashlib.md5(b"\x00" + secret + salt, usedforsecurity=False).hexdigest()
