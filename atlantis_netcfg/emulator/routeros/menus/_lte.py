"""`/interface/lte`: the modem, its APN profiles, the settings of all modems.

Names and words: RouterOS' command trees; defaults: Manual, LTE/5G, and public verbose exports of 7.19 and 7.20.
`allow-roaming`, `modem-init` and `network-mode` can be unset; the device writes the first one when it finds a modem.
"""

from __future__ import annotations

from atlantis_netcfg.emulator.routeros.menus._model import (
    Arg,
    Select,
    Unique,
    of_schema,
)
from atlantis_netcfg.emulator.routeros.values import Bool, Choice, Choices, Int, Pattern, Ref, Refs, Text, Time

_NUMBERS = Pattern(r"|\d{1,3}(,\d{1,3})*")

_APN = of_schema(
    "/interface/lte/apn",
    noun="apn profile",
    kinds={
        "name": Text(empty=False),
        "apn": Text(longest=100),
        "authentication": Choice(("chap", "none", "pap")),
        "default-route-distance": Int(0, 255),
        "ip-type": Choice(("auto", "ipv4", "ipv6")),
        "ipv6-interface": Ref(("interface",), ("none",)),
        "passthrough-interface": Ref(("interface",), ("none",)),
        "passthrough-subnet-size": Choice(("32", "auto")),
    },
    space="lte-apn",
    unique=(Unique(("name",), "failure: item with such name already exists"),),
    factory=({"name": "default"},),
    builtin_flag="default",
    select=Select.DEFAULT,
)

_LTE = of_schema(
    "/interface/lte",
    noun="lte",
    kinds={
        "apn-profiles": Refs(Ref(("lte-apn",))),
        "band": _NUMBERS,
        "mtu": Int(68, 65535),
        "network-mode": Choices(("3g", "5g", "gsm", "lte"), is_ordered=False),
        "nr-band": _NUMBERS,
        "operator": Pattern(r"|\d{5,6}"),
    },
    local=(
        Arg("name", Text(empty=False), ""),
        Arg("allow-roaming", Bool()),
        Arg("sms-protocol", Choice(("at", "auto", "mbim")), "auto"),
        Arg("sms-read", Bool(), "yes"),
    ),
    without=("default-name",),
    space="interface",
    unique=(Unique(("name",), "failure: already have interface with such name"),),
    flags=("running", "inactive"),
    select=Select.DEFAULT_NAME,
)

_SETTINGS = of_schema(
    "/interface/lte/settings",
    noun="lte settings",
    kinds={"esim-channel": Choice(("at", "auto")), "mode": Choice(("auto", "mbim", "serial", "user"))},
    local=(Arg("info-polling-interval", Time(), "0s"),),
)

MENUS = (_APN, _LTE, _SETTINGS)
