"""Robots on the network: what they publish by DDS, heard and judged, and mock robots in their place.

Everything runs on a laptop without ROS: cyclonedds speaks, rosbags knows ROS' own messages. Both are imported when they
are needed: there is no cyclonedds for aarch64.
"""
