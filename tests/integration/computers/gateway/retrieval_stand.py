"""A gateway, a control centre and a robot with real sshd and rsync, on cables that are cut at will; our files on two.

Their addresses in the VPN stand on the cable itself: the tunnel is not what is tried here. The role itself is run twice
in `test_retrieval_role.py`.
"""

import json
from dataclasses import dataclass, replace
from typing import Any

from gateway_stand import SHIPPED, Start
from waiting import wait_until

from atlantis_netcfg.computers.retrieval import PROGRAM, SERVICE, retrieval
from atlantis_netcfg.emulator.lab import Lab, Machine
from atlantis_netcfg.inventory import Inventory
from atlantis_netcfg.inventory.model import Retrieval, ServerComputer

GATEWAY, CENTRE = "coastal-gateway", "scc-control"
FOLDER, KEPT = "/var/lib/svc-recording", f"/srv/recordings/{GATEWAY}"
ROBOT, BAGS, COLLECTED = "sparus", "/home/recorder/bags", "/var/lib/atlantis/robots/sparus"
OWN = {"to": CENTRE, "budget_mb": 100, "sources": [{"host": GATEWAY}]}
QUICK_S = 4
"""In the place of 120 s: how long a connection may be silent."""
MB = 1_000_000


def declared(host_keys: dict[str, str], **values: Any) -> Inventory:  # noqa: ANN401 - of the model
    """The shipped pilot with a retrieval and these host keys."""
    hosts = dict(SHIPPED.hosts)
    for name, key in host_keys.items():
        device = hosts[name].device
        assert isinstance(device, ServerComputer)
        ssh = device.ssh.model_copy(update={"host_key": key.strip()})
        hosts[name] = replace(hosts[name], device=device.model_copy(update={"ssh": ssh}))
    retrieved = Retrieval.model_validate(OWN | values)
    return replace(SHIPPED, hosts=hosts, pilot=SHIPPED.pilot.model_copy(update={"retrieval": retrieved}))


@dataclass
class Ends:
    """Both ends of a transfer."""

    lab: Lab
    gateway: Machine
    centre: Machine
    declaration: Inventory
    robot: Machine | None = None
    source: str = GATEWAY

    def ask(self, verb: str, **values: Any) -> dict[str, Any]:  # noqa: ANN401 - JSON
        """Ask the gateway's program as the toolkit does, without the SSH before it."""
        done = self.gateway.run(f"python3 -I {PROGRAM} {verb}", input=json.dumps({**values, "source": self.source}))
        answer: dict[str, Any] = json.loads(done.stdout)
        return answer

    def start(
        self,
        *,
        rate_bps: int = 80 * MB,
        cap: int | None = None,
        rtt_max_s: float | None = None,
        silence_s: int = QUICK_S,
        **how: Any,  # noqa: ANN401 - JSON
    ) -> dict[str, Any]:
        """Look, and begin; `how` is what looks."""
        look = self.ask("look", **{"pattern": "*", "again": False, **how})
        job = {
            "id": "r1",
            "link": "lan",
            "rate_bps": rate_bps,
            "cap_bytes": cap,
            "silence_s": silence_s,
            "rtt_max_s": rtt_max_s,
        }
        wish = {"pattern": "*", "again": False, **how, "before": look["before"], "agreed_bytes": look["bytes"], **job}
        if look["robot"] is not None:
            wish["robot"] = look["robot"]["state"]
        assert (told := self.ask("start", **wish)) == {"started": True, "source": self.source}, told
        return look

    def ended(self) -> dict[str, Any]:
        """How it has ended."""
        return self.until(lambda told: not told["running"] and not told["job"])

    def until(self, holds: Any) -> dict[str, Any]:  # noqa: ANN401 - a test of an answer
        """What is told once it is so."""
        told: dict[str, Any] = {}

        def so() -> bool:
            told.clear()
            told.update(self.ask("status"))
            return bool(holds(told))

        wait_until(so, lambda: (told, self.gateway.run(f"journalctl --no-pager -qu {SERVICE} | tail -20").stdout), 0.2)
        return told

    def cut(self, machine: Machine | None = None, *, up: bool = False) -> None:
        """Take the cable of the control centre, or of another, away, or give it back; no end is told."""
        port = f"{(machine or self.centre)._unique.rpartition('-')[2]}-0"
        self.lab.command(("ip", "link", "set", port, "up" if up else "down"))

    def log_in(self, *words: str) -> tuple[int, str]:
        """Try something else with the gateway's key; give the exit code and what was printed."""
        options = "-o BatchMode=yes -o StrictHostKeyChecking=no -o UserKnownHostsFile=/dev/null -o ConnectTimeout=5"
        command = f"ssh -F none -i /etc/ssh/ssh_host_ed25519_key {options} {' '.join(words)} < /dev/null"
        done = self.gateway.run(command, check=False)
        return done.returncode, done.stdout

    def sent(self) -> int:
        """Bytes that the gateway has sent over its interface."""
        return int(self.gateway.run("cat /sys/class/net/eth0/statistics/tx_bytes").stdout)

    def record(self, name: str, size: int, *, age_s: int = 600) -> None:
        """Write a recording that is noise, some time ago, on the gateway or the robot."""
        path = f"{FOLDER if self.robot is None else BAGS}/{name}"
        (self.robot or self.gateway).run(
            f"mkdir -p \"$(dirname '{path}')\" && head -c {size} /dev/urandom > '{path}' "
            f"&& touch -d '{-age_s:+d} seconds' '{path}'"
        )

    def digests(self, machine: Machine, folder: str) -> dict[str, str]:
        """SHA-256 of all files of a folder, by a program that is not ours."""
        lines = machine.run(f"cd '{folder}' && find . -type f -exec sha256sum {{}} +").stdout.splitlines()
        return {path.removeprefix("./"): digest for digest, path in (line.split(maxsplit=1) for line in lines)}


def ends(lab: Lab, machine: Start, *, robot: bool = False) -> Ends:
    """Start both, with what the role lays down on them; and a robot of its owner, who has not admitted the gateway."""
    places = {name: machine(name) for name in (GATEWAY, CENTRE)}
    keys = {name: place.host_key for name, place in places.items()}
    made = Ends(lab, places[GATEWAY], places[CENTRE], declared(keys))
    if robot:
        made.robot, made.source = machine(ROBOT, address="10.64.1.22/24"), ROBOT
        row = {"robot": ROBOT, "host": GATEWAY, "user": "recorder", "folder": BAGS, "budget_mb": 10}
        made.declaration = declared(keys, robots=[{**row, "host_key": made.robot.host_key.strip()}])
        made.robot.run(f"useradd --create-home --shell /bin/bash recorder; mkdir {BAGS}; chmod 755 /home/recorder")
    for name, place in places.items():
        device = made.declaration.hosts[name].device
        assert isinstance(device, ServerComputer)
        place.run(f"ip address add {device.vpn_address}/16 dev eth0; mkdir -p /etc/atlantis {FOLDER}")
        configuration = retrieval(made.declaration, made.declaration.hosts[name])
        for file in configuration.files:
            place.put(file.path, file.content, mode=file.mode)
        place.run("systemctl daemon-reload")
        for unit in configuration.units:
            place.run(f"systemctl enable {unit.name}")
        for step in configuration.steps:
            place.run(" ".join(f"'{word}'" for word in step.run))
        for check in configuration.checks:
            place.run(" ".join(f"'{word}'" for word in check.run))
    return made
