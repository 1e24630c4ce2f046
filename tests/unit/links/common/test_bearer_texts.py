"""Whatever a device writes, a reader neither fails nor makes a number of what is none."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from atlantis_netcfg.links.lte import routeros
from atlantis_netcfg.links.lte.judge import LteSubscription
from atlantis_netcfg.links.lte.judge import judge as judge_lte
from atlantis_netcfg.links.status import decibels, megabits, percent, seconds, whole, yes
from atlantis_netcfg.links.wifi import Family, WifiSettings, judge, link_state, quality, read

WORDS = st.one_of(
    st.text(max_size=20),
    st.sampled_from(
        ["lte1", "N/A", "", "-48dBm@6Mbps", "54.0Mbps-20MHz/1S", "0", "yes", "connected", "running-ap", "-97dBm"]
    ),
)
FIELDS = st.sampled_from(
    [
        *("signal-strength", "signal", "signal-strength-ch0", "signal-strength-ch9", "signal-to-noise", "tx-rate"),
        *("rx-rate", "tx-ccq", "rx-ccq", "uptime", "authorized", "status", "state", "channel", "registered-clients"),
        *("mac-address", "radio-name", "bssid", "interface", "overall-tx-ccq", "tx-signal-strength"),
        *("rsrp", "rsrq", "sinr", "rssi", "nr-rsrp", "pin-status", "registration-status", "functionality", "roaming"),
        *("current-operator", "primary-band", "earfcn", "data-class", "access-technology", "disabled", "apn-profiles"),
        *("name", "apn", "use-network-apn", "address", "invalid", "message"),
    ]
)
ROWS = st.dictionaries(FIELDS, WORDS, max_size=8)
TABLES = st.none() | st.lists(ROWS, max_size=3)
WANTED = WifiSettings(peer="b", access_point=True, ssid="s", protocol="nv2", frequency_mhz=5500)


@given(st.sampled_from(Family), TABLES, st.none() | ROWS)
def test_any_radio_reply_is_handled(
    family: Family, table: list[dict[str, str]] | None, monitor: dict[str, str] | None
) -> None:
    found = read(family, table, monitor)
    assert all(one.hint for one in judge(found, WANTED))
    assert link_state(found)
    shown = quality(found, WANTED)
    assert not [name for name, value in shown.items() if name.endswith("_dbm") and value == 0]


@given(st.none() | ROWS, TABLES, TABLES, TABLES, TABLES)
def test_any_modem_reply_is_handled(
    monitor: dict[str, str] | None,
    interfaces: list[dict[str, str]] | None,
    profiles: list[dict[str, str]] | None,
    addresses: list[dict[str, str]] | None,
    log: list[dict[str, str]] | None,
) -> None:
    found = routeros.read(monitor, interfaces, profiles, addresses, log)
    assert all(one.hint for one in judge_lte(found, LteSubscription(apn="umts")))
    assert all(value is None or value < 0 for value in (found.rsrp_dbm, found.rssi_dbm))


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        *(("-97dBm", -97.0), ("-48dBm@6Mbps", -48.0), (" -72 ", -72.0), ("-72.5 dBm", -72.5), ("-9dB", None)),
        *((text, None) for text in ("", None, "N/A", "97", "0", "-200", "dBm", "-97dBm-98dBm", "--97", "-97 dBW")),
    ],
)
def test_levels(text: str | None, expected: float | None) -> None:
    assert decibels(text, -120.0, -1.0) == expected


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        *(("54.0Mbps-20MHz/1S", 54.0), ("144.4Mbps", 144.4), ("1.2Gbps", 1200.0), ("500kbps", 0.5)),
        *(("286800000", 286.8), ("11000000bps", 11.0)),
        *((text, None) for text in ("", None, "N/A", "0Mbps", "54", "fast", "54Mb", "-6Mbps")),
    ],
)
def test_rates(text: str | None, expected: float | None) -> None:
    assert megabits(text) == expected


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        *(("6h24m21s", 23061.0), ("0ms", 0.0), ("1w2d", 777600.0), ("00:15:54", 954.0), ("1d00:00:01", 86401.0)),
        *(("1.5s", 1.5), *((text, None) for text in ("", None, "N/A", "never", "6h 24m", "12", "m"))),
    ],
)
def test_intervals(text: str | None, expected: float | None) -> None:
    assert seconds(text) == expected


def test_counts_percentages_and_booleans() -> None:
    assert [percent(text) for text in ("90", "90%", "0", "101", "N/A", None)] == [90.0, 90.0, 0.0, None, None, None]
    assert [whole(text) for text in ("3", "0", "-1", "3.0", "³", None)] == [3, 0, None, None, None, None]
    assert [yes(text) for text in ("yes", "True", "no", "false", "", "N/A", None)] == [
        *(True, True, False, False),
        *(None, None, None),
    ]
