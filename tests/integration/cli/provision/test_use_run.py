"""`provision links use` on a real address: there, told by everybody, and back, by the router or by a person."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest
from hints_said import advised, said
from quay import ROUTER, Quay, quay

from atlantis_netcfg.inventory import load
from atlantis_netcfg.links.policy import active_link
from atlantis_netcfg.operations.common.costs import ways_of
from atlantis_netcfg.routeros.link_use import SETTLED_S

pytestmark = [pytest.mark.slow, pytest.mark.namespace]

LINK = ("links", "use", "site=coastal", "link=4g", "for=30m", "--yes", "--accept-cost")
END = ("links", "use", "site=coastal", "end", "--yes")
TOLD = "4g is in use instead of the inventory's order until"
NOT_ASKED = 6
"""What `links` ends with here: no resolver is in this network, and only the router answers."""


@dataclass
class Technician:
    """Somebody who types commands at the quay."""

    at: Quay

    def type(self, *words: str, code: int = 0) -> str:
        more = ("--yes",) if words == ("site=coastal",) else ()
        done = self.at.provision(*dict.fromkeys([*words, *more]), code=code)
        return done.stdout + done.stderr

    def active(self) -> str | None:
        declaration = load(self.at.inventory, decrypt=lambda _text: "a secret that is long enough")
        answer = self.at.do("console", words=["/ip/route/print"])
        rows = [dict(word[1:].partition("=")[::2] for word in words) for kind, *words in answer if kind == "!re"]
        return active_link(rows, ways_of(declaration, declaration.hosts[ROUTER]))

    def wait(self, seconds: float) -> None:
        """Let time pass for the router."""
        self.at.do("wait", seconds=seconds)


@pytest.fixture
def technician(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Technician]:
    """A router as declared, which has run for a while."""
    with quay(tmp_path) as berth:
        berth.configure()
        monkeypatch.setenv("COLUMNS", "200")
        somebody = Technician(berth)
        somebody.wait(SETTLED_S)
        yield somebody


@pytest.mark.smoke
def test_temporary_link_is_reported_by_every_command_and_expires(technician: Technician) -> None:
    before = technician.at.export()
    assert "4g carries the traffic of coastal until" in technician.type(*LINK)
    assert technician.active() == "4g"
    assert TOLD in technician.type("plan", "site=coastal")
    run = technician.type("site=coastal")
    assert TOLD in run
    assert "0 changed" in run
    assert TOLD in technician.type("report", "drift", "site=coastal", f"device={ROUTER}")
    links = technician.type("links", "site=coastal", f"device={ROUTER}", code=NOT_ASKED)
    assert TOLD in " ".join(links.split())
    assert technician.active() == "4g"
    technician.wait(1800)
    assert (technician.active(), technician.at.export()) == ("wifi-ptp", before)


def test_advised_commands_start_and_end_the_temporary_link(technician: Technician) -> None:
    """Every way out that is printed, in the situation in which it is printed."""
    refused = technician.type("links", "use", "site=coastal", "--yes", code=3)
    begin, end = advised(
        said(refused, "run `provision links use site={} link=4g for=30m`, or `provision links use site={} end`")
    )
    nothing = technician.type(*end, "--yes", code=7)
    (look,) = advised(said(nothing, "`provision links site={}` shows which link carries the traffic"))
    technician.type(*look, f"device={ROUTER}", code=NOT_ASKED)
    technician.type(*begin, "--yes", "--accept-cost")
    links = technician.type("links", "site=coastal", f"device={ROUTER}", code=NOT_ASKED)
    (over,) = advised(said(links, "`provision links use site={} end` ends it now"))
    technician.type(*over, "--yes")
    assert technician.active() == "wifi-ptp"


def test_metered_link_needs_cost_consent(technician: Technician) -> None:
    before = technician.at.export()
    refused = technician.type("links", "use", "site=coastal", "link=4g", "for=30m", "--yes", code=4)
    assert "up to" in refused
    assert "--accept-cost" in refused
    assert technician.at.export() == before


def test_unproved_link_is_used_only_with_unproved(technician: Technician) -> None:
    before = technician.at.export()
    words = ("links", "use", "site=coastal", "link=satellite", "for=1h", "--yes", "--accept-cost")
    assert "there is no proof that satellite works" in technician.type(*words, code=4)
    technician.at.do("silence", addresses=["10.99.2.21", "10.99.2.22"])
    assert "4g is down, so nothing was changed" in technician.type(*LINK, code=4)
    assert technician.at.export() == before
    technician.type(*words, "--unproved")
    assert technician.active() == "satellite"
    technician.wait(3600)
    assert technician.active() == "wifi-ptp"


def test_use_is_refused_while_a_restarted_router_still_judges_its_links(technician: Technician) -> None:
    technician.at.do("restart")
    refused = technician.type(*LINK, code=4)
    assert "s ago and is still checking its links" in refused


def test_rollback_to_a_state_saved_meanwhile_does_not_reactivate_the_link(technician: Technician) -> None:
    before = technician.at.export()
    technician.type(*LINK)
    technician.at.do("console", words=["/system/note/set", "=note=somebody was here"])
    technician.type("site=coastal")
    technician.type(*END)
    assert technician.active() == "wifi-ptp"
    technician.type("recover", "rollback", "site=coastal", "run=latest", f"device={ROUTER}", "--yes")
    assert (technician.active(), technician.at.export()) == ("wifi-ptp", before)
