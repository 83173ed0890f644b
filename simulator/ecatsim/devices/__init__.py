"""Devices people know."""
