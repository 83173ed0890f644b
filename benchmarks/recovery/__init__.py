"""Slaves that come back, and what they are told."""
