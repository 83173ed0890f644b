"""Simulated devices: terminals, drives and generic slaves."""
