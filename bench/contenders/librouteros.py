"""librouteros, one call at a time: the library under most Python tools for RouterOS."""

from __future__ import annotations

from bench import strangers
from bench.job import Command, Job, Scenario

__all__ = ["Librouteros"]


class Librouteros:
    """A careful script on one TLS connection: read a menu, compare, change row by row."""

    name = "librouteros"
    title = "librouteros, call by call"

    def missing(self) -> str | None:
        """Whether it is installed."""
        return strangers.absent("librouteros")

    def version(self) -> str:
        """The installed one."""
        return f"librouteros {strangers.version('librouteros')}"

    def command(self, job: Job) -> Command:
        """Run the script; it is the same for every scenario, since it reads before it writes."""
        path = job.write(menus=job.declared.menus())
        note = "no safe mode, no reading back: what the calls returned is believed"
        return Command((strangers.python(), strangers.script("librouteros_calls.py"), str(path)), notes=(note,))

    def notes_of(self, scenario: Scenario, text: str) -> tuple[str, ...]:  # noqa: ARG002 - as the others
        """Nothing worth a note."""
        return ()
