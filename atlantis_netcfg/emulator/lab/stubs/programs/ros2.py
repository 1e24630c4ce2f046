"""stand-in, not ROS: `ros2 run PACKAGE PROGRAM`."""

# ruff: noqa: INP001 - a file of a package, no module of ours

import os
import sys
from pathlib import Path

if len(sys.argv) < len(("ros2", "run", "PACKAGE", "PROGRAM")) or sys.argv[1] != "run":
    sys.exit("stand-in, not ROS: only `ros2 run PACKAGE PROGRAM` is known")
program = str(Path("@HOME@", "lib", sys.argv[2], sys.argv[3]))
if not os.access(program, os.X_OK):
    sys.exit(f"Package '{sys.argv[2]}' not found")
os.execv(program, [program, *sys.argv[4:]])  # noqa: S606 - as the real one does
