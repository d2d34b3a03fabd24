"""Recordings: MCAP with ROS 2 types, replay, folders of posed depth images."""
