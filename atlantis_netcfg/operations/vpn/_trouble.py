"""What can go wrong between a command and the running server."""

from __future__ import annotations

from atlantis_netcfg.errors import DeviceFailed, OutcomeUnknown

__all__ = ["AnswerLost", "HostKeyChanged", "ServerAway", "ServerRefused"]


class ServerAway(OutcomeUnknown):
    """The server was not reached: nothing was changed there."""


class HostKeyChanged(ServerAway):
    """Somebody answers at the server's address who has another host key: nothing was told to him."""


class AnswerLost(OutcomeUnknown):
    """The server was asked, and its answer did not come whole."""


class ServerRefused(DeviceFailed):
    """The server has said why it does not do what it was asked for."""
