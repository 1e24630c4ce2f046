"""Coverage along a track: 4G signal values and link measurements by position.

`positions` gets the current position or the reason why there is none. `radio` reads the 4G unit and asks the router
which link carries the traffic. `measure` sends test packets within an hourly budget. `points` is the survey file;
`exports` and `page` are generated from that file alone. Nothing is interpolated. `rehearsal` emulates a voyage.
"""

from __future__ import annotations
