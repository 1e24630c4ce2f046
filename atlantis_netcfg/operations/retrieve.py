"""Retrieval of recordings from a gateway or robot to the control centre: plan, cost, status.

The transfer itself runs on the gateway (`templates/gateway/retrieval.py`): it continues without the technician's
connection. This module inspects it, sets its rate and cap, starts, watches and stops it. The gateway reports a file as
arrived only after the control centre has read it again. Files of a robot are first collected by the gateway, over the
LAN, which costs nothing; if the robot leaves meanwhile, the gateway waits some minutes.
"""

from __future__ import annotations

import json
import math
import shlex
import subprocess
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any, Final

from atlantis_netcfg.computers.retrieval import PROGRAM, line_for_robot, sources_of
from atlantis_netcfg.core import errors
from atlantis_netcfg.core.messages import arg, join, msg
from atlantis_netcfg.inventory import model
from atlantis_netcfg.links.cost import Bill, Preview, bill, preview, size
from atlantis_netcfg.operations.common.session_link import FAST_S, site_link_of
from atlantis_netcfg.operations.common.site_links import link_of
from atlantis_netcfg.operations.computers._access import computer_access, key_trouble
from atlantis_netcfg.operations.computers.remote_session import ssh_command

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from atlantis_netcfg.inventory import Host, Inventory
    from atlantis_netcfg.links.cost import MeteredLink
    from atlantis_netcfg.operations.common.request import Request

SHARES: Final[Mapping[model.RetrievalPriority, float]] = {
    model.RetrievalPriority.LOW: 0.2,
    model.RetrievalPriority.NORMAL: 0.5,
    model.RetrievalPriority.HIGH: 0.8,
}
"""Share of the link's declared upload rate by priority."""
WIRE: Final = 1.2
"""Wire overhead as the gateway's program counts it: TCP, IP and VPN headers, acknowledgements, some losses."""
SILENCE_S: Final = 120
"""Maximum silence of a connection in seconds: a satellite link may be silent for 70 s."""
_CONNECTION: Final = 12_000
"""Bytes of one SSH connection before its first file; a transfer without errors has three connections."""
_ROW: Final = 250
"""Bytes of metadata per file, both directions."""
_SPARE: Final = 1.25
"""Multiple of the expected volume at which the transfer stops; the excess allows for repeated connections."""
_ANSWER_S: Final = 300.0
_NO_PROGRAM: Final = "can't open file"
_ACTIVE_STATES: Final = ("collecting", "sending", "waiting")
Source = model.RetrievalSource | model.RetrievalRobot


class GatewayAway(errors.DeviceError):
    """The gateway was not reached; nothing was changed on it."""


class BeginningUnknown(errors.OutcomeUnknown):
    """The start was requested, and the gateway's response did not arrive."""


class NotBegun(errors.DeviceError):
    """The gateway refused to start and gave the reason."""


def source_at(inventory: Inventory, site: str, name: str | None) -> tuple[Source, Host]:
    """Return the only or the named source of a site, and its gateway; raise NoMatchError or UsageError."""
    if inventory.pilot.retrieval is None:
        raise errors.NoMatchError(
            "the inventory has no recordings to retrieve",
            hint="set `retrieval:` in group_vars/all/pilot.yml: docs/gateways.md has an example",
        )
    if site not in inventory.sites:
        near = errors.nearest(site, inventory.sites)
        site_names = msg(f"sites: {arg(join(', ', inventory.sites))}")
        raise errors.UsageError(
            f"`site={arg(site)}`: recordings are retrieved from one site at a time",
            hint=f"did you mean `site={arg(near)}`? {arg(site_names)}" if near else site_names,
        )
    sources = {
        source.name: source for host in inventory.site_hosts(site) for source in sources_of(inventory, host.name)
    }
    if not sources:
        raise errors.NoMatchError(
            f"the inventory has no recordings of {arg(site)} to retrieve",
            hint="add one of its gateways to `retrieval.sources` in group_vars/all/pilot.yml",
        )
    choices = msg(f"choose one of these: {arg(join(', ', (f'`from={each}`' for each in sources)))}")
    if name is None and len(sources) > 1:
        raise errors.UsageError(f"{arg(site)} has recordings of several computers", hint=choices)
    source_name = next(iter(sources)) if name is None else name
    source = sources.get(source_name)
    if source is None:
        near = errors.nearest(source_name, sources)
        raise errors.UsageError(
            f"`from={arg(source_name)}`: the inventory has no recordings of it at {arg(site)}",
            hint=f"did you mean `from={arg(near)}`? {arg(choices)}" if near else choices,
        )
    return source, inventory.hosts[source.host]


@dataclass(frozen=True, slots=True)
class RetrievalSelection:
    """A person's selection of files from a folder."""

    pattern: str = "*"
    again: bool = False
    """Also compare recordings that were retrieved before."""

    def as_dict(self) -> dict[str, Any]:
        """Return the selection in the form of the gateway's program."""
        return {"pattern": self.pattern, "again": self.again}


@dataclass(frozen=True, slots=True)
class RobotLook:
    """The gateway's view of a robot's folder."""

    name: str
    gateway: str
    state: str
    """`answers`, or `away`: then its folder was not read."""
    files: int
    """Number of files to collect from the robot first."""
    bytes: int
    lacking: int
    """Bytes of free space that the gateway lacks for these files."""
    why: str = ""

    def lines(self) -> list[str]:
        """Return the lines to show before a transfer."""
        if self.state != "answers":
            return [msg(f"{arg(self.name)} was not searched: {arg(self.why)}")]
        if not self.files:
            return []
        return [
            msg(
                f"{arg(_files(self.files))} on {arg(self.name)}, {arg(size(self.bytes))}: {arg(self.gateway)} collects "
                "these first"
            )
        ]

    def as_dict(self) -> dict[str, Any]:
        """Return JSON-able data."""
        return {name: getattr(self, name) for name in ("state", "files", "bytes", "lacking", "why")}


def robot_look(source: Source, look: Mapping[str, Any]) -> RobotLook | None:
    """Return the gateway's view of a robot's folder (pure); None if the source is no robot."""
    if not isinstance(source, model.RetrievalRobot):
        return None
    robot_values = look["robot"]
    files, octets, lacking = (int(robot_values[name]) for name in ("files", "bytes", "lacking"))
    return RobotLook(
        source.robot, source.host, robot_values["state"], files, octets, lacking, robot_values.get("why", "")
    )


@dataclass(frozen=True, slots=True)
class RetrievalPlan:
    """The volume and cost of a transfer over the active link, before it starts."""

    link: MeteredLink
    site_link: model.Link
    priority: model.RetrievalPriority
    look: Mapping[str, Any]
    """The gateway's report about its folder."""
    rtt_max_s: float | None
    """A response that takes longer came over another link, which is metered; None: there is no such link."""
    robot: RobotLook | None = None
    """None: the recordings are the gateway's own."""

    @property
    def files(self) -> int:
        """The number of files to send or compare."""
        return int(self.look["files"])

    @property
    def rate_bps(self) -> int:
        """The transfer's share of the link's rate in the inventory."""
        return round(SHARES[self.priority] * self.site_link.rate.up_kbps * 1000)

    @property
    def wire_bytes(self) -> int:
        """Bytes over the link, both ways."""
        return round((int(self.look["bytes"]) + _ROW * self.files + 3 * _CONNECTION) * WIRE)

    @property
    def seconds(self) -> float:
        """The minimum duration: the link has gaps, and other traffic uses it."""
        return 8 * self.wire_bytes / self.rate_bps + 12 * self.site_link.rate.rtt_ms / 1000

    @property
    def cost(self) -> Preview:
        """The cost of the transfer."""
        return preview(self.wire_bytes, self.seconds, self.link)

    @property
    def cap_bytes(self) -> int | None:
        """The byte limit at which the transfer stops; None over an unmetered link."""
        if not self.link.is_metered:
            return None
        most = round(self.wire_bytes * _SPARE)
        return most if self.link.cap_bytes is None else min(most, self.link.cap_bytes)

    def job(self, selection: RetrievalSelection, number: str) -> dict[str, Any]:
        """Return the job for the gateway."""
        return {
            **selection.as_dict(),
            "before": self.look["before"],
            "agreed_bytes": self.look["bytes"],
            "robot": self.robot.state if self.robot is not None else "none",
            "id": number,
            "link": self.link.name,
            "rate_bps": self.rate_bps,
            "cap_bytes": self.cap_bytes,
            "silence_s": SILENCE_S,
            "rtt_max_s": self.rtt_max_s,
        }

    def lines(self) -> list[str]:
        """Return the lines to show before the start."""
        rate = msg(f"{arg(self.rate_bps / 1000):.0f} kbit/s")
        share = f"{SHARES[self.priority]:.0%}".replace("%", " %")
        return [
            msg(f"{arg(_files(self.files))} to send, {arg(size(int(self.look['bytes'])))}"),
            *(self.robot.lines() if self.robot is not None else ()),
            *left_out(self.look),
            msg(f"{arg(self.cost.words)}, at least {arg(duration(self.seconds))}"),
            msg(
                f"at {arg(rate)}: priority {arg(self.priority.value)} uses {arg(share)} of the rate of "
                f"{arg(self.link.name)} in the inventory"
            ),
        ]

    def as_dict(self) -> dict[str, Any]:
        """Return JSON-able data."""
        counts = {name: self.look[name] for name in ("files", "bytes", "compared", "kept", "writing", "unnamed")}
        robot = {} if self.robot is None else {"robot": self.robot.as_dict()}
        return {
            **counts,
            **robot,
            "rate_bps": self.rate_bps,
            "seconds": round(self.seconds),
            "cost": self.cost.as_dict(),
        }


def plan(inventory: Inventory, source: Source, link: str, look: Mapping[str, Any]) -> RetrievalPlan:
    """Compute the plan (pure); `link` is the link that carries the traffic of the source's site."""
    site = inventory.hosts[source.host].site
    links = inventory.sites[site].bearers
    site_link = next(each for each in links if each.name == link)
    slower = [
        other.rate.rtt_ms
        for other in links
        if other.name != link and other.metered and other.rate.rtt_ms > _APART * site_link.rate.rtt_ms
    ]
    between = math.sqrt(site_link.rate.rtt_ms * min(slower)) / 1000 if slower else None
    robot = robot_look(source, look)
    return RetrievalPlan(link_of(inventory, site, link), site_link, source.priority, look, between, robot)


_APART: Final = 3
"""Ratio from which the round trip times of two links are distinguishable."""


@dataclass(frozen=True, slots=True)
class RetrievalStatus:
    """The status of a transfer, as reported by its gateway."""

    answer: Mapping[str, Any]
    link: MeteredLink | None
    """None: there was no transfer, or its link is no longer in the inventory."""
    source: str = ""
    """Source of the recordings."""

    @property
    def state(self) -> str:
        """The state as reported; `none`: there was no transfer, `lost`: it ended without a report."""
        state = str(self.answer["state"])
        return "lost" if state in _ACTIVE_STATES and not self.runs else state

    @property
    def runs(self) -> bool:
        """Whether the transfer is in progress."""
        return bool(self.answer["running"] or self.answer["job"])

    @property
    def missing_files(self) -> Mapping[str, Sequence[str]]:
        """Files that were not retrieved, by the reason."""
        return {name: paths for name, paths in self.answer.get("left", {}).items() if paths}

    @property
    def whole(self) -> bool:
        """Whether the control centre has read every file again and found it identical."""
        is_complete = self.answer.get("arrived") == self.answer.get("files")
        return self.state == "done" and not self.missing_files and is_complete and not self.answer.get("unseen")

    @property
    def total_cost(self) -> Bill:
        """The cost so far."""
        seconds = max(0.0, self.answer.get("at", 0) - self.answer.get("since", 0))
        tariff = self.link.tariff if self.link is not None and self.link.is_metered else None
        return bill(int(self.answer["wire_bytes"]), seconds, tariff)

    @property
    def exit(self) -> errors.ExitCode:
        """The exit code: done only for a complete transfer."""
        if self.whole:
            return errors.ExitCode.DONE
        if self.state == "none":
            return errors.ExitCode.NOTHING
        return errors.ExitCode.CHECKS_FAILED if self.runs or self.state == "done" else errors.ExitCode.FAILED

    def progress(self) -> str:
        """Return one line of progress."""
        if self.state == "collecting":
            collected_files, files = self.answer.get("collected", 0), _files(int(self.answer.get("collect", 0)))
            why = msg(f": {arg(self.answer['why'])}" if self.answer.get("why") else "")
            here = size(int(self.answer.get("collected_bytes", 0)))
            return msg(
                f"collecting from {arg(self.source)}, {arg(collected_files)} of {arg(files)}, {arg(here)} on the "
                f"gateway{arg(why)}"
            )
        wire, files = size(int(self.answer["wire_bytes"])), self.answer.get("files", 0)
        over = msg(f" over {arg(self.answer['link'])}" if "link" in self.answer else "")
        cost = msg(f", {arg(self.total_cost.money)}" if self.link is not None and self.link.is_metered else "")
        of = msg(
            f"{arg(self.answer.get('arrived', 0))} of {arg(_files(files))} complete, {arg(wire)} "
            f"sent{arg(over)}{arg(cost)}"
        )
        return (
            msg(f"waiting for the control centre, {arg(of)}: {arg(self.answer.get('why'))}")
            if self.state == "waiting"
            else of
        )

    def lines(self, site: str) -> list[str]:
        """Return the status as lines of text."""
        again = msg(
            f"`provision robot retrieve site={arg(site)} from={arg(self.source)}` continues, and sends nothing twice"
        )
        closing = {
            "none": ["nothing was retrieved from here yet"],
            "sending": [msg(f"in progress: {arg(self.progress())}")],
            "collecting": [msg(f"in progress: {arg(self.progress())}")],
            "waiting": [self.progress()],
            "stopped": ["stopped; received files stay at the control centre", again],
            "spent": ["ended: the accepted amount was sent", again],
            "failed": [msg(f"failed: {arg(self.answer.get('why') or 'files differ between the two ends')}"), again],
            "lost": ["ended without notice: the gateway was switched off, or its program failed", again],
        }
        if self.state != "done":
            return [*closing[self.state], *self._left_lines()]
        arrived_files = int(self.answer.get("arrived", 0))
        cost = (
            self.total_cost.words
            if self.link is not None and self.link.is_metered
            else size(self.total_cost.payload_bytes)
        )
        same = msg(f"{arg(_files(arrived_files))}: the same SHA-256 at both ends")
        return [same, *self._left_lines(), msg(f"{arg(cost)} over {arg(self.answer['link'])}")]

    def _left_lines(self) -> list[str]:
        words = {
            "changed": "changed while being sent: run the same command again when it is no longer being written",
            "gone": "no longer exists",
            "differ": "differs at the control centre although it was sent again: check both disks",
            "unread": msg(f"could not be read on {arg(self.source)}, or no longer exists"),
            "robot": msg(f"is still on {arg(self.source)}: {arg(self.answer.get('why') or 'not collected')}"),
        }
        problems = [
            msg(f"{arg(path)}: no longer the same at the control centre") for path in self.answer.get("lost", ())
        ]
        if self.answer.get("unseen"):
            problems.append(msg(f"{arg(self.source)} was not searched: {arg(self.answer['unseen'])}"))
        return [
            *problems,
            *(msg(f"{arg(path)}: {arg(words[name])}") for name, paths in self.missing_files.items() for path in paths),
        ]

    def as_dict(self) -> dict[str, Any]:
        """Return JSON-able data."""
        names = ("id", "link", "files", "bytes", "arrived", "tries", "why", "lost")
        return {
            "state": self.state,
            "runs": self.runs,
            "whole": self.whole,
            "left": dict(self.missing_files),
            "spent": self.total_cost.as_dict(),
            **{name: self.answer[name] for name in names if name in self.answer},
        }


def program_by_ssh(inventory: Inventory, source: Source, request: Request) -> RetrievalProgram:
    """Return the program on a source's gateway, called over SSH."""
    host = inventory.hosts[source.host]
    access = computer_access(inventory, host, request)

    def command(verb: str) -> list[str]:
        line = f"python3 -I {PROGRAM} {verb}"
        return [*ssh_command(access), f"sudo -H -n sh -c {shlex.quote(line)}" if access["become"] else line]

    slow = site_link_of(inventory, host, request.via.get(host.name)).rtt_s >= FAST_S
    return RetrievalProgram(inventory, source, command, slow=slow)


class RetrievalProgram:
    """The program of a gateway for one source; `command` returns the local command for a verb."""

    def __init__(
        self, inventory: Inventory, source: Source, command: Callable[[str], list[str]], *, slow: bool = False
    ) -> None:
        self._declaration, self.source, self.host = inventory, source, inventory.hosts[source.host]
        self._command, self.slow = command, slow

    def look(self, selection: RetrievalSelection) -> dict[str, Any]:
        """Return the files to send; raise GatewayAway or DeviceError."""
        answer = self._ask("look", selection.as_dict())
        if not answer["folder"]:
            raise errors.DeviceError(
                f"{arg(self.host.name)} has no such folder: {arg(answer['place'])}",
                hint="`retrieval.sources` in group_vars/all/pilot.yml sets the folder of the recordings",
            )
        self._refuse_robot(answer)
        return answer

    def _refuse_robot(self, answer: Mapping[str, Any]) -> None:
        """Raise DeviceError, with a text for the robot's owner, if no file can be retrieved from the robot."""
        source, robot = self.source, robot_look(self.source, answer)
        if robot is None or not isinstance(source, model.RetrievalRobot):
            return
        if robot.state == "away" and not answer["files"]:
            hint = "switch it on, connect it to the gateway's LAN, and run the same command again"
            raise errors.DeviceError(f"nothing was collected: {arg(robot.why)}", hint=hint)
        if robot.state == "refused":
            kind = answer["robot"]["kind"]
            line = line_for_robot(self._declaration, source)
            admit = msg(
                f"ask its owner to install rsync, and to add this line to authorized_keys of {arg(source.user)}: "
                f"{arg(line)}"
            )
            trust = msg(f"if it is the robot: set its new key as `host_key` of {arg(robot.name)} in `retrieval.robots`")
            hints = {"key": admit, "program": admit, "host_key": trust}
            account = msg(
                f"allow {arg(source.user)} to read all of {arg(source.folder)} on {arg(robot.name)}, then run the same "
                "command again"
            )
            raise errors.DeviceError(f"nothing was collected: {arg(robot.why)}", hint=hints.get(kind, account))
        if robot.lacking:
            hint = "select fewer files with `files=`, or raise its `budget_mb` in `retrieval.robots`"
            raise errors.DeviceError(
                f"{arg(size(robot.lacking))} more free space is needed on {arg(robot.gateway)} for {arg(robot.name)}",
                hint=hint,
            )

    def start(self, job: Mapping[str, Any]) -> None:
        """Start the transfer; raise NotBegun, or BeginningUnknown if the response was lost."""
        name = self.host.name
        try:
            answer = self._ask("start", job)
        except GatewayAway as error:
            raise BeginningUnknown(
                f"unknown whether {arg(name)} has started: {arg(error)}", hint=shown_by(self.host, self.source)
            ) from None
        if (why := answer.get("error")) is None:
            return
        words = {
            "running": "a transfer is already running there",
            "more": "there is more to send than was checked",
            "nothing": "there is nothing left to send",
            "robot": msg(
                f"{arg(self.source.name)} no longer responds"
                if answer.get("why")
                else f"{arg(self.source.name)} responds now"
            ),
            "unit": msg(f"its unit does not start: {arg(answer.get('why'))}"),
        }
        hint = shown_by(self.host, self.source) if why == "running" else "run the same command again"
        raise NotBegun(f"{arg(name)} does not start: {arg(words[why])}", hint=hint)

    def status(self) -> RetrievalStatus:
        """Return the transfer's status; raise GatewayAway."""
        return self._status(self._ask("status", {}))

    def stop(self) -> RetrievalStatus:
        """Stop the transfer and return its status; raise GatewayAway or DeviceError."""
        answer = self._ask("stop", {})
        if "error" in answer:
            raise errors.DeviceError(
                f"{arg(self.host.name)} does not stop: {arg(answer.get('why'))}", hint="run the same command again"
            )
        return self._status(answer)

    def _status(self, answer: Mapping[str, Any]) -> RetrievalStatus:
        links = {site_link.name for site_link in self._declaration.sites[self.host.site].bearers}
        name = answer.get("link")
        link = link_of(self._declaration, self.host.site, str(name)) if name in links else None
        return RetrievalStatus(answer, link, self.source.name)

    def _ask(self, verb: str, values: Mapping[str, Any]) -> dict[str, Any]:
        name = self.host.name
        try:
            process = subprocess.run(  # noqa: S603 - ssh, and arguments that are ours
                self._command(verb),
                input=json.dumps({**values, "source": self.source.name}),
                capture_output=True,
                text=True,
                timeout=_ANSWER_S,
                check=False,
            )
        except subprocess.TimeoutExpired:
            raise GatewayAway(
                f"{arg(name)} did not respond within {arg(_ANSWER_S):.0f} s", hint="run the same command again"
            ) from None
        except OSError as error:
            raise GatewayAway(f"{arg(name)} is unreachable: {arg(error)}", hint="install the OpenSSH client") from None
        if process.returncode:
            raise self._failure(process.stderr)
        try:
            answer: dict[str, Any] = json.loads(process.stdout.strip().rpartition("\n")[2])
        except ValueError:
            raise GatewayAway(
                f"the response of {arg(name)} was incomplete", hint="run the same command again"
            ) from None
        if answer.get("source") != self.source.name:
            raise self._not_set_up()
        return answer

    def _not_set_up(self) -> errors.DeviceError:
        retrieval, name = self._declaration.pilot.retrieval, self.host.name
        centre = self.host if retrieval is None else self._declaration.hosts[retrieval.to]
        return errors.DeviceError(
            f"{arg(name)} is not set up for this",
            hint=(
                f"run `provision site={arg(self.host.site)} device={arg(name)}` and `provision site={arg(centre.site)} "
                f"device={arg(centre.name)}`"
            ),
        )

    def _failure(self, text: str) -> errors.DeviceError:
        name = self.host.name
        if _NO_PROGRAM in text or "are declared" in text:
            return self._not_set_up()
        if (trouble := key_trouble(name, text)) is not None:
            return GatewayAway(f"{arg(name)} was not reached: {arg(trouble[0])}", hint=trouble[1])
        last = text.strip().rpartition("\n")[2] or "ssh said nothing"
        return GatewayAway(
            f"{arg(name)} was not reached: {arg(last)}",
            hint="check its power and your connection to it, then run the same command again",
        )


def shown_by(host: Host, source: Source) -> str:
    """Return the hint on how to show or stop the transfer."""
    return msg(
        f"`provision robot retrieve site={arg(host.site)} from={arg(source.name)} status` shows it, `stop` instead "
        "ends it"
    )


def new_number() -> str:
    """Return the name of a new transfer: its start time (UTC)."""
    return datetime.now(UTC).strftime("%Y%m%dT%H%M%SZ")


def duration(seconds: float) -> str:
    """Format a duration: `40 s`, `12 min`, `3 h 20 min`."""
    if seconds < _LONG_S:
        return f"{max(1, math.ceil(seconds))} s"
    minutes = math.ceil(seconds / 60)
    hours, rest = divmod(minutes, 60)
    return msg(f"{arg(minutes)} min" if not hours else f"{arg(hours)} h {arg(rest)} min")


_LONG_S: Final = 120


def _files(count: int) -> str:
    return msg(f"{arg(count)} file" if count == 1 else f"{arg(count)} files")


def left_out(look: Mapping[str, Any]) -> list[str]:
    """Return which files are not sent, and why."""
    words = (
        ("compared", "{files} of them retrieved earlier, to be compared again"),
        ("kept", "{files} retrieved earlier"),
        ("writing", "{files} skipped: written less than a minute ago"),
        ("unnamed", "{files} skipped: the name is not printable text"),
    )
    return [msg(text.format(files=arg(_files(look[name])))) for name, text in words if look.get(name)]
