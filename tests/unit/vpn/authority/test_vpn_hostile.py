"""Thousands of names, at the function that issues: refused in words, or good, and nothing is left of those refused."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from authority_stand import POOL, stand
from hostile_names import hostile_names, is_legitimate
from hypothesis import given
from hypothesis import strategies as st

from atlantis_netcfg.core.errors import ExitCode, UsageError
from atlantis_netcfg.vpn.authority.model import EnrolmentFile, EnrolmentRequest
from atlantis_netcfg.vpn.identity import Identity, MemberKind
from atlantis_netcfg.vpn.names import InvalidNameError, check_name, member_name


def test_sample_has_enough_hostile_names_and_few_legitimate_ones() -> None:
    names = hostile_names()
    assert len(names) >= 2000
    assert 10 < sum(one.legitimate for one in names) < len(names) / 10


@pytest.mark.parametrize("what", ["device", "partner", "host"])
def test_hostile_names_are_refused_and_legitimate_ones_accepted(what: str) -> None:
    for one in hostile_names():
        try:
            taken = check_name(one.text, what) == one.text
        except InvalidNameError as refused:
            taken = False
            well_said(refused, what)
        assert taken == one.legitimate, one


def well_said(refused: InvalidNameError, what: str) -> None:
    """In words that a terminal can show, whatever the name was."""
    assert refused.exit is ExitCode.USAGE
    told = f"{refused}{refused.hint}"
    assert told.isprintable()
    assert str(refused).startswith(f"{what} `")
    assert len(told) < 400


@given(st.text(max_size=60) | st.from_regex(r"[a-z0-9-]{1,50}\n?"))
def test_arbitrary_text_is_accepted_only_if_legitimate(text: str) -> None:
    try:
        check_name(text, "device")
    except InvalidNameError as error:
        refused = error
    else:
        assert is_legitimate(text)
        return
    assert not is_legitimate(text)
    word, _, offered = (refused.hint or "").removesuffix(", for instance").partition("=")
    assert word != "device" or is_legitimate(offered)


def wishes(text: str) -> Iterator[EnrolmentRequest]:
    """By every way that a name can come in, its parts unchecked by whoever calls."""
    yield EnrolmentRequest(f"iqua-{text}", MemberKind.ROBOT, "iqua", text, pool=POOL)
    yield EnrolmentRequest(f"{text}-laptop1", MemberKind.LAPTOP, text, "laptop1", pool=POOL)
    yield EnrolmentRequest(text, MemberKind.HOST, None, text, pool=POOL)
    yield EnrolmentRequest("iqua-sparus2", MemberKind.ROBOT, "iqua", text, pool=POOL)
    yield EnrolmentRequest(text, MemberKind.ROBOT, "iqua", "sparus2", pool=POOL)


def never(_: Identity) -> EnrolmentFile:
    pytest.fail("a refused name was handed out")


def test_a_refused_name_leaves_nothing(tmp_path: Path) -> None:
    made = stand(tmp_path)
    with made.signing() as signer:
        before = {path: path.stat().st_size for path in made.folder.rglob("*")}
        for one in hostile_names():
            if one.legitimate:
                continue
            for wish in wishes(one.text):
                with pytest.raises(UsageError):
                    signer.issue([wish], never)
        assert {path: path.stat().st_size for path in made.folder.rglob("*")} == before
    assert made.authority.membership().members == {}


def test_legitimate_names_are_issued_unchanged(tmp_path: Path) -> None:
    made = stand(tmp_path)
    devices = [one.text for one in hostile_names() if one.legitimate and len(one.text) <= 43]
    with made.signing() as signer:
        asked = [
            EnrolmentRequest(member_name("iqua", one), MemberKind.ROBOT, "iqua", one, pool=POOL) for one in devices
        ]
        issued = signer.issue(asked, made.deliver)
    assert [(one.member.device, one.certificate.common_name) for one in issued] == [
        (device, f"iqua-{device}") for device in devices
    ]
