"""Robots on the network: record and check what they publish over DDS, and run mock robots.

Everything runs on a laptop without ROS, by means of cyclonedds (DDS) and rosbags (ROS message types). Both are imported
only when needed: there is no cyclonedds for aarch64.
"""
