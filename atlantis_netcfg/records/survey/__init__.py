"""Coverage along a track: what a 4G unit hears and what the link carries, by position.

`positions` says where we are or why not, `radio` reads the unit and asks the router which link carries the traffic,
`measure` sends a few test packets within an hourly budget, `points` is the file that all of it is added to, and
`exports` and `page` are made of that file alone. Nothing is interpolated. `rehearsal` is an emulated voyage.
"""

from __future__ import annotations
