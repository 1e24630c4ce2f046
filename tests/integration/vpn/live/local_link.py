"""The way to a VPN server in a namespace of this computer."""

from collections.abc import Sequence

from atlantis_netcfg.operations.computers.remote_session import ServerAway, _RemoteLink


class LocalLink(_RemoteLink):
    """On this computer, as its root. `enter` is a program that goes where the server is, like `nsenter -t PID -n`."""

    def __init__(self, name: str = "this computer", enter: Sequence[str] = ()) -> None:
        super().__init__(name)
        self._enter = tuple(enter)

    def _words(self, command: str) -> Sequence[str]:
        return [*self._enter, "sh", "-c", command]

    def _trouble(self, code: int | None, text: str) -> ServerAway:
        words = f": {last}" if (last := text.strip().rpartition("\n")[2]) else ""
        return ServerAway(f"{self.name}: the toolkit's program did not start (exit {code}){words}")
