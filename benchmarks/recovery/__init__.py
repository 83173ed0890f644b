"""Slaves that come back, and the settings that the daemon gives them."""
