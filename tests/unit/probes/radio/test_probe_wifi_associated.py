from __future__ import annotations

from radio_cases import BSSID, NOBODY, Case, card, check, codes, info, linked, pings, printed, rules, stations, way
from row_subtests import for_each_row

from atlantis_netcfg.checklist.probes import Answer, CommandResult, Place, RunProgram, Trouble
from atlantis_netcfg.checklist.probes.wifi import AssociatedProbe, read_link, read_station
from atlantis_netcfg.core.reading_programs import allowed
from atlantis_netcfg.declaration.model import WifiEndpoint

HEALTHY: dict[str, Answer] = {
    "link": linked(),
    "stations": stations(),
    "info": info(),
    "rules": rules("PT"),
    "addr": card(),
    "route": way(),
    "ping": pings(),
}
UP = "PASS associated: wlan1 of the gateway is associated with `EXAMPLE-SPARUS` of Sparus, heard with -52 dBm"
ANSWERS = "PASS answers: Sparus (10.70.2.1) answers 20 of 20 pings, in 3.2 ms"
SILENT = "FAIL silent: Sparus (10.70.2.1) answers none of 20 pings"
OVERDRIVEN = "wlan1 of the gateway hears Sparus with {} dBm, above -35 dBm: its receiver is overdriven"


def heard(level: int) -> dict[str, CommandResult]:
    return {"link": linked(signal=f"{level} dBm"), "stations": stations(f"{level} dBm", f"{level} dBm")}


def up(level: int) -> str:
    return UP.replace("-52", str(level))


CASES = (
    Case(
        "healthy",
        (UP, ANSWERS),
        evidence=(
            f"read access point heard by wlan1 of the gateway: EXAMPLE-SPARUS ({BSSID.upper()})",
            "read channel of wlan1 of the gateway: 5500 MHz",
            "read signal at wlan1 of the gateway: -52 dBm",
            "read chains of wlan1 of the gateway: -54, -55 dBm",
            "read rate sent at by wlan1 of the gateway: 130 Mbit/s",
            "read rate received at by wlan1 of the gateway: 144.4 Mbit/s",
            "declared signal wanted: -75 to -35 dBm",
            "measured pings answered by Sparus from the gateway: 20 of 20",
            "measured round trip to Sparus from the gateway, mean: 3.2 ms",
            "measured round trip to Sparus from the gateway, longest: 6.4 ms",
        ),
    ),
    Case(
        "healthy, by a kernel that tells less, as a port of a bridge",
        (UP, ANSWERS),
        {"stations": printed(""), "rules": printed(""), "route": way("br0"), "addr": card(more='"master":"br0",')},
    ),
    Case(
        "healthy, on 2.4 GHz, by iw 6 that has fractions",
        (UP, ANSWERS),
        {"link": linked(mhz="2437.0"), "info": info(channel="6 (2437 MHz), width: 20 MHz, center1: 2437 MHz")},
    ),
    Case("healthy, told by the MAC address", (UP, ANSWERS), endpoint={"ssid": None, "mac": BSSID}),
    Case("healthy, at the declared rate", (UP, ANSWERS), endpoint={"rate_mbps": 100.0}),
    # sick
    Case(
        "weak",
        (up(-79), "WARN signal-weak: wlan1 of the gateway hears Sparus with -79 dBm, below -75 dBm", ANSWERS),
        heard(-79),
    ),
    Case(
        "far too weak",
        (up(-88), "FAIL signal-weak: wlan1 of the gateway hears Sparus with -88 dBm, below -75 dBm", ANSWERS),
        heard(-88),
    ),
    Case("too strong", (up(-30), f"WARN signal-strong: {OVERDRIVEN.format(-30)}", ANSWERS), heard(-30)),
    Case("far too strong", (up(-19), f"FAIL signal-strong: {OVERDRIVEN.format(-19)}", ANSWERS), heard(-19)),
    Case("on the lower bound", (up(-75), ANSWERS), heard(-75)),
    Case("on the upper bound", (up(-35), ANSWERS), heard(-35)),
    Case(
        "one antenna is off",
        (
            UP,
            "WARN chain-imbalance: the chains of wlan1 of the gateway hear Sparus 26 dB apart, more than 6 dB",
            ANSWERS,
        ),
        {"stations": stations("-52 [-54, -80] dBm")},
    ),
    Case(
        "sends too slowly",
        (UP, "FAIL rate-low: wlan1 of the gateway sends to Sparus at 6.5 Mbit/s, below 24 Mbit/s", ANSWERS),
        {"link": linked(tx="6.5 MBit/s MCS 0")},
        {"rate_mbps": 24.0},
    ),
    Case(
        "received a frame of management last",
        (UP, "WARN rate-low: wlan1 of the gateway last received from Sparus at 6 Mbit/s, below 24 Mbit/s", ANSWERS),
        {"link": linked(rx="6.0 MBit/s")},
        {"rate_mbps": 24.0},
    ),
    Case(
        "one ping in ten is lost",
        (UP, "WARN loss: Sparus (10.70.2.1) answers 18 of 20 pings: 10 % are lost, above 5 %"),
        {"ping": pings(18)},
    ),
    Case(
        "half of the pings are lost",
        (UP, "FAIL loss: Sparus (10.70.2.1) answers 10 of 20 pings: 50 % are lost, above 5 %"),
        {"ping": pings(10)},
    ),
    Case(
        "slow",
        (
            UP,
            "PASS answers: Sparus (10.70.2.1) answers 20 of 20 pings, in 410.5 ms",
            "WARN slow: Sparus answers after 410.5 ms in the mean, above 100 ms",
        ),
        {"ping": pings(mean=410.5)},
    ),
    Case("associated, and the vehicle is silent", (UP, SILENT), {"ping": pings(0)}),
    Case(
        "associated, and the gateway finds nobody",
        (UP, f"{SILENT}; 10.70.2.2 says: Destination Host Unreachable"),
        {"ping": pings(0, more="From 10.70.2.2 icmp_seq=1 Destination Host Unreachable\n")},
    ),
    Case(
        "the way leads elsewhere",
        (UP, "FAIL other-way: packets to Sparus (10.70.2.1) leave by eth0, and not by wlan1 of the gateway"),
        {"route": way("eth0")},
    ),
    Case(
        "no way at all",
        (UP, "FAIL no-route: the gateway has no route to Sparus (10.70.2.1)"),
        {"route": printed("", 2, "RTNETLINK answers: Network is unreachable\n")},
    ),
    Case(
        "a channel for indoors",
        (UP, "WARN channel-indoors: Sparus is on 5260 MHz: 5250-5350 MHz is for indoor use only", ANSWERS),
        {"link": linked(mhz="5260")},
    ),
    Case(
        "a band that nobody agreed on",
        (UP, "WARN band: Sparus is on 5975 MHz, which is neither 2.4 nor 5 GHz", ANSWERS),
        {"link": linked(mhz="5975")},
    ),
    Case(
        "the rules of another country",
        (UP, "WARN country-differs: the radio of the gateway obeys the rules of US, and the pilot is in PT", ANSWERS),
        {"rules": rules("PT", "US")},
    ),
    Case(
        "the rules of no country",
        (
            UP,
            "WARN country-unset: the radio of the gateway obeys the rules of no single country, and the pilot is in PT",
            ANSWERS,
        ),
        {"rules": rules("00")},
    ),
    Case(
        "a stranger uses its name",
        (
            (
                "FAIL other-radio: 04:F0:21:45:12:9A sends as `EXAMPLE-SPARUS` of Sparus, and the radio of Sparus is"
                " 02:00:5E:00:01:99"
            ),
        ),
        endpoint={"mac": "02:00:5E:00:01:99"},
    ),
    Case(
        "nothing is declared by which to tell",
        (UP, "WARN whose-unknown: nothing tells whether `EXAMPLE-SPARUS` is the access point of Sparus", ANSWERS),
        endpoint={"ssid": None},
    ),
    Case(
        "no address is known",
        (UP, "WARN no-address: no address of Sparus is known here: loss and round trip were not measured"),
        probe={"address": None},
    ),
    # absent
    Case(
        "not associated",
        ("FAIL not-associated: wlan1 of the gateway is not associated with `EXAMPLE-SPARUS` of Sparus",),
        {"link": printed("Not connected.\n"), "stations": printed(""), "ping": pings(0)},
        evidence=("read access point heard by wlan1 of the gateway: none", "declared signal wanted: -75 to -35 dBm"),
    ),
    Case(
        "the gateway is an access point itself",
        ("FAIL no-client: wlan1 of the gateway is no client of an access point, but of type AP",),
        {"link": printed("Not connected.\n"), "info": info("AP")},
    ),
    Case(
        "no such interface",
        ("FAIL no-interface: the gateway has no interface wlan1",),
        {
            "addr": printed("", 1, 'Device "wlan1" does not exist.\n'),
            "link": printed("", 237, "command failed: No such device (-19)\n"),
        },
    ),
    Case(
        "an interface that is no radio",
        ("FAIL no-radio: wlan1 of the gateway is not a radio",),
        {"link": printed("", 237, "command failed: No such device (-19)\n")},
    ),
    Case(
        "a kernel without radios",
        ("FAIL no-radio: the gateway has no radio that its kernel knows",),
        {"link": printed("", 1, "nl80211 not found.\n")},
    ),
    Case(
        "switched off",
        ("FAIL interface-off: wlan1 of the gateway is switched off",),
        {"addr": card('"BROADCAST","MULTICAST"')},
    ),
    Case(
        "iw is not installed",
        ("INCONCLUSIVE program-missing: the gateway has no program `iw`",),
        {"link": CommandResult(Trouble.MISSING, "iw")},
    ),
    Case(
        "the gateway is not reached",
        ("INCONCLUSIVE not-asked: the gateway could not be asked: coastal-gateway: connection timed out",),
        dict.fromkeys(HEALTHY, NOBODY),
    ),
    Case(
        "nothing was answered at all",
        ("INCONCLUSIVE not-asked: the gateway could not be asked: it does not answer",),
        {"addr": CommandResult(Trouble.UNREACHABLE)},
    ),
    # garbage
    Case(
        "words that nobody understands",
        ("INCONCLUSIVE association-unknown: `iw` says of wlan1 of the gateway what nobody understands: Verbunden mit",),
        {"link": printed("Verbunden mit\n")},
    ),
    Case(
        "no words at all, and JSON that is none",
        ("INCONCLUSIVE association-unknown: `iw` says of wlan1 of the gateway what nobody understands: nothing",),
        {"link": printed(""), "addr": printed("{]"), "route": printed("[1]")},
    ),
    Case(
        "a driver without a level and without rates",
        (
            UP.removesuffix(", heard with -52 dBm"),
            "INCONCLUSIVE signal-unknown: wlan1 of the gateway does not say how well it hears Sparus",
            "INCONCLUSIVE rate-unknown: wlan1 of the gateway does not say at which rate it is associated with Sparus",
            ANSWERS,
        ),
        {"link": linked(signal="0 dBm", rx="(unknown)", tx="(unknown)"), "stations": printed("")},
        {"rate_mbps": 24.0},
    ),
    Case(
        "ping says what nobody understands",
        (
            UP,
            (
                "INCONCLUSIVE ping-not-understood: no ping was sent to Sparus (10.70.2.1) from the gateway: ping:"
                " socket: Operation not permitted"
            ),
        ),
        {"ping": printed("", 2, "ping: socket: Operation not permitted\n")},
    ),
    # slow
    Case(
        "ping does not end",
        (UP, "INCONCLUSIVE program-slow: `ping` did not come to an end in time on the gateway"),
        {"ping": CommandResult(Trouble.SILENT, "20 s")},
    ),
    # in use by another vehicle
    Case(
        "the radio is at another vehicle",
        (
            (
                "INCONCLUSIVE other-association: wlan1 of the gateway is associated with `EXAMPLE-MARES`, and a radio"
                " hears one access point at a time: `EXAMPLE-SPARUS` cannot be judged"
            ),
        ),
        {"link": linked("EXAMPLE-MARES")},
    ),
)


def probe(case: Case) -> AssociatedProbe:
    declared = {"role": "access_point", "interface": "wlan1", "ssid": "EXAMPLE-SPARUS", **case.endpoint}
    made = {"address": "10.70.2.1", "country": "portugal", **case.probe}
    return AssociatedProbe("Sparus", Place.GATEWAY, WifiEndpoint.model_validate(declared), **made)


@for_each_row("case", CASES, ids=str)
def test_judged(case: Case) -> None:
    check(case, probe(case), HEALTHY)


def test_every_code_has_its_case() -> None:
    assert codes(CASES) == {
        "answers",
        "associated",
        "association-unknown",
        "band",
        "chain-imbalance",
        "channel-indoors",
        "country-differs",
        "country-unset",
        "interface-off",
        "loss",
        "no-address",
        "no-client",
        "no-interface",
        "no-radio",
        "no-route",
        "not-asked",
        "not-associated",
        "other-association",
        "other-radio",
        "other-way",
        "ping-not-understood",
        "program-missing",
        "program-slow",
        "rate-low",
        "rate-unknown",
        "signal-strong",
        "signal-unknown",
        "signal-weak",
        "silent",
        "slow",
        "whose-unknown",
    }


def test_everything_that_is_asked_is_on_the_list() -> None:
    asked = [one for one in probe(CASES[0]).asks() if isinstance(one, RunProgram)]
    assert all(allowed(one.argv) for one in asked)
    assert [" ".join(one.argv) for one in asked] == [
        "iw dev wlan1 link",
        "iw dev wlan1 station dump",
        "iw dev wlan1 info",
        "iw reg get",
        "ip -j addr show dev wlan1",
        "ip -j route get 10.70.2.1",
        "ping -n -c 20 -i 0.2 -W 2 10.70.2.1",
    ]
    assert {one.name for one in asked} == set(HEALTHY)


def test_a_name_in_any_script_is_read() -> None:
    link = read_link(linked(ssid=r"Praia do Norte caf\xc3\xa9").out)
    assert link is not None
    assert link.ssid == "Praia do Norte café"


def test_of_several_stations_the_right_one_is_read() -> None:
    two = stations("-80 dBm", "-80 dBm", "02:00:5e:00:01:77").out + stations().out
    station = read_station(two, BSSID.upper())
    assert station is not None
    assert station.signal_dbm == -52
    assert read_station(two, "02:00:5E:00:01:78") is None
