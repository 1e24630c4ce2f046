"""napalm-ros: a script staged as merge candidate and imported on the device."""

from __future__ import annotations

from bench import strangers
from bench.job import Command, Job, Scenario

__all__ = ["Napalm"]


class Napalm:
    """`load_merge_candidate` and `commit_config`; a no-op is `compare_config` against the export of before."""

    name = "napalm-ros"
    title = "napalm-ros, merge"

    def missing(self) -> str | None:
        """Whether it is installed."""
        return strangers.absent("napalm-ros")

    def version(self) -> str:
        """The installed one."""
        return f"napalm-ros {strangers.version('napalm-ros')}"

    def command(self, job: Job) -> Command:
        """Merge the script, which a person has written for the state that the router is in."""
        compare = job.scenario is Scenario.NOTHING
        path = job.write(text=job.export if compare else "\n".join(job.script) + "\n", compare=compare)
        notes = ["does not read before it writes: the script was written for the state that the router is in"]
        if compare:
            notes = ["cannot tell that a merge has nothing to do: compares the router's export with the one of before"]
        return Command((strangers.python(), strangers.script("napalm_merge.py"), str(path)), notes=tuple(notes))

    def notes_of(self, scenario: Scenario, text: str) -> tuple[str, ...]:  # noqa: ARG002 - as the others
        """Nothing worth a note."""
        return ()
