"""Ethernet frames between this computer and slaves with EoE: interface, switch, and traffic."""
