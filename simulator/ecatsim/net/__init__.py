"""Interfaces of Linux: network namespaces and virtual Ethernet pairs."""
