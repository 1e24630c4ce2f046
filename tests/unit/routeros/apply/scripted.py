"""A session without a device."""

from collections.abc import Callable, Sequence

from atlantis_netcfg.routeros.api import Command, Reply, Traffic


class Scripted:
    """A session whose answers a test computes."""

    def __init__(self, answer: Callable[[Command], Reply]) -> None:
        self.traffic = Traffic()
        self.sent: list[Command] = []
        self._answer = answer

    async def command(self, command: Command, *, silence_s: float | None = None) -> Reply:
        (reply,) = await self.flight([command], silence_s=silence_s)
        return reply

    async def flight(self, commands: Sequence[Command], *, silence_s: float | None = None) -> list[Reply]:
        assert silence_s is None
        self.sent += commands
        return [self._answer(command) for command in commands]

    async def close(self, *, wait: bool = True) -> None:
        """Nothing is open."""
