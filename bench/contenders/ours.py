"""Us: the command that a technician types."""

from __future__ import annotations

import sys

from atlantis_netcfg import __version__
from atlantis_netcfg.runs import Store
from bench.declared import CHECKOUT, ROUTER, SITE
from bench.job import Command, Job, Scenario

__all__ = ["Ours"]


class Ours:
    """`provision site=coastal --yes`: loading and validating the pilot, Ansible's start, safe mode and reading back."""

    name = "ours"
    title = "provision"

    def missing(self) -> str | None:
        """We are always here."""
        return None

    def version(self) -> str:
        """Our own."""
        return f"provision {__version__}"

    def command(self, job: Job) -> Command:
        """Run the real command where the router stands at its declared address, else what that command runs."""
        state = job.folder / "state"
        Store(state, is_rehearsal=not job.real).pins.pin(ROUTER, job.pin)
        environment = {
            "ATLANTIS_STATE": str(state),
            "ANSIBLE_VAULT_PASSWORD_FILE": str(job.declared.vault_password),
            "ANSIBLE_CONFIG": str(CHECKOUT / "ansible.cfg"),
        }
        if job.real:
            only = (f"site={SITE}", f"device={ROUTER}")
            begun = ("links", "use", f"site={SITE}", "link=4g", "for=30m", "--accept-cost")
            words = (*(begun if job.scenario is Scenario.USE else only), "--yes", f"inventory={job.declared.inventory}")
            return Command((sys.executable, "-P", "-m", "atlantis_netcfg", *words), environment)
        if job.scenario is Scenario.USE:
            raise LookupError("without root the router cannot stand at its declared address")
        target = f"{ROUTER}={job.host}:{job.port}:{job.pin}"
        given = (str(job.declared.inventory), str(state), target)
        note = "without root the router cannot stand at its declared address: the playbook is run without the command"
        return Command((sys.executable, "-m", "bench.engine", *given), environment, (note,))

    def notes_of(self, scenario: Scenario, text: str) -> tuple[str, ...]:  # noqa: ARG002 - as the others
        """Nothing worth a note."""
        return ()
