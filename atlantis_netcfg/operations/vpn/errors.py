"""What can go wrong between a command and the running server."""

from __future__ import annotations

from atlantis_netcfg.core.errors import DeviceFailed, ExitCode, NetcfgError, OutcomeUnknown

__all__ = ["AnswerLost", "HostKeyChanged", "RecordOlder", "ServerAway", "ServerRefused"]


class ServerAway(OutcomeUnknown):
    """The server was not reached: nothing was changed there."""


class HostKeyChanged(ServerAway):
    """Somebody answers at the server's address who has another host key: nothing was told to him."""


class AnswerLost(OutcomeUnknown):
    """The server was asked, and its answer did not come whole."""


class ServerRefused(DeviceFailed):
    """The server has said why it does not do what it was asked for."""


class RecordOlder(NetcfgError):
    """The server has what this record does not know: by a restored copy a revoked member would come back."""

    exit = ExitCode.FAILED

    def __init__(self, why: str) -> None:
        super().__init__(
            f"this record is older than the server: {why}",
            hint="work with the newest copy of the authority: `authority=FOLDER` names it, with this one nothing was "
            "signed or sent. If that copy is lost for good: `provision vpn sync --sign --take-list`",
        )
