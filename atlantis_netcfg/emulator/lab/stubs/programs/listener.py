"""Stub, not ROS: prints the talker's messages."""

# ruff: noqa: INP001 - a file of a package, no module of ours

import os
import socket
import sys
import time

port = 7400 + 250 * int(os.environ.get("ROS_DOMAIN_ID") or 0) + 249
sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
sock.bind(("127.0.0.1", port))
while True:
    text = sock.recv(1000).decode()
    sys.stderr.write(f"[INFO] [{time.time():.9f}] [listener]: I heard: [{text}]\n")
    sys.stderr.flush()
