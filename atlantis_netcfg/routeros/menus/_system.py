"""`/system`, `/user`, `/tool` and `/certificate`: the box itself, who may enter, and what it tells."""

from __future__ import annotations

from atlantis_netcfg.core.versions import Version
from atlantis_netcfg.routeros._types import Layer
from atlantis_netcfg.routeros.menus._model import (
    COMMENT,
    DISABLED,
    Menu,
    Shape,
    boolean,
    keep,
    number,
    policy,
    prefix,
    prefixes,
    secret,
    sequence,
    since,
    text,
    texts,
    time,
    unread,
    until,
    usual,
    words,
)

_NOBODY = "0.0.0.0"  # noqa: S104 - what the device prints where no address is set

_IDENTITY = Menu("/system/identity", Shape.SINGLETON, Layer.FOUNDATION, fields=(text("name", "MikroTik"),))

_CLOCK = Menu(
    "/system/clock",
    Shape.SINGLETON,
    Layer.FOUNDATION,
    # `date` and `time` go on by themselves and are nothing to declare.
    fields=(boolean("time-zone-autodetect", "yes"), *usual(text("time-zone-name", "manual"))),
)

_NOTE = Menu(
    "/system/note",
    Shape.SINGLETON,
    Layer.FOUNDATION,
    fields=(
        text("note"),
        *since("7.14", boolean("show-at-cli-login")),
        *usual(boolean("show-at-login", "yes")),
    ),
)

_LOGGING_ACTION = Menu(
    "/system/logging/action",
    Shape.LIST,
    Layer.FOUNDATION,
    keys=("name",),
    subject="{name}",
    flags=("default",),
    stock=(("memory",), ("disk",), ("echo",), ("remote",)),
    row_defaults={name: {"target": name} for name in ("memory", "disk", "echo", "remote")},
    inert=True,
    fields=(
        text("name", None),
        text("target", "memory"),
        COMMENT,
        number("memory-lines", "1000"),
        boolean("memory-stop-on-full"),
        number("disk-file-count", "2"),
        text("disk-file-name", "log"),
        number("disk-lines-per-file", "1000"),
        boolean("disk-stop-on-full"),
        number("remote-port", "514"),
        text("syslog-facility", "daemon"),
        text("syslog-severity", "auto"),
        text("syslog-time-format", "bsd-syslog"),
        text("email-to"),
        *usual(prefix("remote", _NOBODY), prefix("src-address", _NOBODY), boolean("remember", "yes")),
        *keep(text("email-start-tls")),
        *until("7.18", boolean("bsd-syslog")),
        *since("7.18", text("remote-log-format", "default"), text("remote-protocol", "udp")),
        *since("7.18", *keep(text("cef-event-delimiter"))),
        *since("7.19.6", text("vrf", "main")),
    ),
)

_LOGGING = Menu(
    "/system/logging",
    Shape.LIST,
    Layer.ATTACHMENT,
    keys=("topics", "action", "prefix"),
    subject="{topics} to {action}",
    flags=("default", "invalid"),
    inert=True,
    stock=(("info", "memory", ""), ("error", "memory", ""), ("warning", "memory", ""), ("critical", "echo", "")),
    fields=(
        words("topics", "info"),
        text("action", "memory"),
        text("prefix"),
        *since("7.17", text("regex")),
        DISABLED,
    ),
)

_NTP_CLIENT = Menu(
    "/system/ntp/client",
    Shape.SINGLETON,
    Layer.ATTACHMENT,
    # `servers` shows the rows of the menu below.
    fields=(
        boolean("enabled"),
        *since("7.0", text("mode", "unicast"), *keep(sequence("servers")), text("vrf", "main")),
    ),
)

_NTP_SERVERS = Menu(
    "/system/ntp/client/servers",
    Shape.LIST,
    Layer.ATTACHMENT,
    since=Version(7, 0),
    keys=("address",),
    subject="{address}",
    flags=("dynamic",),
    fields=(
        text("address", None),
        COMMENT,
        DISABLED,
        *usual(boolean("iburst", "yes"), number("max-poll", "10"), number("min-poll", "6")),
        *keep(text("auth-key")),
    ),
)

_GROUP = Menu(
    "/user/group",
    Shape.LIST,
    Layer.FOUNDATION,
    keys=("name",),
    subject="{name}",
    stock=(("read",), ("write",), ("full",)),
    inert=True,
    fields=(text("name", None), COMMENT, *keep(policy("policy")), text("skin", "default")),
)

_USER = Menu(
    "/user",
    Shape.LIST,
    Layer.ATTACHMENT,
    keys=("name",),
    subject="{name}",
    is_exported=False,
    fields=(
        text("name", None),
        text("group", None),
        secret(unread(text("password"))),
        COMMENT,
        DISABLED,
        prefixes("address"),
        *since("7.16", *keep(text("inactivity-policy"), time("inactivity-timeout"))),
    ),
)

_CERTIFICATE = Menu(
    "/certificate",
    Shape.LIST,
    Layer.FOUNDATION,
    keys=("name",),
    subject="{name}",
    flags=("fingerprint", "private-key", "expired", "invalid-before", "invalid-after"),
    readonly=True,
    is_exported=False,
    fields=texts("name common-name subject-alt-name"),
)

_TOOLS = (
    Menu("/tool/mac-server", Shape.SINGLETON, Layer.CLEANUP, fields=(text("allowed-interface-list", "all"),)),
    Menu(
        "/tool/mac-server/mac-winbox", Shape.SINGLETON, Layer.CLEANUP, fields=(text("allowed-interface-list", "all"),)
    ),
    Menu("/tool/mac-server/ping", Shape.SINGLETON, Layer.CLEANUP, fields=(boolean("enabled", "yes"),)),
    Menu(
        "/tool/bandwidth-server",
        Shape.SINGLETON,
        Layer.CLEANUP,
        fields=(
            boolean("enabled", "yes"),
            boolean("authenticate", "yes"),
            number("allocate-udp-ports-from", "2000"),
            number("max-sessions", "100"),
            *since("7.18", prefixes("allowed-addresses4"), prefixes("allowed-addresses6")),
        ),
    ),
)

_SCHEDULER = Menu(
    "/system/scheduler",
    Shape.LIST,
    # Before the routes that it puts back.
    Layer.ATTACHMENT,
    keys=("name",),
    subject="{name}",
    fields=(
        text("name", None),
        COMMENT,
        DISABLED,
        time("interval", "0s"),
        text("on-event"),
        *keep(text("start-date"), text("start-time"), policy("policy")),
    ),
)

MENUS = (
    *(_IDENTITY, _CLOCK, _NOTE, _LOGGING_ACTION, _LOGGING, _NTP_CLIENT, _NTP_SERVERS),
    *(_GROUP, _USER, _CERTIFICATE, _SCHEDULER),
    *_TOOLS,
)
