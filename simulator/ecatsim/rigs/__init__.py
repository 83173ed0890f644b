"""Rigs that come with ecatsim."""
