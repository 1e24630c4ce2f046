"""Stub, not ROS: sends hello once a second, to a local port that belongs to the ROS domain."""

# ruff: noqa: INP001 - a file of a package, no module of ours

import os
import socket
import sys
import time

port = 7400 + 250 * int(os.environ.get("ROS_DOMAIN_ID") or 0) + 249
out = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
number = 0
while True:
    time.sleep(1)
    number += 1
    text = f"Hello World: {number}"
    out.sendto(text.encode(), ("127.0.0.1", port))
    sys.stderr.write(f"[INFO] [{time.time():.9f}] [talker]: Publishing: '{text}'\n")
    sys.stderr.flush()
