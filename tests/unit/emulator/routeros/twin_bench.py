"""A router twin on a clock that tests turn by hand."""

from dataclasses import dataclass, field
from typing import Any

from atlantis_netcfg.emulator.routeros.answers import Answer, Caller
from atlantis_netcfg.emulator.routeros.device import Device
from atlantis_netcfg.emulator.routeros.spec import RouterSpec, User

TECHNICIAN = "10.64.101.10"
ROUTER = "10.64.101.1"


@dataclass
class Bench:
    """A device, its clock, and one session; `say` sends words and returns replies as lines."""

    spec: RouterSpec
    now: float = 1000.0
    device: Device = field(init=False)
    caller: Caller = field(init=False)

    def __post_init__(self) -> None:
        self.device = Device(self.spec, lambda: self.now)
        self.caller = self.session()

    def session(self, user: str = "provision", password: str = "") -> Caller:
        return self.device.login(user, password, via="api-ssl", address=TECHNICIAN)

    def say(self, *words: str, by: Caller | None = None) -> list[str]:
        return [line(answer) for answer in self.device.run(by or self.caller, words)]

    def script(self, text: str) -> str:
        (reply,) = self.device.run(self.caller, ["/execute", f"=script={text}", "=as-string="])
        return reply.words[0].removeprefix("=ret=")

    def value(self, menu: str, name: str, *queries: str) -> str | None:
        for answer in self.device.run(self.caller, [f"{menu}/print", *queries]):
            if answer.kind == "!re":
                return row(answer).get(name)
        return None

    def count(self, menu: str) -> int:
        (reply,) = self.device.run(self.caller, [f"{menu}/print", "=count-only="])
        return int(reply.words[0].removeprefix("=ret="))

    def reaches(self, service: str = "api-ssl", *, established: bool = False) -> bool:
        talks = established or self.device.services()[service].admits(TECHNICIAN)
        return talks and self.device.path_open(TECHNICIAN, ROUTER, service, is_established=established)

    def text(self) -> str:
        return self.device.export(header=False, show_sensitive=True)


def line(answer: Answer) -> str:
    return " ".join((answer.kind, *answer.words))


def row(answer: Answer) -> dict[str, str]:
    return dict(word[1:].partition("=")[::2] for word in answer.words)


USERS = (
    User(name="provision"),
    User(name="watch", password="look", group="read"),
    User(name="edit", password="write", group="write"),
    User(name="gone", password="x", is_disabled=True),
    User(name="afar", password="y", address="192.0.2.0/24"),
)


def make(**spec: Any) -> Bench:  # noqa: ANN401 - whatever a spec takes
    return Bench(RouterSpec(**{"name": "router", "users": USERS, **spec}))
