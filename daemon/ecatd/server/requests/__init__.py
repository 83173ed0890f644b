"""Requests of clients to a running bus: what each needs from the slaves."""
