"""A router twin with a modem, and what the reader of bearers makes of it."""

from typing import Any

from atlantis_netcfg.emulator.routeros.answers import Answer
from atlantis_netcfg.emulator.routeros.device import Device
from atlantis_netcfg.emulator.routeros.spec import CellSpec, ModemSpec, RouterSpec, SimSpec, User
from atlantis_netcfg.links.lte import LteReading
from atlantis_netcfg.links.lte.routeros import log_query, queries, read


class Box:
    def __init__(self, *, pin: str = "", version: str = "7.18.2", sim: bool = True, **cell: Any) -> None:  # noqa: ANN401
        card = SimSpec(pin=pin) if sim else None
        modem = ModemSpec(sim=card, cell=CellSpec(**cell))
        spec = RouterSpec(name="box", version=version, users=(User(name="provision"),), modem=modem)
        self.now = 1000.0
        self.device = Device(spec, lambda: self.now)
        self._log_in()

    def _log_in(self) -> None:
        self.caller = self.device.login("provision", "", via="api-ssl", address="10.64.101.10")

    def say(self, command: str, *words: str) -> list[str]:
        return [" ".join((one.kind, *one.words)) for one in self.run(command, *words)]

    def run(self, command: str, *words: str) -> list[Answer]:
        return self.device.run(self.caller, [command, *(f"={word}" for word in words)])

    def rows(self, command: str, *words: str) -> list[dict[str, str]]:
        answers = [one for one in self.run(command, *words) if one.kind == "!re"]
        return [dict(word[1:].partition("=")[::2] for word in one.words) for one in answers]

    def set(self, *words: str) -> None:
        assert self.say("/interface/lte/set", ".id=lte1", *words) == ["!done"]

    def profile(self, *words: str) -> None:
        assert self.say("/interface/lte/apn/set", ".id=default", *words) == ["!done"]

    def reboot(self) -> None:
        self.device.reboot()
        self._log_in()

    def read(self) -> LteReading:
        asked = (*queries("lte1"), log_query())
        told = [self.rows(one.path, *(f"{name}={value}" for name, value in one.words)) for one in asked]
        monitor, interfaces, profiles, addresses, log = told
        return read(monitor[0], interfaces, profiles, addresses, log)

    @property
    def tries(self) -> tuple[int, int]:
        """Tries left, and how often a PIN has reached the card."""
        return self.device.core.sim.tries_left, self.device.core.sim.pins_entered
