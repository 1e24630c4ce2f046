"""Imported once, by the process that the commands of the test are forks of."""

from authority_child import warm

warm()
