"""The mailboxes of slaves: messages (ETG.1000.4), CoE and SDOs (ETG.1000.6)."""
