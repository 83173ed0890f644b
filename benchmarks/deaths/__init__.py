"""Clients that turn a drive and are killed."""
