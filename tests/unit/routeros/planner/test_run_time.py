"""What a device changes by itself while it works is as declared; everything else about the same row is not."""

import pytest
from plan_world import lines, observed

from atlantis_netcfg.core.messages import Message, arg
from atlantis_netcfg.routeros.desired import read
from atlantis_netcfg.routeros.drift import compare
from atlantis_netcfg.routeros.planner import plan

TEXT = """\
# atlantis:run-time /ip route distance=10 distance=110
# atlantis:run-time /tool netwatch disabled=yes disabled=no
# atlantis:entire /tool netwatch
/ip route
add comment="atlantis: ptp" distance=10 gateway=198.51.100.11
add comment="atlantis: other" distance=20 gateway=198.51.100.21
/tool netwatch
add comment="atlantis: asks" host=198.51.100.11 name=watch
add comment="atlantis: waits" disabled=yes host=198.51.100.11 name=silence
"""


def changes(device: str) -> list[str]:
    there = observed(device)
    planned = plan("r", read(TEXT), there)
    told = compare(read(TEXT), there, planned)
    assert bool(told.differences) is bool(planned.actions)
    return lines(planned)


AS_DECLARED = """\
/ip route
add comment="atlantis: ptp" distance={ptp} gateway=198.51.100.11
add comment="atlantis: other" distance={other} gateway=198.51.100.21
/tool netwatch
add comment="atlantis: asks" disabled={asks} host=198.51.100.11 name=watch
add comment="atlantis: waits" disabled={waits} host=198.51.100.11 name=silence
"""


@pytest.mark.parametrize("ptp", ["10", "110", "0x6E"])
@pytest.mark.parametrize("waits", ["yes", "true", "no", "false"])
def test_both_runtime_values_are_no_drift(ptp: str, waits: str) -> None:
    assert changes(AS_DECLARED.format(ptp=ptp, other="20", asks="no", waits=waits)) == []


@pytest.mark.parametrize(
    ("ptp", "other", "asks", "change"),
    [
        ("111", "20", "no", "/ip/route/set *1 distance=10"),
        ("10", "120", "no", "/ip/route/set *2 distance=20"),
        ("10", "110", "no", "/ip/route/set *2 distance=20"),
        ("10", "20", "yes", "/tool/netwatch/set *1 disabled=no"),
    ],
)
def test_any_other_value_is_repaired(ptp: str, other: str, asks: str, change: str) -> None:
    """Another distance, the same distance in another row, a watch that somebody has switched off."""
    (found,) = changes(AS_DECLARED.format(ptp=ptp, other=other, asks=asks, waits="no"))
    assert found.replace(" ", "").replace("/", "") == change.replace(" ", "").replace("/", "")


def test_a_new_row_has_the_declared_value() -> None:
    planned = lines(plan("r", read(TEXT), observed("")))
    assert sum("distance=10 " in line for line in planned) == 1
    assert sum("disabled=yes" in line for line in planned) == 1
    assert not any("distance=110" in line for line in planned)


def test_note_is_shown_only_with_a_change_in_its_menu() -> None:
    text = "# atlantis:note /tool netwatch: asking takes {1} MB a day\n" + TEXT
    (note,) = plan("r", read(text), observed("")).notes
    assert isinstance(note, Message)
    assert (note, note.source) == ("asking takes 1 MB a day", f"asking takes {arg('1')} MB a day")
    route = AS_DECLARED.format(ptp="10", other="21", asks="no", waits="yes")
    planned = plan("r", read(text), observed(route))
    assert len(planned.actions) == 1
    assert planned.notes == ()
