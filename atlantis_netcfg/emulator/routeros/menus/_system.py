"""The system's own settings, logging, scheduler, users.

Values and defaults: Manual, CLI reference of each menu; Manual, Log; Manual, NTP; Manual, User; Manual, Scheduler;
verbose exports of RouterOS 7.19.
"""

from __future__ import annotations

from atlantis_netcfg.emulator.routeros.menus._model import (
    COMMENT,
    DISABLED_ARG,
    Arg,
    EmulatedMenu,
    Select,
    Shape,
    Unique,
    of_schema,
)
from atlantis_netcfg.emulator.routeros.schema import offered_values
from atlantis_netcfg.emulator.routeros.values import (
    Address,
    AddressesValue,
    Bool,
    Choice,
    Choices,
    Int,
    Moment,
    PolicySet,
    Prefixes,
    Ref,
    Text,
    Time,
    Topics,
)

POLICIES = (
    "local",
    "telnet",
    "ssh",
    "ftp",
    "reboot",
    "read",
    "write",
    "policy",
    "test",
    "winbox",
    "password",
    "web",
    "sniff",
    "sensitive",
    "api",
    "romon",
    "rest-api",
)
"""What a group may do, in the order in which RouterOS prints it."""

_VRF = Arg("vrf", Ref(("table",)), "main")
_HOST = Address(dns=True)
_DISK = ("target", "disk")
_REMOTE = ("target", "remote")
_MEMORY = ("target", "memory")
_EMAIL = ("target", "email")
_UNIQUE_NAME = Unique(("name",), "failure: item with such name already exists")

_LOGGING = of_schema(
    "/system/logging",
    noun="logging rule",
    local=(
        Arg("action", Ref(("action",)), "memory", always=True),
        Arg("topics", Topics(offered_values("/system/logging", "topics")), "info", always=True),
    ),
    factory=(
        {"topics": "info", "action": "memory"},
        {"topics": "error", "action": "memory"},
        {"topics": "warning", "action": "memory"},
        {"topics": "critical", "action": "echo"},
    ),
    flags=("invalid",),
    builtin_flag="default",
)

_ACTION = of_schema(
    "/system/logging/action",
    noun="logging action",
    local=(
        Arg("bsd-syslog", Bool(), "no", shown_if=_REMOTE),
        Arg("cef-event-delimiter", Text(), "\\r\\n", shown_if=("remote-log-format", "cef")),
        Arg("disk-file-count", Int(1, 65535), "2", shown_if=_DISK),
        Arg("disk-file-name", Text(), "log", shown_if=_DISK),
        Arg("disk-lines-per-file", Int(1, 65535), "1000", shown_if=_DISK),
        Arg("disk-stop-on-full", Bool(), "no", shown_if=_DISK),
        Arg("email-start-tls", Bool(), "no", shown_if=_EMAIL),
        Arg("email-to", Text(), "", shown_if=_EMAIL),
        Arg("memory-lines", Int(1, 65535), "1000", shown_if=_MEMORY),
        Arg("memory-stop-on-full", Bool(), "no", shown_if=_MEMORY),
        Arg("name", Text(empty=False), is_required=True),
        Arg("remember", Bool(), "yes", shown_if=("target", "echo")),
        Arg("remote", _HOST, "0.0.0.0", shown_if=_REMOTE),  # noqa: S104 - RouterOS' default, not a bind address
        Arg("remote-log-format", Choice(("cef", "default", "syslog")), "default", shown_if=_REMOTE),
        Arg("remote-port", Int(1, 65535), "514", shown_if=_REMOTE),
        Arg("remote-protocol", Choice(("tcp", "udp")), "udp", shown_if=_REMOTE),
        Arg("src-address", Address(), "0.0.0.0", shown_if=_REMOTE),  # noqa: S104 - RouterOS' default
        Arg(
            "syslog-facility",
            Choice(offered_values("/system/logging/action", "syslog-facility")),
            "daemon",
            shown_if=_REMOTE,
        ),
        Arg(
            "syslog-severity",
            Choice(offered_values("/system/logging/action", "syslog-severity")),
            "auto",
            shown_if=_REMOTE,
        ),
        Arg("syslog-time-format", Choice(("bsd-syslog", "iso8601")), "bsd-syslog", shown_if=_REMOTE),
        Arg("target", Choice(("disk", "echo", "email", "memory", "remote")), is_required=True, always=True),
        Arg("vrf", Ref(("table",)), "main", shown_if=_REMOTE),
    ),
    space="action",
    unique=(_UNIQUE_NAME,),
    factory=(
        {"name": "memory", "target": "memory"},
        {"name": "disk", "target": "disk"},
        {"name": "echo", "target": "echo"},
        {"name": "remote", "target": "remote"},
    ),
    builtin_flag="default",
    first_id=0,
)

_SCHEDULER = EmulatedMenu(
    "/system/scheduler",
    Shape.LIST,
    (
        COMMENT,
        DISABLED_ARG,
        Arg("interval", Time(), "0s"),
        Arg("name", Text(empty=False), ""),
        Arg("on-event", Text(), ""),
        Arg("policy", Choices(POLICIES), "", always=True),
        Arg("start-date", Moment()),
        Arg("start-time", Moment(words=("startup",)), always=True),
    ),
    noun="schedule",
    unique=(_UNIQUE_NAME,),
)

_USER = of_schema(
    "/user",
    noun="user",
    kinds={"address": Prefixes(many=True)},
    local=(
        Arg("group", Ref(("group",)), is_required=True),
        Arg("inactivity-policy", Choice(("lockscreen", "logout", "none")), "none"),
        Arg("inactivity-timeout", Time(60, 86400), "10m"),
        Arg("name", Text(empty=False), is_required=True),
        Arg("password", Text(), "", never=True),
    ),
    unique=(Unique(("name",), "failure: user with the same name already exists"),),
    flags=("expired",),
    is_exported=False,
)

_READ = "local,telnet,ssh,reboot,read,test,winbox,password,web,sniff,sensitive,api,romon,rest-api"
_WRITE = "local,telnet,ssh,reboot,read,write,test,winbox,password,web,sniff,sensitive,api,romon,rest-api"
_NOTHING = ",".join(f"!{policy}" for policy in POLICIES)
_GROUP = of_schema(
    "/user/group",
    noun="user group",
    local=(Arg("name", Text(empty=False), ""), Arg("policy", PolicySet(POLICIES), _NOTHING)),
    space="group",
    unique=(_UNIQUE_NAME,),
    factory=(
        {"name": "read", "policy": _READ},
        {"name": "write", "policy": _WRITE},
        {"name": "full", "policy": ",".join(POLICIES)},
    ),
    select=Select.NAME,
)

_CERTIFICATE = of_schema(
    "/certificate",
    noun="certificate",
    local=(
        Arg("common-name", Text(), ""),
        Arg("country", Text(), ""),
        Arg("days-valid", Int(), "365"),
        Arg("digest-algorithm", Choice(("md5", "sha1", "sha256", "sha384", "sha512")), "sha256"),
        Arg("key-size", Text(), "2048"),
        Arg("key-usage", Text(), ""),
        Arg("locality", Text(), ""),
        Arg("name", Text(empty=False), ""),
        Arg("organization", Text(), ""),
        Arg("state", Text(), ""),
        Arg("subject-alt-name", Text(), ""),
        Arg("trust-store", Text(), "all"),
        Arg("trusted", Bool(), "no"),
        Arg("unit", Text(), ""),
    ),
    space="certificate",
    unique=(_UNIQUE_NAME,),
    flags=("authority", "crl", "expired", "private-key"),
    is_exported=False,
)

_SETTINGS = (
    of_schema("/system/identity", noun="system identity", kinds={"name": Text(empty=False)}),
    of_schema(
        "/system/clock",
        noun="clock settings",
        kinds={"time-zone-name": Choice(("manual", *offered_values("/system/clock", "time-zone-name")))},
        local=(
            Arg("date", Moment(), never=True, is_exported=False),
            Arg("time", Moment(), never=True, is_exported=False),
        ),
    ),
    of_schema(
        "/system/ntp/client",
        noun="ntp client",
        kinds={"mode": Choice(("broadcast", "manycast", "multicast", "unicast"))},
        local=(Arg("servers", AddressesValue(_HOST), "", is_exported=False), _VRF),
    ),
    of_schema(
        "/system/ntp/client/servers",
        noun="ntp server",
        kinds={"max-poll": Int(3, 17), "min-poll": Int(3, 17)},
        local=(Arg("address", _HOST, is_required=True, always=True), Arg("auth-key", Text(), "none")),
        name_property="address",
        unique=(Unique(("address",), "failure: already have such entry"),),
        flags=("dynamic",),
    ),
    of_schema("/system/note", noun="system note", factory=({"show-at-login": "no"},)),
)

MENUS = (*_SETTINGS, _ACTION, _LOGGING, _SCHEDULER, _USER, _GROUP, _CERTIFICATE)
