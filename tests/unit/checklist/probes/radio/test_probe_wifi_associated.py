from radio_cases import (
    BSSID,
    NOBODY,
    Case,
    card,
    check,
    codes,
    info,
    linked,
    listed,
    pings,
    printed,
    rules,
    stations,
    way,
)
from row_subtests import for_each_row

from atlantis_netcfg.checklist.probes import Answer, CommandResult, Place, RunProgram, Trouble
from atlantis_netcfg.checklist.probes.wifi import AssociatedProbe, read_link, read_station
from atlantis_netcfg.core.reading_programs import is_allowed
from atlantis_netcfg.inventory.model import WifiEndpoint

HEALTHY: dict[str, Answer] = {
    "link": linked(),
    "stations": stations(),
    "info": info(),
    "rules": rules("PT"),
    "addr": card(),
    "route": way(),
    "ping": pings(),
}
SILENT = "FAIL silent: Sparus (10.70.2.1) answers none of 20 pings"


def heard(level: int) -> dict[str, CommandResult]:
    return {"link": linked(signal=f"{level} dBm"), "stations": stations(f"{level} dBm", f"{level} dBm")}


LISTED = listed(__file__)
CASES = (
    Case("healthy"),
    Case(
        "healthy, by a kernel that tells less, as a port of a bridge",
        {"stations": printed(""), "rules": printed(""), "route": way("br0"), "addr": card(more='"master":"br0",')},
    ),
    Case(
        "healthy, on 2.4 GHz, by iw 6 that has fractions",
        {"link": linked(mhz="2437.0"), "info": info(channel="6 (2437 MHz), width: 20 MHz, center1: 2437 MHz")},
    ),
    Case("healthy, told by the MAC address", endpoint={"ssid": None, "mac": BSSID}),
    Case("healthy, at the declared rate", endpoint={"rate_mbps": 100.0}),
    # sick
    Case("weak", heard(-79)),
    Case("far too weak", heard(-88)),
    Case("too strong", heard(-30)),
    Case("far too strong", heard(-19)),
    Case("on the lower bound", heard(-75)),
    Case("on the upper bound", heard(-35)),
    Case("one antenna is off", {"stations": stations("-52 [-54, -80] dBm")}),
    Case("sends too slowly", {"link": linked(tx="6.5 MBit/s MCS 0")}, {"rate_mbps": 24.0}),
    Case("received a frame of management last", {"link": linked(rx="6.0 MBit/s")}, {"rate_mbps": 24.0}),
    Case("its rate of sending is not known", {"link": linked(tx="(unknown)")}, {"rate_mbps": 24.0}),
    Case("one ping in ten is lost", {"ping": pings(18)}),
    Case("half of the pings are lost", {"ping": pings(10)}),
    Case("slow", {"ping": pings(mean=410.5)}),
    Case("associated, and the vehicle is silent", {"ping": pings(0)}),
    Case(
        "associated, and the gateway finds nobody",
        {"ping": pings(0, more="From 10.70.2.2 icmp_seq=1 Destination Host Unreachable\n")},
    ),
    Case("the way leads elsewhere", {"route": way("eth0")}),
    Case("no way at all", {"route": printed("", 2, "RTNETLINK answers: Network is unreachable\n")}),
    Case("a channel for indoors", {"link": linked(mhz="5260")}),
    Case("a band that nobody agreed on", {"link": linked(mhz="5975")}),
    Case("the rules of another country", {"rules": rules("PT", "US")}),
    Case("the rules of no country", {"rules": rules("00")}),
    Case("the rules of another country for an unknown one", {"rules": rules("US")}, probe={"country": "later"}),
    Case("a stranger uses its name", endpoint={"mac": "02:00:5E:00:01:99"}),
    Case("nothing is declared by which to tell", endpoint={"ssid": None}),
    Case("no address is known", probe={"address": None}),
    # absent
    Case("not associated", {"link": printed("Not connected.\n"), "stations": printed(""), "ping": pings(0)}),
    Case("the gateway is an access point itself", {"link": printed("Not connected.\n"), "info": info("AP")}),
    Case(
        "no such interface",
        {
            "addr": printed("", 1, 'Device "wlan1" does not exist.\n'),
            "link": printed("", 237, "command failed: No such device (-19)\n"),
        },
    ),
    Case("an interface that is no radio", {"link": printed("", 237, "command failed: No such device (-19)\n")}),
    Case("a kernel without radios", {"link": printed("", 1, "nl80211 not found.\n")}),
    Case("switched off", {"addr": card('"BROADCAST","MULTICAST"')}),
    Case("iw is not installed", {"link": CommandResult(Trouble.MISSING, "iw")}),
    Case("the gateway is not reached", dict.fromkeys(HEALTHY, NOBODY)),
    Case("nothing was answered at all", {"addr": CommandResult(Trouble.UNREACHABLE)}),
    # garbage
    Case("words that nobody understands", {"link": printed("Verbunden mit\n")}),
    Case(
        "no words at all, and JSON that is none", {"link": printed(""), "addr": printed("{]"), "route": printed("[1]")}
    ),
    Case(
        "a driver without a level and without rates",
        {"link": linked(signal="0 dBm", rx="(unknown)", tx="(unknown)"), "stations": printed("")},
        {"rate_mbps": 24.0},
    ),
    Case("ping says what nobody understands", {"ping": printed("", 2, "ping: socket: Operation not permitted\n")}),
    # slow
    Case("ping does not end", {"ping": CommandResult(Trouble.SILENT, "20 s")}),
    # in use by another vehicle
    Case("the radio is at another vehicle", {"link": linked("EXAMPLE-MARES")}),
)


def probe(case: Case) -> AssociatedProbe:
    declared = {"role": "access_point", "interface": "wlan1", "ssid": "EXAMPLE-SPARUS", **case.endpoint}
    made = {"address": "10.70.2.1", "country": "portugal", **case.probe}
    return AssociatedProbe("Sparus", Place.GATEWAY, WifiEndpoint.model_validate(declared), **made)


@for_each_row("case", CASES, ids=str)
def test_findings_match_the_case(case: Case) -> None:
    check(case, LISTED, probe(case), HEALTHY)


def test_every_code_has_its_case() -> None:
    assert list(LISTED) == [case.name for case in CASES]
    assert codes(LISTED) == {
        *("answers", "associated", "association-unknown", "band", "chain-imbalance", "channel-indoors"),
        *("country-differs", "country-unset", "interface-off", "loss", "no-address", "no-client"),
        *("no-interface", "no-radio", "no-route", "not-asked", "not-associated", "other-association"),
        *("other-radio", "other-way", "ping-not-understood", "program-missing", "program-slow", "rate-low"),
        *("rate-unknown", "signal-strong", "signal-unknown", "signal-weak", "silent", "slow", "whose-unknown"),
    }


def test_every_program_is_allowed() -> None:
    asked = [one for one in probe(CASES[0]).asks() if isinstance(one, RunProgram)]
    assert all(is_allowed(one.argv) for one in asked)
    assert [" ".join(one.argv) for one in asked] == [
        *("iw dev wlan1 link", "iw dev wlan1 station dump", "iw dev wlan1 info", "iw reg get"),
        *("ip -j addr show dev wlan1", "ip -j route get 10.70.2.1", "ping -n -c 20 -i 0.2 -W 2 10.70.2.1"),
    ]
    assert {one.name for one in asked} == set(HEALTHY)


def test_a_name_in_any_script_is_read() -> None:
    link = read_link(linked(ssid=r"Praia do Norte caf\xc3\xa9").out)
    assert link is not None
    assert link.ssid == "Praia do Norte café"


def test_matching_station_is_read() -> None:
    two = stations("-80 dBm", "-80 dBm", "02:00:5e:00:01:77").out + stations().out
    station = read_station(two, BSSID.upper())
    assert station is not None
    assert station.signal_dbm == -52
    assert read_station(two, "02:00:5E:00:01:78") is None
