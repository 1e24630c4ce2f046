"""What a run does while it sends: it ends where the router's session is lost, and where a person stops it."""

import asyncio
import os
import signal
import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, cast

import pytest
from waiting import HANG_S

from atlantis_netcfg.core.errors import DeviceError
from atlantis_netcfg.inventory import load
from atlantis_netcfg.links.qualify.measured_run import BudgetLimits, Selection
from atlantis_netcfg.operations.qualify import run
from atlantis_netcfg.operations.qualify.far_end import MeasuredFarEnd
from atlantis_netcfg.operations.qualify.run import LinkRun
from atlantis_netcfg.routeros.api import Command, Reply, Session

if TYPE_CHECKING:
    from atlantis_netcfg.operations.qualify.measure import Measurement

DECLARED = load(Path(__file__).parents[4] / "inventory")


@dataclass
class Waiting:
    """A measurement that ends when it is stopped."""

    stop: threading.Event
    begun: Callable[[], None] = lambda: None
    reason: str = "done"

    def measure(self) -> str:
        self.begun()
        assert self.stop.wait(HANG_S)
        self.reason = "stopped"
        return self.reason


@dataclass
class MortalSession:
    """Answers so often, and is lost then."""

    answers: int
    commands: list[Command] = field(default_factory=list)

    async def command(self, command: Command) -> Reply:
        self.commands.append(command)
        if len(self.commands) > self.answers:
            raise DeviceError("the session is lost")
        return Reply()


FAR = MeasuredFarEnd("192.0.2.7", "192.0.2.7", 862, None)


def link_run() -> LinkRun:
    bearer = DECLARED.sites["coastal"].bearers[0]
    return LinkRun(DECLARED, "coastal", bearer, Selection.ALL, BudgetLimits(), Path("/nowhere"), FAR)


def test_lost_router_session_stops_the_measurement(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(run, "_ALIVE_S", 0.01)
    made, session = link_run(), MortalSession(answers=3)
    measurement = Waiting(made.stop)
    with pytest.raises(DeviceError, match="the session is lost"):
        asyncio.run(made._send(cast("Session", session), cast("Measurement", measurement)))
    assert measurement.reason == "stopped"
    assert len(session.commands) == 4


def test_ctrl_c_stops_the_measurement_cleanly() -> None:
    made, before = link_run(), signal.getsignal(signal.SIGINT)
    measurement = Waiting(made.stop, begun=lambda: os.kill(os.getpid(), signal.SIGINT))
    asyncio.run(made._send(cast("Session", MortalSession(9)), cast("Measurement", measurement)))
    assert measurement.reason == "stopped"
    assert signal.getsignal(signal.SIGINT) is before
