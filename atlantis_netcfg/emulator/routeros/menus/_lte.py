"""`/interface/lte`: the modem, its APN profiles, the settings of all modems.

Names and words: RouterOS' command trees; defaults: Manual, LTE/5G, and public verbose exports of 7.19 and 7.20.
`allow-roaming`, `modem-init` and `network-mode` can be unset; the device writes the first one when it finds a modem.
"""

from __future__ import annotations

from atlantis_netcfg.emulator.routeros.menus._model import COMMENT, DISABLED, Arg, Menu, Select, Shape, Unique
from atlantis_netcfg.emulator.routeros.values import Bool, Choice, Choices, Int, Pattern, Ref, Refs, Text, Time

_NUMBERS = Pattern(r"|\d{1,3}(,\d{1,3})*")

_APN = Menu(
    "/interface/lte/apn",
    Shape.LIST,
    (
        Arg("name", Text(empty=False), ""),
        Arg("add-default-route", Bool(), "yes"),
        Arg("apn", Text(longest=100), "internet"),
        Arg("authentication", Choice(("chap", "none", "pap")), "none"),
        COMMENT,
        Arg("default-route-distance", Int(0, 255), "2"),
        Arg("ip-type", Choice(("auto", "ipv4", "ipv6")), "auto"),
        Arg("ipv6-interface", Ref(("interface",), ("none",))),
        Arg("passthrough-interface", Ref(("interface",), ("none",))),
        Arg("passthrough-mac", Text()),
        Arg("passthrough-subnet-size", Choice(("32", "auto"))),
        Arg("password", Text(), "", secret=True),
        Arg("use-network-apn", Bool(), "yes"),
        Arg("use-peer-dns", Bool(), "yes"),
        Arg("user", Text(), ""),
    ),
    noun="apn profile",
    space="lte-apn",
    unique=(Unique(("name",), "failure: item with such name already exists"),),
    factory=({"name": "default"},),
    builtin_flag="default",
    select=Select.DEFAULT,
)

_LTE = Menu(
    "/interface/lte",
    Shape.FIXED,
    (
        Arg("name", Text(empty=False), ""),
        Arg("allow-roaming", Bool()),
        Arg("apn-profiles", Refs(Ref(("lte-apn",))), "default"),
        Arg("band", _NUMBERS, ""),
        COMMENT,
        DISABLED,
        Arg("modem-init", Text()),
        Arg("mtu", Int(68, 65535), "1500"),
        Arg("network-mode", Choices(("3g", "5g", "gsm", "lte"), ordered=False)),
        Arg("nr-band", _NUMBERS, ""),
        Arg("operator", Pattern(r"|\d{5,6}"), ""),
        Arg("pin", Text(), "", secret=True),
        Arg("sms-protocol", Choice(("at", "auto", "mbim")), "auto"),
        Arg("sms-read", Bool(), "yes"),
    ),
    noun="lte",
    space="interface",
    unique=(Unique(("name",), "failure: already have interface with such name"),),
    flags=("running", "inactive"),
    select=Select.DEFAULT_NAME,
)

_SETTINGS = Menu(
    "/interface/lte/settings",
    Shape.SETTINGS,
    (
        Arg("esim-channel", Choice(("at", "auto")), "auto"),
        Arg("firmware-path", Text(), "firmware"),
        Arg("info-polling-interval", Time(), "0s"),
        Arg("link-recovery-timer", Int(), "120"),
        Arg("mode", Choice(("auto", "mbim", "serial", "user")), "auto"),
    ),
    noun="lte settings",
)

MENUS = (_APN, _LTE, _SETTINGS)
