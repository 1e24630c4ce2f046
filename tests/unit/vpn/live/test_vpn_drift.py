"""Each way in which a server can be otherwise than recorded has its sentence, and nothing else is said."""

import hashlib
from contextlib import suppress
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest
import yaml

from atlantis_netcfg.computers.parts import File
from atlantis_netcfg.operations.computers.remote_session import AnswerLost
from atlantis_netcfg.operations.vpn import live
from atlantis_netcfg.operations.vpn.server_state import PLACE, Crl, ServerState, drift, observe
from atlantis_netcfg.vpn import server
from atlantis_netcfg.vpn.identity import MembershipList
from atlantis_netcfg.vpn.server import CCD, FIREWALL, FOLDER

NOW = datetime(2026, 6, 1, tzinfo=UTC)
WANTED = (
    File(f"{CCD}/iqua-d0", "ifconfig-push 10.80.17.1 255.255.0.0\n"),
    File(f"{FOLDER}/crl.pem", "a list\n"),
    File(FIREWALL, "a ruleset\n"),
)
ROLL = MembershipList({}, 4, "", NOW, ())
CRL = Crl(4, NOW - timedelta(days=1), NOW + timedelta(days=80), is_signed=True)
FILES = {file.path: hashlib.sha256(file.content.encode()).hexdigest() for file in WANTED}
SOUND = ServerState(
    ready=True,
    files=FILES,
    crl=CRL,
    members=(),
    firewall_as_file=True,
    firewall_why="",
    redirects=(),
    version="2.6.14",
    package="2.6.14-0+deb12u2",
    unit={"ActiveState": "active", "SubState": "running"},
    sessions=(),
    is_live=True,
    why="",
    at=NOW,
    last_sessions={},
    clock=NOW,
    clock_ahead_s=0.2,
)


def without(path: str) -> dict[str, str]:
    return {name: digest for name, digest in FILES.items() if name != path}


LISTED: dict[str, str | None] = yaml.safe_load(Path(__file__).with_name("vpn_drift.yml").read_text(encoding="utf-8"))
CASES: dict[str, dict[str, Any]] = {
    "sound": {},
    "never set up": {"ready": False, "files": {}},
    "not admitted": {"files": without(f"{CCD}/iqua-d0")},
    "changed by hand": {"files": {**FILES, f"{CCD}/iqua-d0": "00"}},
    "a stranger": {"files": {**FILES, f"{CCD}/x": "00"}},
    "no list": {"crl": None},
    "another's list": {"crl": replace(CRL, is_signed=False)},
    "older": {"crl": replace(CRL, number=3), "files": {**FILES, f"{FOLDER}/crl.pem": "00"}},
    "newer": {"crl": replace(CRL, number=5), "files": {**FILES, f"{FOLDER}/crl.pem": "00"}},
    "same number, other list": {"files": {**FILES, f"{FOLDER}/crl.pem": "00"}},
    "early": {"clock": NOW - timedelta(days=2)},
    "expired": {"clock": NOW + timedelta(days=80)},
    "ends soon": {"clock": NOW + timedelta(days=51)},
    "no ruleset": {"files": without(FIREWALL)},
    "no nft": {"members": None, "firewall_why": "nft does not respond"},
    "not loaded": {"members": None},
    "changed with nft": {"firewall_as_file": False},
    "cannot be told": {"firewall_as_file": None},
    "redirects": {"redirects": ("all", "eth0")},
    "down": {"unit": {"ActiveState": "failed", "SubState": "failed"}, "is_live": False},
    "held": {"is_live": False, "why": "silent"},
    "fast": {"clock_ahead_s": 61.0},
    "slow": {"clock_ahead_s": -3600.0},
    "no systemd": {"unit": {}},
}


@pytest.mark.parametrize("case", CASES, ids=lambda case: str(case).replace(" ", "-"))
def test_drift_messages_match_the_list(case: str) -> None:
    words = LISTED[case]
    assert drift(replace(SOUND, **CASES[case]), WANTED, ROLL) == ((words,) if words is not None else ())


def test_every_case_is_listed() -> None:
    assert list(LISTED) == list(CASES)


def test_firewall_stamp_belongs_to_the_unit_of_the_role() -> None:
    unit = next(one for one in server.system_units(()) if one.name == PLACE["firewall_unit"])
    assert unit.after == (PLACE["firewall"],)
    assert unit.reload


class Told:
    """A link whose server says this."""

    def __init__(self, to: str = "look", /, **told: Any) -> None:  # noqa: ANN401 - JSON
        self.round_trips = 0
        self.to, self.messages = to, told

    def ask(self, do: str, **_what: Any) -> dict[str, Any]:  # noqa: ANN401 - JSON
        assert do == self.to
        return self.messages

    def close(self) -> None:
        pass


LOOKED: dict[str, Any] = {
    "clock": 1795330618.5,
    "ready": True,
    "files": {},
    "list": None,
    "members": ["10.80.17.1/32"],
    "as_file": True,
    "firewall_why": "",
    "redirects": [],
    "version": None,
    "package": None,
    "unit": {},
    "management": "held",
    "sessions": [],
    "at": 0,
    "why": "silent",
    "seen": None,
}


@pytest.mark.parametrize("lacks", LOOKED)
def test_incomplete_response_is_reported(lacks: str) -> None:
    told = Told(**{name: value for name, value in LOOKED.items() if name != lacks})
    with pytest.raises(AnswerLost, match=f"the server sent an invalid response to `look` .KeyError: '{lacks}'"):
        observe(told)


@pytest.mark.parametrize(
    "kind", ["x", 7, -1e300, [7], [{}], {"seen": {"a": {"last": 1e300}}}, True, ["::1/128"]], ids=ascii
)
@pytest.mark.parametrize("name", LOOKED)
def test_response_of_a_wrong_type_is_reported_or_treated_as_text(name: str, kind: Any) -> None:  # noqa: ANN401 - JSON
    """Or is taken for text, and judged."""
    with suppress(AnswerLost):
        state = observe(Told(**{**LOOKED, name: kind}))
        assert all(isinstance(one, str) for one in drift(state, WANTED, ROLL))


@pytest.mark.parametrize("lacks", ["out", "dead", "left", "told"])
def test_only_a_complete_response_confirms_a_revocation(lacks: str) -> None:
    whole: dict[str, Any] = {"out": True, "dead": True, "left": [], "told": []}
    evidence = live.RevocationEvidence((), (), {}, out=False, dead=False, left=(), notes=())
    assert live.verify(Told("verify", **whole), evidence).is_confirmed
    wrongs: tuple[Any, ...] = ("no", 1, {})
    for wrong in wrongs:
        with suppress(AnswerLost):
            told = live.verify(Told("verify", **{**whole, lacks: wrong}), evidence)
            assert told.is_confirmed == (lacks not in {"out", "dead"})
    whole.pop(lacks)
    with pytest.raises(AnswerLost):
        live.verify(Told("verify", **whole), evidence)


@pytest.mark.parametrize(
    ("seen", "names"),
    [
        (None, set()),
        ({}, set()),
        ({"seen": []}, set()),
        ({"format": 1, "seen": {"a": {"last": 1795330618}, "b": {"last": "x"}, "c": 7}}, {"a"}),
    ],
)
def test_malformed_session_notes_are_tolerated(seen: Any, names: set[str]) -> None:  # noqa: ANN401 - JSON
    told = Told(**{**LOOKED, "seen": seen})
    state = observe(told)
    assert state.last_sessions.keys() == names
    assert (state.is_live, state.active, state.crl) == (False, None, None)
