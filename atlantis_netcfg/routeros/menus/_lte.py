"""`/interface/lte`: the modem of the board, its APN profiles, the settings of all modems.

Defaults: Manual, LTE/5G, and public verbose exports of 7.19 and 7.20. Roaming is off unless a row says otherwise.
`pin` is a field of its own kind: the device keeps it and enters it whenever the modem starts, and the SIM counts wrong
ones, so that it is only sent while the SIM asks for one (routeros/pin.py).
"""

from __future__ import annotations

from atlantis_netcfg.routeros._types import Layer
from atlantis_netcfg.routeros.menus._model import (
    COMMENT,
    DISABLED,
    Menu,
    Shape,
    boolean,
    interface,
    keep,
    like,
    number,
    on_prompt,
    secret,
    sequence,
    since,
    text,
    time,
    usual,
    words,
)

_APN = Menu(
    "/interface/lte/apn",
    Shape.LIST,
    Layer.FOUNDATION,
    keys=("name",),
    subject="{name}",
    stock=(("default",),),
    inert=True,
    named_by=("apn-profiles",),
    fields=(
        text("name"),
        COMMENT,
        boolean("add-default-route", "yes"),
        text("apn", "internet"),
        text("authentication", "none"),
        number("default-route-distance", "2"),
        text("ip-type", "auto"),
        secret(text("password")),
        boolean("use-network-apn", "yes"),
        boolean("use-peer-dns", "yes"),
        text("user"),
        *keep(
            interface("ipv6-interface"),
            interface("passthrough-interface"),
            text("passthrough-mac"),
            text("passthrough-subnet-size"),
        ),
    ),
)

_LTE = Menu(
    "/interface/lte",
    Shape.FIXED,
    Layer.FOUNDATION,
    keys=("default-name",),
    subject="{default-name}",
    flags=("running", "inactive"),
    fields=(
        interface("default-name"),
        like("default-name", interface("name")),
        COMMENT,
        DISABLED,
        boolean("allow-roaming"),
        sequence("apn-profiles", "default"),
        words("band"),
        on_prompt(secret(text("pin"))),
        *usual(number("mtu", "1500"), words("nr-band"), text("operator")),
        *keep(text("modem-init"), words("network-mode")),
        *since("7.13", *keep(boolean("sms-read"))),
        *since("7.16", *keep(text("sms-protocol"))),
    ),
)

_SETTINGS = Menu(
    "/interface/lte/settings",
    Shape.SINGLETON,
    Layer.FOUNDATION,
    fields=(
        *usual(text("firmware-path", "firmware"), text("mode", "auto")),
        *since("7.13", *keep(time("info-polling-interval"))),
        *since("7.17", *usual(text("esim-channel", "auto"))),
        *since("7.19", *usual(number("link-recovery-timer", "120"))),
    ),
)

MENUS = (_APN, _LTE, _SETTINGS)
