"""A listening at the control centre for the checklist: it is asked there, and paid for only after consent."""

import asyncio
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from atlantis_netcfg.checklist.probes import RobotsHeardRequest, RobotsHeardResult, Trouble
from atlantis_netcfg.checklist.runner.cost import previews
from atlantis_netcfg.checklist.runner.robots import ask_robots
from atlantis_netcfg.inventory import load
from atlantis_netcfg.links.cost import preview
from atlantis_netcfg.operations.common.request import Request
from atlantis_netcfg.operations.common.site_links import link_of
from atlantis_netcfg.operations.robots import listening_cost, remote
from atlantis_netcfg.robots.observation import RobotObservation

SHIPPED = load(Path(__file__).parents[4] / "inventory")
QUESTION = RobotsHeardRequest("heard", host="scc-control")


def ask(request: Request) -> RobotsHeardResult:
    answers = asyncio.run(ask_robots(SHIPPED, "te4sea", request, [("heard", QUESTION)], lambda *_: None))
    answer = answers["heard"]
    assert isinstance(answer, RobotsHeardResult)
    return answer


@pytest.fixture
def places(monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, float, Any]]:
    """What is asked of another computer, which hears nobody."""
    asked: list[tuple[str, float, Any]] = []

    def listen_there(_: object, host: Any, seconds: float, *, sites: Any, request: object) -> RobotObservation:  # noqa: ANN401
        assert isinstance(request, Request)
        asked.append((host.name, seconds, sites))
        return RobotObservation(seconds)

    monkeypatch.setattr(remote, "listen_there", listen_there)
    return asked


def test_metered_link_is_not_crossed_without_consent(
    monkeypatch: pytest.MonkeyPatch, places: list[tuple[str, float, Any]]
) -> None:
    cost = preview(2_000_000, 20.0, link_of(SHIPPED, "te4sea", "satellite"))
    monkeypatch.setattr(listening_cost, "listening_cost", lambda *_: cost)
    refusal = ask(Request())
    assert (refusal.trouble, places) == (Trouble.NO_PLACE, [])
    assert "the cost was not accepted" in refusal.words
    answer = ask(Request(accept_cost=True))
    assert (answer.trouble, places) == (None, [("scc-control", 20.0, ["te4sea"])])


def test_control_centre_is_asked_over_a_link_that_is_not_metered(
    monkeypatch: pytest.MonkeyPatch, places: list[tuple[str, float, Any]]
) -> None:
    monkeypatch.setattr(listening_cost, "listening_cost", lambda *_: None)
    assert ask(Request()).trouble is None
    assert [name for name, _, _ in places] == ["scc-control"]


def test_cost_of_listening_is_shown_beforehand(monkeypatch: pytest.MonkeyPatch) -> None:
    cost = preview(2_000_000, 20.0, link_of(SHIPPED, "te4sea", "satellite"))
    monkeypatch.setattr(listening_cost, "listening_cost", lambda *_: cost)
    probe: Any = type("Probe", (), {"asks": lambda _: (QUESTION, replace(QUESTION, name="again"))})()
    entry: Any = type("Entry", (), {"step": type("Step", (), {"probe": probe})()})()
    assert previews(SHIPPED, "te4sea", [entry], Request()) == (cost,)
