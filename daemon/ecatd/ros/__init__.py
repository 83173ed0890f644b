"""Joints and health of the bus for ROS 2, over Zenoh as `rmw_zenoh` of ROS 2 Jazzy writes it."""
