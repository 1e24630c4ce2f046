"""Assumptions of engine and emulated router about RouterOS that no manual or recording confirms.

Code that depends on one names it in a comment or docstring line, `Assumption: <id>`. `provision device verify` shows
which of them hold on a real device. A row is removed when a document or a recorded reply confirms it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from atlantis_netcfg.core.messages import arg, msg

READS: Final = "by reading"
"""Assumption shown by reading: `provision device verify` reads the device."""
TRY: Final = "needs --try"
"""Assumption that needs scratch rows under safe mode: `provision device verify --try`."""
SILENCE: Final = "needs --silence"
"""Assumption that needs a scratch row and ten minutes of silence: `provision device verify --try --silence`."""


@dataclass(frozen=True, slots=True)
class Assumption:
    """One unconfirmed assumption."""

    id: str
    sentence: str
    rests: str
    """What depends on the assumption, and the consequence if it is wrong."""
    proof: str
    """READS, TRY, SILENCE, or `needs a person: …`."""


def person(what: str) -> str:
    """Return the text of an assumption that only a person can check."""
    return f"needs a person: {what}"


ASSUMPTIONS: Final = (
    # The API.
    Assumption(
        "api-flight-100",
        "A device answers 100 `print` commands in flight on one session.",
        "Reading in one round trip; a device that falls silent is read again in flights of 24, which is told.",
        READS,
    ),
    Assumption(
        "api-flight-24",
        "A device answers 24 commands in flight on one session, writes among them.",
        "Writing row by row where scripts cannot be used; a device that falls silent ends the run, which is undone.",
        TRY,
    ),
    Assumption(
        "api-tagged-order",
        "Tagged commands of one flight are executed in the order in which they were sent.",
        "Counters that are read first and last, the latest holder of safe mode; writes do not rest on it.",
        TRY,
    ),
    Assumption(
        "api-unknown-property",
        "A property in `.proplist` that the device's version does not have is left out, not refused.",
        "One question for all versions; a refusal would end every run with the device unchanged.",
        READS,
    ),
    Assumption(
        "api-count-only",
        "`print count-only` answers the number of rows with `!done`.",
        "Reading back by counts after a small change; without a number everything is read again.",
        READS,
    ),
    Assumption(
        "api-query-order",
        "The words `?<comment=text` and `?>comment=text` of a query compare texts letter by letter.",
        "Reading our rows of a menu without those of others over a satellite; else more is read than is needed.",
        READS,
    ),
    Assumption(
        "api-sessions-newest-last",
        "`/user/active` lists sessions oldest first.",
        "Which address the guard takes for the technician's; another one would guard the wrong path.",
        READS,
    ),
    Assumption(
        "api-ids-grow",
        "The `.id` of a new row is greater than every earlier one of its menu, and no `.id` is used twice.",
        "A row that was read is the row that is changed, also when somebody else works on the device.",
        TRY,
    ),
    Assumption(
        "api-silent-session",
        "A session that falls silent is noticed within twelve minutes, after about nine.",
        "How long a run waits for a device to take back by itself what a dead session held.",
        SILENCE,
    ),
    Assumption(
        "tls-version",
        "api-ssl speaks TLS 1.2, whose handshake takes two round trips, and no newer one.",
        "Estimates of round trips; with TLS 1.3 a session costs one less than told.",
        READS,
    ),
    Assumption(
        "api-login-pipelined",
        "Commands that are sent before the login is answered are refused.",
        "The emulated router alone; the engine waits for the answer.",
        person("send login and one `print` in one packet, with a client that can"),
    ),
    Assumption(
        "api-limit-words",
        "Before the login a session takes 8 sentences and words of 1,024 bytes at most.",
        "The emulated router alone; the engine sends one short sentence.",
        person("send longer and more sentences before the login, with a client that can"),
    ),
    Assumption(
        "api-sensitive",
        "To a user who may not see secrets the API leaves them out or hides them.",
        "A declared secret is not written again only because it cannot be seen.",
        person("read `/ppp secret` and a Wi-Fi key as a user without the policy `sensitive`"),
    ),
    Assumption(
        "api-ping-path",
        "`/tool/ping` answers over the API on every version.",
        "Proofs and looks at links; where it is missing they are inconclusive.",
        READS,
    ),
    # Scripts.
    Assumption(
        "execute-error-text",
        "`/execute as-string` gives the words of an error as the end of its output, not as `!trap`.",
        "Which action of a script was refused; with a trap the output is lost and the device is read back.",
        TRY,
    ),
    Assumption(
        "execute-stops",
        "A script of `/execute` stops at its first error, and executes nothing after it.",
        "Later actions of a layer do not run when an earlier one was refused.",
        TRY,
    ),
    Assumption(
        "on-event-60k",
        "`on-event` of a job of the scheduler takes 60,000 bytes, as a script of `/execute` does.",
        "The dead-man job of a large change; it is read back, and a shortened one refuses the change.",
        TRY,
    ),
    Assumption(
        "first-versions",
        "What the first published trees (7.9) show and RouterOS 6 lacks came with 7.0 or 7.9: `as-string`, `/file add`,"
        " `/console inspect`, and arguments of OpenVPN and netwatch.",
        "The emulated router of 7.0 to 7.8; the engine reads what a device refuses.",
        person("type `/execute` and `/console inspect` with Tab on RouterOS 7.0 to 7.8"),
    ),
    Assumption(
        "slash-words-6",
        "RouterOS 6 refuses a path written with slashes by `expected command name`.",
        "The emulated router of RouterOS 6; the engine writes paths with spaces there.",
        person("type `/ip/address/print` on RouterOS 6"),
    ),
    # Safe mode and other protection.
    Assumption(
        "safe-mode-counts-rows",
        "Each row that a script changes is one entry of the history, as if it had been typed alone.",
        "How many changes go under one safe mode: 82 of the 100 that it remembers; fewer entries do no harm.",
        TRY,
    ),
    Assumption(
        "safe-mode-undoes-scripts",
        "Safe mode takes back what a script of `/execute` has changed, as it does single commands.",
        "Every protected change; what stays is found by reading back, and put back by the run.",
        TRY,
    ),
    Assumption(
        "safe-mode-close",
        "A session that closes is noticed at once: what it held in safe mode is undone within ten seconds.",
        "How soon an interrupted run may be repeated; a longer wait is told.",
        TRY,
    ),
    Assumption(
        "safe-mode-second-taker",
        "While a session holds safe mode another one that takes it is refused, and the first goes on holding it.",
        "Two technicians at one device; the run reads `current` before it trusts its own safe mode.",
        TRY,
    ),
    Assumption(
        "safe-mode-current",
        "`current` of `/safe-mode` is false as soon as its history overflowed and the session has left safe mode.",
        "Whether a change is still protected: it is read with every turn of writing, beside the count of 82 entries.",
        person("take safe mode over the API, change one comment 101 times, print `/safe-mode` and `/system/history`"),
    ),
    Assumption(
        "safe-mode-idle",
        "A session that is silent over a good link for as long as a proof lasts stays open, and holds safe mode.",
        "Proofs from a second session; a session that is lost meanwhile takes the change back, which is told.",
        person("take safe mode over the API, wait ten minutes without a word, and print `/safe-mode` there"),
    ),
    Assumption(
        "safe-mode-power-loss",
        "What was in safe mode when the power failed is undone after the start.",
        "Nothing: both outcomes are rehearsed, the device is read, and what stayed is put back.",
        person("take safe mode, add a comment to a port, pull the plug, and look after the start"),
    ),
    Assumption(
        "dead-man-after-silence",
        "A dead-man job that runs after a dead session's safe mode was undone changes nothing.",
        "Protection before 7.18, where safe mode of a console and a job stand together.",
        person("on RouterOS below 7.18: hold safe mode over SSH, pull the cable, and wait for both"),
    ),
    Assumption(
        "scheduler-interval",
        "A job with `interval` alone runs so long after it was added, also when NTP moves the clock meanwhile.",
        "When the dead-man job takes a change back.",
        person("add a job with `interval=5m`, set the clock back by a day, and wait"),
    ),
    Assumption(
        "scheduler-forbidden",
        "Where device-mode forbids the scheduler a job is refused, or is shown as inactive when it is read.",
        "A job that never runs is not taken for a protection: it is read back after it was added.",
        person("add a job to a device whose device-mode forbids the scheduler, and print it"),
    ),
    Assumption(
        "routing-rule-chains",
        "From 7.22 `policy-rules` of `/routing/settings` is the order in which the chains of routing rules are asked.",
        "The guard finds the way of our answers; a chain that is not named there is taken for one that nobody asks.",
        person("add a rule with `chain=x action=drop` for an address, and ping that with and without `x` there"),
    ),
    # What is shown.
    Assumption(
        "history-names-ids",
        "The commands of `/system/history` name a row by its `.id`.",
        "Who has changed a row that drifted; otherwise nothing is said of it.",
        READS,
    ),
    Assumption(
        "history-newest-first",
        "`/system/history` lists the newest entry first.",
        "Which change of a row is told as the latest one.",
        READS,
    ),
    Assumption(
        "netwatch-values",
        "`/tool/netwatch` shows intervals as `10s` or `00:00:10`, and shares as a number with or without `%`.",
        "Comparing declared rows of netwatch; another form would be told as drift.",
        READS,
    ),
    Assumption(
        "board-hw-offload",
        "Boards keep `hw-offload` of the filter and `suppress-hw-offload` of routes in 7.21, which lost them on CHR.",
        "These two are left as they are on the device.",
        person("type `/ip firewall filter add hw-offload` with Tab on a board with 7.21 or later"),
    ),
    Assumption(
        "wireless-supplicant-identity",
        "A wireless security profile keeps the identity that the router had when the profile was made.",
        "The value is left as it is on the device.",
        person("change the identity, and print `/interface wireless security-profiles` before and after"),
    ),
    Assumption(
        "console-columns",
        "A menu of which no transcript is published prints its first arguments as columns.",
        "The emulated console, for people; the engine reads by `as-value` and over the API.",
        person("compare `print` of the menu on a device"),
    ),
    Assumption(
        "console-first-login",
        "A console asks a newcomer for licence, default configuration and password in this order, loses what is typed"
        " before its prompt, waits five seconds for a terminal to say what it is, and ignores unknown login flags.",
        "First contact, which answers the questions in any order.",
        person("adopt a device out of its box over its serial line, and keep the transcript"),
    ),
    Assumption(
        "factory-cpe",
        "A box of one port and a radio comes with address and DHCP server on the port, without a bridge.",
        "The rehearsal of a first contact with such boxes.",
        person("export a new box before anything is set"),
    ),
    Assumption(
        "sftp-policy",
        "A transfer over SFTP needs the policy `ftp`.",
        "The emulated router; adopted users have the policy.",
        person("upload a file as a user without the policy `ftp`"),
    ),
    Assumption(
        "refusal-words",
        "What a device refuses beyond a single value it refuses in words like the published ones.",
        "The emulated router's texts; the engine shows the device's own words, and reads few of them.",
        person("send back the journal of a run in which a device has refused something"),
    ),
    Assumption(
        "port-counters",
        "A port's byte counter has 54 bytes for a segment besides its payload, and nothing for acknowledgements.",
        "The rehearsed bill of a metered link; a real bill uses the device's own counters.",
        person("compare `/interface print stats` with a capture of one session"),
    ),
    Assumption(
        "arp-entry",
        "A neighbour that answers is always in `/ip arp`.",
        "A rehearsed look at the links; on a device a ping goes before it.",
        person("read `/ip arp` an hour after the last packet to the neighbour"),
    ),
    Assumption(
        "upgrade-free-flash",
        "A device installs packages when 512 KiB of its flash are free beside their files.",
        "Whether a set is sent to a device with little flash; it keeps the old version where it cannot install.",
        person("upgrade a device with 16 MB of flash, and read `free-hdd-space` before and after"),
    ),
    # Certificates and the VPN.
    Assumption(
        "certificate-import",
        "A certificate is not imported a second time, and a key without its certificate not at all.",
        "The rehearsal of a router's VPN; on a device the rows are read after the import.",
        person("import the same certificate twice, and a key alone, and print `/certificate`"),
    ),
    Assumption(
        "ovpn-import",
        "`import-ovpn-configuration` takes the options that the manual names, refuses any other and everything with it,"
        " and makes a disabled interface.",
        "The rehearsal of a router's VPN; on a device the interface is read after the import.",
        person("import a file with an unknown option, and one with none, and print what was made"),
    ),
    # Links and what watches them.
    Assumption(
        "failover-recursion",
        "With the pilot's routes a canary's blackhole keeps its default route from being resolved over another"
        " link, and no packet leaves with the address of the wrong link after a fail-back.",
        "Failover between the links of a site; docs/links.md says how it is tried on a quay.",
        person("pull each link in turn, and read routes and connections: docs/links.md"),
    ),
    Assumption(
        "netwatch-rhythm",
        "Netwatch counts its interval from the beginning of a test, runs the state's script before the test's, adds"
        " `start-delay` to `startup-delay`; a next hop that cannot be resolved is neither asked nor given up.",
        "The rehearsed moments of a failover; none is declared to the second.",
        person("log from each script, and compare the times with the row"),
    ),
    Assumption(
        "use-job-from-1970",
        "A job of the scheduler with an interval and a start on 1970-01-01 runs at every interval, whatever the clock"
        " says, and for the first time within two minutes of a start of the router.",
        "The end of a link's use; where the job does not run, the link stays in use until a person ends it.",
        person("add such a job that logs, set the clock back and forth, restart the router, and read the log"),
    ),
    Assumption(
        "connection-reply-address",
        "`reply-dst-address` of `/ip firewall connection` is the address, a colon and the port.",
        "Connections begin anew when their link is left; in another form they stay on the link that is gone.",
        person("print `/ip firewall connection` while something is connected"),
    ),
    Assumption(
        "use-uptime-compares",
        "In a script `[/system resource get uptime]` is a time, and `<` and `>=` compare it with a time like `5400s`.",
        "The end of a link's use; a script that fails here ends nothing and logs an error every ten seconds.",
        person("type `:put ([/system resource get uptime] >= 5400s)` on a router and see `true` or `false`"),
    ),
    Assumption(
        "lte-pin-words",
        "`pin-status` of a modem says in the words of 3GPP TS 27.007 whether it asks for a PIN.",
        "Whether a PIN is sent; after any other words none is.",
        READS,
    ),
    Assumption(
        "lte-pin-once",
        "A modem enters its stored PIN once whenever it starts or the PIN is changed; `show-capabilities` and refused"
        " bands are told as the emulated modem tells them.",
        "A wrong PIN costs one try; it is taken back before it can be entered again.",
        person("store a wrong PIN for a spare SIM, and read the tries that are left"),
    ),
    Assumption(
        "poe-load",
        "A load on a port shows as `powered-on` with its figures, and a lease is bound as long as its device is there.",
        "Rehearsed readings of what a router feeds; on a device they are read.",
        person("read `/interface ethernet poe monitor` with a known load"),
    ),
    Assumption(
        "radio-levels",
        "A registration shows its level as `-48dBm@6Mbps` with the package `wireless`, and as `-48` with `wifi`.",
        "Levels of both ends of a bridge; in another form a level is unreadable, which is told.",
        person("print the registration table of a connected radio of either package"),
    ),
    Assumption(
        "radio-restart",
        "A radio starts anew after every change but that of comment, name and ARP, hears down to -85 dBm, and registers"
        " within three seconds.",
        "The rehearsed change of a bridge; on a device both ends are awaited for minutes.",
        person("change one setting at a time, and watch the registration table"),
    ),
    # What the device's own parser says of a plan, and what it offers.
    Assumption(
        "parse-words",
        "`:parse` answers on every version as recorded on 7.20.8 to 7.23.3: with code where it takes a command, else"
        " with"
        " the words of the mistake in the place of the rest.",
        "Refusing a plan before it is sent; each script ends with a command that has to be refused, and without that"
        " refusal"
        " the verdict is inconclusive.",
        READS,
    ),
    Assumption(
        "console-ambiguous",
        "A name of an argument that is cut so short that several begin like it is refused as one that nobody has.",
        "The emulated router's console; the engine writes names in full.",
        READS,
    ),
    Assumption(
        "parse-nested",
        "Within a script `:execute` with `as-string` gives its output, as it does over the API.",
        "Only refusals come back of a plan that is parsed; otherwise the verdict is inconclusive.",
        READS,
    ),
    Assumption(
        "inspect-whole",
        "`/console/inspect` offers a list of up to 30 words whole, and queries pick among its rows.",
        "Looking up words of closed lists; a word that is not found is looked for in the whole list before it is"
        " refused.",
        READS,
    ),
    Assumption(
        "offered-without-hardware",
        "A device offers the words of a radio's or modem's menu whole where no radio or modem is in it.",
        "Refusing a plan before it is sent; a list that lacks a declared word refuses the plan.",
        person("type `/interface lte apn add ip-type=` with Tab on a device without a modem"),
    ),
    Assumption(
        "offered-values",
        "A version offers for an argument the words that 7.21.5 offers, and asks `add` for the arguments that the"
        " nearest"
        " recorded version asks for.",
        "The emulated router alone; the engine looks at what a device offers and refuses.",
        person("type an argument with Tab on another version, and `add` without arguments"),
    ),
    Assumption(
        "settings-computed",
        "Settings show fast path and fasttrack as one flag and two counters, and RoMON's own id while it is off.",
        "Bytes that the emulated router counts; the engine drops what it has not asked for.",
        person("print `/ip settings`, `/ipv6 settings` and `/tool romon`"),
    ),
    Assumption(
        "name-in-routes",
        "A new name of an interface shows at once in the gateway of a route that names it.",
        "Renaming ports; where it does not hold, what is read back differs, and the device takes the change back.",
        TRY,
    ),
    Assumption(
        "port-new-name",
        "A new name of a port shows at once in every other row that refers to it, parents of queues too, and moves no"
        " packet.",
        "Renaming ports; where it does not hold, what is read back differs, and the device takes the change back.",
        person("rename an unused port that a bridge port and a queue name, and print both"),
    ),
)
"""All assumptions, in the order of the page docs/engineers/assumptions.md."""


def summarize_assumptions() -> str:
    """Return the line of a rehearsal that counts its assumptions."""
    page = "docs/engineers/assumptions.md"
    return msg(f"{arg(len(ASSUMPTIONS))} assumptions about RouterOS that no document or record confirms: {arg(page)}")
