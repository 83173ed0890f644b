"""The master: scan, AL states, mailboxes and registers, and the thread that waits for slaves."""
