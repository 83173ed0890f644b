"""Frames of the control side: interfaces, relay, register access, scan, EEPROMs."""
