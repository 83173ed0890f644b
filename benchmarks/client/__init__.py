"""What programs get out of the shared memory, and what they cost the daemon."""
