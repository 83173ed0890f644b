"""Puts the files of the service into their places in the system, and removes them."""
