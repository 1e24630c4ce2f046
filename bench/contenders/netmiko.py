"""netmiko: a script typed into the console, line by line, over SSH."""

from __future__ import annotations

from bench import strangers
from bench.job import Command, Job, Scenario

__all__ = ["Netmiko"]


class Netmiko:
    """`send_config_set` with the lines of a script; a no-op is reading `/export` and comparing it by eye."""

    name = "netmiko"
    title = "netmiko, script"

    def missing(self) -> str | None:
        """Whether it is installed."""
        return strangers.absent("netmiko")

    def version(self) -> str:
        """The installed one."""
        return f"netmiko {strangers.version('netmiko')}"

    def command(self, job: Job) -> Command:
        """Type the script, which a person has written for the state that the router is in."""
        if job.ssh_port is None:
            raise LookupError("the emulated router has no SSH here")
        reading = job.scenario is Scenario.NOTHING
        naming = [line for line in job.script if line.startswith("/system identity ")]
        lines = [line for line in job.script if line not in naming]
        # A new identity is a new prompt, for which netmiko would wait in vain: it comes last, without waiting for one.
        path = job.write(commands=[] if reading else lines, last=[] if reading else naming)
        notes = ["does not read before it writes: the script was written for the state that the router is in"]
        if reading:
            notes = ["has no notion of nothing to do: reads the router's export, for a person to compare"]
        return Command((strangers.python(), strangers.script("netmiko_script.py"), str(path)), notes=tuple(notes))

    def notes_of(self, scenario: Scenario, text: str) -> tuple[str, ...]:
        """Lines that the console has refused: netmiko does not look for them."""
        return () if scenario is Scenario.NOTHING or "; 0 lines" in text else (text.splitlines()[0],)
