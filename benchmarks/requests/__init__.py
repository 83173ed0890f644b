"""Requests over Zenoh: how many SDO reads a second, and how long one takes, also as a command."""
