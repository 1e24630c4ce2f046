"""`provision measure link`: measures a site's link from this computer, over the selected link, within a budget.

`plan` computes what is sent and its maximum, `measure` sends it, and `routing` lets the router route this computer's
test packets over one link and count them on all. `run` combines these for a site of the inventory, and `result`
reports the outcome. Figures and verdicts are those of the package `atlantis_netcfg.links.qualify`.
"""

from __future__ import annotations
