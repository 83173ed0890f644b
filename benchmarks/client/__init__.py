"""Clients of the shared memory: how fast they read and write, and what they cost the daemon."""
