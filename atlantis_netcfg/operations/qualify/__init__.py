"""`provision qualify`: measure a link of a site from this computer, over the bearer that is meant, within a budget.

`plan` says what is sent and how much that is at most, `measure` sends it, `way` has the router lead this computer's
test packets over one bearer and count them on all, `run` puts them together for a declared site, and `result` says what
came of it. Figures and verdicts are those of the package `atlantis_netcfg.links.qualify`.
"""

from __future__ import annotations
