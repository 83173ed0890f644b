"""Requests of clients: a module for each subject, and the checks of all fields in `parsing`."""
